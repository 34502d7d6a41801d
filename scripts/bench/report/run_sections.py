# SPDX-License-Identifier: GPL-3.0-or-later
"""The sections of the report about bakes in processes of their own, against an older version."""

import statistics

from scripts.bench.contenders.names import PRESENT
from scripts.bench.report.statistics_of_rounds import older_name, ratios
from scripts.bench.report.writing import GAP, milliseconds, seconds, span, table


def bakes(rows: list[dict]) -> list[str]:
    lines = []
    for row in rows:
        older = row["times"].get(older_name(row))
        label = [row["what"], row["pair"], row["size"]]
        lines.append([*label, milliseconds(row["times"][PRESENT]), milliseconds(older), _times(row)])
    return [
        "## Against the older version",
        "",
        "Milliseconds from the objects to an image, with a new tree for each bake. Each version bakes in a process of its own.",
        "",
        *table(["method", "pair", "map", "now", "older", "times faster"], lines),
    ]


def storing(rows: list[dict]) -> list[str]:
    lines = []
    for row in rows:
        for name, timed in row["times"].items():
            whole = row["whole"][name]
            lines.append(
                [row["what"], name, milliseconds(timed), milliseconds({"seconds": whole}), f"{row['bytes'][name]:,}"]
                + [_times(row) if name == PRESENT else GAP]
            )
    head = ["format", "version", "stored, ms", "whole bake, ms", "bytes", "times faster than the older version"]
    return [
        "## Storing",
        "",
        f"{rows[0]['pair']}, Flatten, {rows[0]['size']} x {rows[0]['size']}, red, green, blue and alpha. Stored: from texels "
        "in memory to a file and an image datablock, which is the stage `image` of the report.",
        "",
        *table(head, lines),
    ]


def start(rows: list[dict]) -> list[str]:
    lines, stages = [], []
    for row in rows:
        for name, timed in row["times"].items():
            lines.append([row["what"], name, seconds(timed), _times(row) if name == PRESENT else GAP])
            for key in ("startup", "bake"):
                found = row[key].get(name, {})
                stages += [[name, key, stage, f"{1e3 * value:.0f}"] for stage, value in found.items() if value]
    return [
        "## From the shell",
        "",
        f"{rows[0]['pair']} at {rows[0]['size']}: from the start of `scripts/imprint.py bake` to its end, in seconds.",
        "",
        *table(["run", "version", "seconds", "times faster than the older version"], lines),
        "Stages as the report has them, medians in milliseconds:",
        "",
        *table(["version", "part", "stage", "ms"], stages),
    ]


def batches(rows: list[dict]) -> list[str]:
    lines = []
    for row in rows:
        for name, timed in row["times"].items():
            minutes = [second / 60.0 for second in timed["seconds"]]
            rate = f"{row['sets'] / statistics.median(minutes):,.0f}" if minutes else timed["gap"] or GAP
            lines.append([row["what"], name, seconds(timed), rate, _times(row) if name == PRESENT else GAP])
    head = ["job file", "version", "seconds", "bakes a minute", "times faster than the older version"]
    return [
        "## Many bakes",
        "",
        f"{rows[0]['pair']} at {rows[0]['size']}, from the start of `scripts/imprint.py bake --jobs` to its end.",
        "",
        *table(head, lines),
    ]


def memory(rows: list[dict]) -> list[str]:
    return [
        "## Memory",
        "",
        "A generated grid onto a plane, each bake in a process of its own, into a PNG of 16 bits. The peak is that of the "
        "process as the system counts it (VmHWM), with Blender and the meshes; before is what it held when the bake began. "
        "In software, textures and buffers of the GPU are part of it.",
        "",
        *_peaks(rows),
    ]


def very_large(rows: list[dict]) -> list[str]:
    return ["## Very large meshes", "", "As under Memory, one bake each.", "", *_peaks(rows)]


def samples(rows: list[dict]) -> list[str]:
    lines = []
    for row in rows:
        label = [row["what"], row["pair"], row["size"], row["samples"]]
        for name, timed in row["times"].items():
            early, angles = row["stopped_early"], row.get("angles", {})
            is_adaptive = name == PRESENT and row["samples"] > 1
            lines.append(
                [*label, name, milliseconds(timed), f"{early:.1%}" if is_adaptive and early is not None else GAP]
            )
            shown = (f"{angles[key]:.4f}" for key in ("percentile_99", "percentile_99_9", "maximum"))
            lines[-1] += shown if is_adaptive and angles else [GAP] * 3
            lines[-1].append(f"{angles['unlike']:.4%}" if is_adaptive and angles else GAP)
    head = ["method", "pair", "map", "samples", "version", "ms", "stopped early"]
    return [
        "## Several samples",
        "",
        "Adaptive samples stop early where the first ones agree. Degrees are those between the normals of adaptive samples and "
        "of all samples everywhere; the last column is the share of texels that only one of the two maps covers.",
        "",
        *table([*head, "99th percentile", "99.9th percentile", "maximum", "covered by one"], lines),
    ]


def _peaks(rows: list[dict]) -> list[str]:
    lines = []
    for row in rows:
        for name, timed in row["times"].items():
            peaks = row["peak_bytes"].get(name)
            lines.append(
                [row["what"], row["size"], name, f"{max(peaks) / 1e9:.2f}" if peaks else timed["gap"] or GAP]
                + [f"{row['held_bytes'][name] / 1e9:.2f}" if row["held_bytes"].get(name) else GAP]
                + [f"{timed['first']:.1f}" if timed["first"] else GAP, seconds(timed)]
            )
    head = ["bake", "map", "version", "peak, GB", "before, GB", "first bake, s", "later bakes, s"]
    return table(head, lines)


def _times(row: dict) -> str:
    """How many times faster than the older version, or a gap."""
    older = older_name(row)
    found = older and ratios(row, older, PRESENT)
    return span(found) if found else GAP
