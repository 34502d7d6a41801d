# SPDX-License-Identifier: GPL-3.0-or-later
"""The sections of the report about the limit, the shaders alone, ambient occlusion, Live and the pictures."""

import statistics

from scripts.bench.contenders.names import FLATTEN
from scripts.bench.report.race_sections import SHORT
from scripts.bench.report.writing import GAP, table


def limit(found: dict, alone: dict | None) -> list[str]:
    """found: from measure.limit. alone: the times of the shaders without Blender, if they were measured."""
    lines, summary = [], []
    for row in (alone or {}).get("rows", []):
        if (row["pair"], row["size"]) == (found["pair"], found["size"]) and FLATTEN in found["methods"]:
            share = row["flatten_ms"] / 1000 / found["methods"][FLATTEN]["total"]
            summary.append(
                f"- Only the paper's draw call, without Blender: {row['flatten_ms']:.1f} ms, {share:.0%} of the time of "
                "Flatten."
            )
    for name, method in found["methods"].items():
        stages, total = method["stages"], method["total"]
        for stage, cost in stages.items():
            least = f"{1000 * cost['least_seconds']:.1f}" if cost["bytes"] else GAP
            lines.append(
                [SHORT[name], stage, f"{1000 * cost['seconds']:.1f}", f"{cost['seconds'] / total:.0%}"]
                + [f"{cost['bytes'] / 1e6:.0f}" if cost["bytes"] else GAP, least]
            )
        bound = sum(cost["least_seconds"] for cost in stages.values())
        drawing, reading = (stages.get(stage, {"seconds": 0.0})["seconds"] / total for stage in ("draw", "extract"))
        slowest = max(stages, key=lambda stage: stages[stage]["seconds"] - stages[stage]["least_seconds"])
        summary.append(
            f"- {SHORT[name]}: {1000 * total:.0f} ms, {total / bound:.1f} times the time to move the bytes "
            f"({1000 * bound:.1f} ms). Drawing (the map, tangents, margin, checks) takes {drawing:.0%}, "
            f"reading the meshes {reading:.0%}. "
            f"The stage to improve next is **{slowest}**, which is furthest from its bound."
        )
    return [
        "## Distance to the limit",
        "",
        f"{found['pair']} at {found['size']}, compared with {found['gigabytes_per_second']:.1f} GB/s, the best speed of a copy "
        "with numpy (read and written). The bytes are the least that a stage must move: 32 for a corner, 16 for a texel, each "
        "read once and written once. Stages that compute, such as rays or drawing in software, take longer.",
        "",
        *summary,
        "",
        *table(["method", "stage", "ms", "share", "MB at least", "ms at least"], lines),
    ]


def hardware(found: dict) -> list[str]:
    lines = ["## The shaders alone", ""]
    if "error" in found:
        return [*lines, f"Not measured: {found['error']}.", ""]
    renderer = found["renderer"]
    device = f"{renderer}, in software" if found["in_software"] else renderer
    head = [
        "pair",
        "map",
        "Flatten",
        "with read-back",
        "rays by images",
        "by samplers",
        "outermost",
        "nearest",
        "Cast with read-back",
        "M rays/s",
    ]
    return [
        *lines,
        f"The same GLSL without Blender, on {device}, by scripts/dev/hardware.py: milliseconds until the GPU is done. "
        "The add-on reads through images in software, and through samplers on a GPU.",
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
                    f"{row['cast_outermost_ms']:.1f}",
                    f"{row['cast_nearest_ms']:.1f}",
                    f"{row['cast_with_read_back_ms']:.1f}",
                    f"{row['rays_per_second'] / 1e6:.2f}",
                ]
                for row in found["rows"]
            ],
        ),
    ]


def live(rows: list[dict]) -> list[str]:
    lines = [
        [
            f"{row['triangles']:,}",
            f"{row['touched']:.0%}",
            row["size"],
            *map(_rounds, (row["update_ms"], row["image_ms"])),
        ]
        for row in rows
    ]
    return [
        "## Live",
        "",
        "Milliseconds of an update while vertices move: from the changed mesh to the map on the GPU, and from there "
        "to the image. Each round is the median of several updates.",
        "",
        *table(["triangles", "vertices that move", "map", "update", "image"], lines),
    ]


def _rounds(values: list[float]) -> str:
    return f"{statistics.median(values):,.1f} ({min(values):,.1f} to {max(values):,.1f})"


def figures(found: dict[str, str]) -> list[str]:
    lines = ["## The paper's figures, with other models", ""]
    for file, text in found.items():
        lines += [f"{text}", "", f"![{text}]({file})", ""]
    return lines


def occlusion(rows: list[dict]) -> list[str]:
    """The lines of the report."""
    return [
        "## Ambient occlusion",
        "",
        f"{rows[0]['rays']} rays a texel, no limit, both sides of triangles. Differences are root mean squares in steps of",
        "1/255, from a second bake of Cycles with other random numbers and as many samples: the last column is noise.",
        "",
        "| pair | size | Imprint, s | Cycles, s | times faster | Imprint differs | Cycles differs |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(
            f"| {row['pair']} | {row['size']} | {row['seconds']:.1f} | {row['cycles_seconds']:.1f} | "
            f"{row['cycles_seconds'] / row['seconds']:.1f} | {row['difference']:.2f} | {row['cycles_difference']:.2f} |"
            for row in rows
        ),
        "",
    ]
