# SPDX-License-Identifier: GPL-3.0-or-later
"""The sections of the report about bakers that took turns."""

from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN
from scripts.bench.meshes.paper import PAPER
from scripts.bench.report.writing import GAP, milliseconds, ratio, table

SHORT = {FLATTEN: "Flatten", CAST: "Cast"}
STAGES = ("extract", "method", "tree", "upload", "distances", "draw", "read", "audit", "image", "total")


def paper(rows: list[dict]) -> list[str]:
    """Table 1 of the paper, with new measurements beside its figures."""
    lines = []
    known = {}
    for row in rows:
        if row["samples"] == 1:
            known.setdefault((row["pair"], row["high"], row["low"]), []).append(row)
    for (name, high, low), measured in list(known.items())[: len(PAPER)]:
        theirs = min(PAPER, key=lambda entry: abs(entry[0] - high) + abs(entry[1] - low))
        for row in measured:
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
        "drawing in Flatten",
        "Cast",
    ]
    return [
        "## Table 1 of the paper, measured again",
        "",
        "Milliseconds. The columns up to Melody are from the paper, on its machine. The paper's GPU time is only for "
        "drawing; ours is for all steps from the objects to the image.",
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
        reasons += [f"- {label}, {name}: {timed['gap']}" for name, timed in times.items() if timed["gap"]]
        stages += [
            [label, SHORT[name], *(f"{1000 * times[name]['stages'][stage]:.0f}" for stage in STAGES)]
            for name in SHORT
            if times[name]["stages"]
        ]
    head = ["pair, map", *names, "Cycles' first bake", "Cycles / Flatten", "Cycles / Cast"]
    return [
        "## Compared with other bakers",
        "",
        "Milliseconds, in tangent space.",
        "",
        *table(head, lines),
        *([*reasons, ""] if reasons else []),
        "By stage, medians in milliseconds:",
        "",
        *table(["pair, map", "method", *STAGES], stages),
    ]


def closed_forms(rows: list[dict]) -> list[str]:
    lines = []
    for row in rows:
        for name, timed in row["times"].items():
            degrees = row["angles"].get(name)
            found = [f"{degrees[key]:.4f}" for key in ("median", "percentile_99", "maximum")] if degrees else [GAP] * 3
            written = f"{degrees['written']:.1%}" if degrees else GAP
            lines.append([row["pair"], f"{row['high']:,}", row["size"], name, milliseconds(timed), *found, written])
    head = ["surface", "triangles", "map", "baker", "milliseconds", "median", "99th percentile", "maximum", "written"]
    return [
        "## Accuracy",
        "",
        "Degrees from the exact normal at the texel's center, for the same texels. Most of the error comes from the mesh, "
        "whose triangles interpolate normals. World space.",
        "",
        *table(head, lines),
    ]
