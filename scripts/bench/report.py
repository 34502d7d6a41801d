# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the report from the measurements: Markdown, and plots of how cost grows."""

import statistics
from pathlib import Path

from scripts.bench import occlusion
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
        lines += ["A quick run, with fewer sizes and rounds than a full one.", ""]
    lines += verdicts(judge(result)) + machine(result)
    for part, write in (
        ("pairs", lambda rows: paper(rows) + contest(rows)),
        ("closed_forms", closed_forms),
        ("occlusion", occlusion.section),
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
        f"{held} of {len(found)} targets hold. A target holds if all rounds reach it. If only some rounds do, it is open.",
        "",
        *(f"- **{verdict.outcome}**: {verdict.target}. {verdict.figures}." for verdict in found),
        "",
    ]


def machine(result: dict) -> list[str]:
    about, peers = result["machine"], result["peers"]
    software = ", which draws in software, without a GPU" if about["in_software"] else ""
    others = ", ".join(f"{name} {version}" for name, version in peers.items()) or "none; --peers installs them"
    load = f"load {about['load']} at the start" if about["load"] is not None else "load unknown"
    return [
        f"{about['cores']} cores of {about['processor']}, {about['system']}, {load}; {about['renderer']} by "
        f"{about['backend']}{software}; Blender {about['blender']}. Other bakers: {others}.",
        "",
        f"Figures are medians of {result['repeats']} rounds, with the minimum and maximum of the rounds in brackets. Each "
        "baker bakes once per round; a first bake does not count. Brackets of a ratio are those of the ratios of the rounds. "
        "Times are from the objects, or from arrays for bakers outside Blender, to pixels that can be read. "
        f"{GAP} is a gap: the baker is not installed, or cannot bake the pair. The measurement took {result['seconds']:.0f} s.",
        "",
    ]


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
        "## Accuracy",
        "",
        "Degrees from the exact normal at the texel's center, for the same texels. Most of the error comes from the mesh, "
        "whose triangles interpolate normals. World space, "
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
        "## Growth of cost",
        "",
        "Triangles at 512 x 512; texels and samples with 199,712 triangles, samples at 256 x 256. The exponent is the b of "
        "time = a x amount^b, by least squares of the logarithms; below 1, growth is slower than linear. Peak memory is that "
        "of the whole process, with Blender and the meshes and images of all points so far: an upper bound.",
        "",
        *table(["by", "Flatten, all", f"Flatten, largest {LARGEST}", "Cast, all", f"Cast, largest {LARGEST}"], fits),
        *table(["by", "amount", "Flatten, ms", "Cast, ms", "Flatten, peak GB", "Cast, peak GB"], lines),
        "![Growth of cost](growth.png)",
        "",
    ]


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
    return [
        "## Live",
        "",
        "Milliseconds of an update while vertices move: from the changed mesh to the map's texels in memory, and from there "
        "to the image. In brackets, the minimum and maximum of all updates.",
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
