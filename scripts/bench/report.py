# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the report from the measurements: Markdown, and plots of how cost grows."""

import statistics
from pathlib import Path

from scripts.bench.contenders import CAST, CYCLES, FLATTEN
from scripts.bench.measure import PAPER, exponents, ratios
from scripts.bench.verdicts import HOLDS, LARGEST, Verdict, judge, span

GAP = "–"
SHORT = {FLATTEN: "Flatten", CAST: "Cast"}


def table(head: list[str], rows: list[list]) -> list[str]:
    """A Markdown table, as lines."""
    return [f"| {' | '.join(map(str, line))} |" for line in (head, ["---"] * len(head), *rows)] + [""]


def milliseconds(timed: dict | None) -> str:
    """A contender's median with the minimum and maximum of its rounds, or the reason why it has none."""
    if not timed or not timed["seconds"]:
        return GAP
    seconds = [1000.0 * second for second in timed["seconds"]]
    return f"{statistics.median(seconds):,.0f} ({min(seconds):,.0f} to {max(seconds):,.0f})"


def ratio(row: dict, slower: str, faster: str) -> str:
    found = ratios(row, slower, faster)
    return span(found, 1 if found["median"] >= 10.0 else 2) if found else GAP


def markdown(result: dict) -> str:
    """The whole report."""
    lines = ["# Imprint, measured", ""]
    if result["quick"]:
        lines += ["A quick run: fewer sizes and rounds than the whole one.", ""]
    lines += verdicts(judge(result)) + machine(result)
    for part, write in (
        ("pairs", lambda rows: paper(rows) + contest(rows)),
        ("closed_forms", closed_forms),
        ("growth", growth),
        ("live", live),
        ("limit", lambda found: limit(found, result.get("hardware"))),
        ("hardware", hardware),
        ("figures", figures),
    ):
        if result.get(part):
            lines += write(result[part])
    return "\n".join(lines)


def verdicts(found: list[Verdict]) -> list[str]:
    held = sum(verdict.outcome == HOLDS for verdict in found)
    return [
        f"{held} of {len(found)} targets hold. Each is held in all rounds; where some reach it and others do not, it is "
        "called open.",
        "",
        *(f"- **{verdict.outcome}**: {verdict.target}. {verdict.figures}." for verdict in found),
        "",
    ]


def machine(result: dict) -> list[str]:
    about, peers = result["machine"], result["peers"]
    software = ", which draws in software: there is no GPU" if about["in_software"] else ""
    others = ", ".join(f"{name} {version}" for name, version in peers.items()) or "none; --peers installs them"
    load = f"load {about['load']} at the start" if about["load"] is not None else "load unknown"
    return [
        f"{about['cores']} cores of {about['processor']}, {about['system']}, {load}; {about['renderer']} by "
        f"{about['backend']}{software}; Blender {about['blender']}. Other bakers: {others}.",
        "",
        f"Medians of {result['repeats']} rounds after a first bake that does not count, with the least and most of the "
        "rounds in brackets. In a round each contender bakes once; a ratio's brackets are those of the rounds' ratios. "
        "A time goes from the objects (for bakers outside Blender: from arrays) to pixels that can be read. "
        f"{GAP} is a gap: not installed, or it cannot bake that pair. The whole took {result['seconds']:.0f} s.",
        "",
    ]


def paper(rows: list[dict]) -> list[str]:
    """Table 1 measured again, beside the figures of the paper."""
    lines = []
    known = {}
    for row in rows:
        if row["samples"] == 1:
            known.setdefault((row["pair"], row["high"], row["low"]), []).append(row)
    for (name, high, low), mine in list(known.items())[: len(PAPER)]:
        theirs = min(PAPER, key=lambda entry: abs(entry[0] - high) + abs(entry[1] - low))
        for row in mine:
            flat = row["times"][FLATTEN]
            lines.append(
                [
                    f"{theirs[1]:,} / {theirs[0]:,}",
                    theirs[2],
                    f"{theirs[3]:,}",
                    f"{theirs[4]:,}",
                    f"{name}, {low:,} / {high:,}",
                    row["size"],
                    milliseconds(flat),
                    f"{1000 * flat['stages']['draw']:.1f}" if flat["stages"] else GAP,
                    milliseconds(row["times"][CAST]),
                ]
            )
    head = [
        "polygons low / high",
        "paper's GPU",
        "NormalMapper",
        "Melody",
        "our pair",
        "map",
        "Flatten",
        "of that, drawing",
        "Cast",
    ]
    return [
        "## Table 1 of the paper again",
        "",
        "Milliseconds. Their columns are from the paper, on their machine; the paper's GPU time is that of "
        "drawing, ours is everything from the objects to the image.",
        "",
        *table(head, lines),
    ]


def contest(rows: list[dict]) -> list[str]:
    names = list(dict.fromkeys(name for row in rows for name in row["times"]))
    lines, reasons, stages = [], [], []
    for row in rows:
        label = f"{row['pair']}, {row['size']}" + (f", {row['samples']} samples" if row["samples"] > 1 else "")
        times = row["times"]
        first = times[CYCLES]["first"]
        lines.append(
            [label, *(milliseconds(times.get(name)) for name in names), f"{1000 * first:,.0f}" if first else GAP]
            + [ratio(row, CYCLES, FLATTEN), ratio(row, CYCLES, CAST)]
        )
        reasons += [f"- {label}, {name}: {one['gap']}" for name, one in times.items() if one["gap"]]
        stages += [
            [label, SHORT[name], *(f"{1000 * times[name]['stages'][stage]:.0f}" for stage in STAGES)]
            for name in SHORT
            if times[name]["stages"]
        ]
    head = ["pair, map", *names, "Cycles' first bake", "Flatten faster than Cycles", "Cast faster than Cycles"]
    return [
        "## Against others",
        "",
        "Milliseconds; tangent space.",
        "",
        *table(head, lines),
        *([*reasons, ""] if reasons else []),
        "By stage, medians in milliseconds:",
        "",
        *table(["pair, map", "method", *STAGES], stages),
    ]


STAGES = ("extract", "method", "tree", "upload", "distances", "draw", "read", "audit", "image", "total")


def closed_forms(rows: list[dict]) -> list[str]:
    lines = []
    for row in rows:
        for name, timed in row["times"].items():
            degrees = row["angles"].get(name)
            found = [f"{degrees[key]:.4f}" for key in ("median", "percentile_99", "maximum")] if degrees else [GAP] * 3
            written = f"{degrees['written']:.1%}" if degrees else GAP
            lines.append([row["pair"], f"{row['high']:,}", name, milliseconds(timed), *found, written])
    head = ["surface", "triangles", "baker", "milliseconds", "median", "99th percentile", "maximum", "written"]
    return [
        "## How exact",
        "",
        "Degrees from the normal that the formula has at the texel's center, the same texels for all; what is left is "
        "mostly the mesh's own: its triangles interpolate normals. World space, "
        f"{rows[0]['size']} x {rows[0]['size']} texels.",
        "",
        *table(head, lines),
    ]


def growth(parts: dict[str, list[dict]]) -> list[str]:
    lines, fits = [], []
    for kind, points in parts.items():
        for point in points:
            peaks = (point["peak_gigabytes"][name] for name in SHORT)
            lines.append(
                [kind, f"{point['amount']:,}", *(milliseconds({"seconds": point["seconds"][name]}) for name in SHORT)]
                + [f"{peak:.2f}" if peak is not None else GAP for peak in peaks]
            )
        fits.append(
            [kind, *(span(exponents(points, name, last)) for name in SHORT for last in (None, LARGEST))],
        )
    return [
        "## How cost grows",
        "",
        "Triangles at 512 x 512; texels and samples with 199,712 triangles, samples at 256 x 256. The exponent b of "
        "time = a x amount^b, by least squares of the logarithms; below 1 is slower than linear growth. Peak memory is the "
        "whole process, Blender and the meshes and images of all points up to this one included: an upper bound.",
        "",
        *table(["by", "Flatten, all", f"Flatten, largest {LARGEST}", "Cast, all", f"Cast, largest {LARGEST}"], fits),
        *table(["by", "amount", "Flatten, ms", "Cast, ms", "Flatten, peak GB", "Cast, peak GB"], lines),
        "![How cost grows](growth.png)",
        "",
    ]


def limit(found: dict, alone: dict | None) -> list[str]:
    """alone: the times of the shaders without Blender, if they were measured."""
    lines, words = [], []
    for row in (alone or {}).get("rows", []):
        if (row["pair"], row["size"]) == (found["pair"], found["size"]) and FLATTEN in found["methods"]:
            share = row["flatten_ms"] / 1000 / found["methods"][FLATTEN]["total"]
            words.append(
                f"- The paper's one draw alone, without Blender: {row['flatten_ms']:.1f} ms, {share:.0%} of all that "
                "Flatten does."
            )
    for name, method in found["methods"].items():
        stages, total = method["stages"], method["total"]
        for stage, one in stages.items():
            least = f"{1000 * one['least_seconds']:.1f}" if one["bytes"] else GAP
            lines.append(
                [SHORT[name], stage, f"{1000 * one['seconds']:.1f}", f"{one['seconds'] / total:.0%}"]
                + [f"{one['bytes'] / 1e6:.0f}" if one["bytes"] else GAP, least]
            )
        bound = sum(one["least_seconds"] for one in stages.values())
        drawing, reading = (stages.get(stage, {"seconds": 0.0})["seconds"] / total for stage in ("draw", "extract"))
        next_one = max(stages, key=lambda stage: stages[stage]["seconds"] - stages[stage]["least_seconds"])
        words.append(
            f"- {SHORT[name]}: {1000 * total:.0f} ms, {total / bound:.1f} times what moving the bytes would take "
            f"({1000 * bound:.1f} ms). All drawing (the map, tangents, margin, checks) is {drawing:.0%} of it, "
            f"reading the meshes {reading:.0%}. "
            f"The stage to attack next is **{next_one}**, which loses most against its bound."
        )
    return [
        "## Distance to the limit",
        "",
        f"{found['pair']} at {found['size']}, against {found['gigabytes_per_second']:.1f} GB/s, the best at which numpy copies "
        "(read and written). The bytes are the least that a stage must move: 32 a corner, 16 a texel, each read once and "
        "written once. What computes (drawing in software, rays) has more to do than that.",
        "",
        *words,
        "",
        *table(["method", "stage", "ms", "share", "MB at least", "ms at least"], lines),
    ]


def hardware(found: dict) -> list[str]:
    lines = ["## The shaders alone", ""]
    if "error" in found:
        return [*lines, f"Not measured: {found['error']}.", ""]
    renderer = found["renderer"]
    how = f"{renderer}, in software" if found["in_software"] else renderer
    head = [
        "pair",
        "map",
        "Flatten",
        "with read-back",
        "rays by images",
        "by samplers",
        "Cast with read-back",
        "M rays/s",
    ]
    return [
        *lines,
        f"Without Blender, on {how}: the same GLSL by scripts/dev/hardware.py, milliseconds until the GPU is done. "
        "The addon reads by images in software and by samplers elsewhere.",
        "",
        *table(
            head,
            [
                [
                    row["pair"],
                    row["size"],
                    f"{row['flatten_ms']:.2f}",
                    f"{row['flatten_with_read_back_ms']:.2f}",
                    f"{row['cast_from_images_ms']:.1f}",
                    f"{row['cast_from_samplers_ms']:.1f}",
                    f"{row['cast_with_read_back_ms']:.1f}",
                    f"{row['rays_per_second'] / 1e6:.2f}",
                ]
                for row in found["rows"]
            ],
        ),
    ]


def live(rows: list[dict]) -> list[str]:
    return [
        "## Live",
        "",
        "An update while vertices move, from the changed mesh to the map's texels in memory, and putting those into the image; "
        "milliseconds, with the least and most of all updates.",
        "",
        *table(
            ["triangles", "map", "update", "image"],
            [
                [f"{row['triangles']:,}", row["size"], *(f"{a:,.1f} ({b:,.1f} to {c:,.1f})" for a, b, c in parts)]
                for row in rows
                for parts in [(row["update_ms"], row["image_ms"])]
            ],
        ),
    ]


def figures(found: dict[str, str]) -> list[str]:
    lines = ["## The paper's figures, with other models", ""]
    for file, text in found.items():
        lines += [f"{text}", "", f"![{text}]({file})", ""]
    return lines


def plot(parts: dict[str, list[dict]], path: Path) -> None:
    """Plot seconds and peak memory over triangles, texels and samples, with fits over all points."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    figure, axes = plt.subplots(2, len(parts), figsize=(4.2 * len(parts), 7), squeeze=False, layout="constrained")
    for column, (kind, points) in enumerate(parts.items()):
        amounts = np.array([point["amount"] for point in points], float)
        time, memory = axes[:, column]
        for name, short in SHORT.items():
            rounds = np.array([point["seconds"][name] for point in points])
            middle = np.median(rounds, axis=1)
            exponent = exponents(points, name)["median"]
            (line,) = time.loglog(amounts, middle, "o", label=f"{short}, exponent {exponent:.2f}")
            time.fill_between(amounts, rounds.min(axis=1), rounds.max(axis=1), color=line.get_color(), alpha=0.2)
            scale = np.exp(np.mean(np.log(middle) - exponent * np.log(amounts)))
            time.loglog(amounts, scale * amounts**exponent, "-", color=line.get_color(), linewidth=1)
            peaks = [point["peak_gigabytes"][name] for point in points]
            if None not in peaks:
                memory.loglog(amounts, peaks, "o-", label=short)
        time.set(xlabel=kind, ylabel="seconds")
        memory.set(xlabel=kind, ylabel="peak memory, GB")
        time.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)
