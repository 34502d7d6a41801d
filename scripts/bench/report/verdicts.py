# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares measurements with targets. A target holds if all rounds reach it; if only some do, it is open."""

from dataclasses import dataclass

from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN, MULTIRES, OUTERMOST, PEERS
from scripts.bench.report.statistics_of_rounds import exponents, ratios
from scripts.bench.report.writing import span

HOLDS, OPEN, MISSED, GAP = "holds", "open", "missed", "not measured"
ORDER = (MISSED, OPEN, HOLDS, GAP)
FINEST = 0.01
"""Two maps whose errors differ by less than these degrees are equally exact. 8 bits resolve 0.4 degrees, 16 bits 0.002."""
LARGEST = 3
"""Growth must be linear over this many of the largest points."""


@dataclass(frozen=True)
class Verdict:
    """A target, its state (HOLDS, OPEN, MISSED or GAP), and the figures behind it."""

    target: str
    outcome: str
    figures: str


def at_least(target: str, wanted: float, found: list[tuple[str, dict[str, float] | None]]) -> Verdict:
    """Check that all ratios, with their names, are at least `wanted`. Ratios that are None are ignored."""
    found = [(name, ratio) for name, ratio in found if ratio]
    if not found:
        return Verdict(target, GAP, "Nothing was measured to compare with")
    missed = [(name, ratio) for name, ratio in found if ratio["most"] < wanted]
    unsure = [(name, ratio) for name, ratio in found if ratio["least"] < wanted <= ratio["most"]]
    outcome = MISSED if missed else OPEN if unsure else HOLDS
    medians = [ratio["median"] for _, ratio in found]
    held = len(found) - len(missed) - len(unsure)
    figures = f"{held} of {len(found)} hold, {min(medians):.2f} to {max(medians):.2f} times faster"
    for word, group in (("missed", missed), ("open", unsure)):
        if group:
            figures += f"; {word}: " + ", ".join(f"{name} {span(ratio)}" for name, ratio in group)
    return Verdict(target, outcome, figures)


def judge(result: dict) -> list[Verdict]:
    """The verdicts for all targets, missed ones first. result: from run.py."""
    return sorted(_all(result), key=lambda verdict: ORDER.index(verdict.outcome))


def _all(result: dict) -> list[Verdict]:
    rows = [*result.get("pairs", []), *result.get("closed_forms", [])]
    several = [row for row in rows if row["samples"] > 1]
    rows = [row for row in rows if row["samples"] == 1]

    def against(slower: str, faster: str, chosen: list[dict]) -> list[tuple[str, dict[str, float] | None]]:
        return [(f"{row['pair']} at {row['size']}", ratios(row, slower, faster)) for row in chosen]

    terrains = [row for row in rows if row["is_terrain"] and row["size"] == 2048]
    sculpts = [row for row in result.get("closed_forms", []) if MULTIRES in row["times"]]
    return [
        at_least("Flatten 10 times faster than Cycles, terrains at 2048", 10.0, against(CYCLES, FLATTEN, terrains)),
        at_least("Flatten no slower than Blender's multires bake", 1.0, against(MULTIRES, FLATTEN, sculpts)),
        at_least("Cast no slower than Cycles, with a new tree for each bake", 1.0, against(CYCLES, CAST, rows)),
        at_least("Cast no slower than Cycles with several samples per texel", 1.0, against(CYCLES, CAST, several)),
        at_least("Cast twice as fast as Cycles, terrains at 2048", 2.0, against(CYCLES, CAST, terrains)),
        at_least(
            "Cast's own hits take at most 1.6 times as long as outermost ones", 1 / 1.6, against(OUTERMOST, CAST, rows)
        ),
        at_least("Cast faster than Open3D", 1.0, against(PEERS["open3d"], CAST, rows)),
        *(accuracy(row) for row in result.get("closed_forms", [])),
        *(
            linear(kind, points, name)
            for kind, points in result.get("growth", {}).items()
            if kind != "samples"
            for name in (FLATTEN, CAST)
        ),
    ]


def accuracy(row: dict) -> Verdict:
    """Check that Imprint is as accurate as the best other baker, at the 99th percentile."""
    ours = {name: degrees["percentile_99"] for name, degrees in row["angles"].items() if name in (FLATTEN, CAST)}
    theirs = {name: degrees["percentile_99"] for name, degrees in row["angles"].items() if name not in ours}
    target = f"As exact as the best other baker, within {FINEST} degrees, {row['pair']}"
    if not ours or not theirs:
        return Verdict(target, GAP, "Nothing was measured to compare with")
    best = min(theirs, key=theirs.get)
    figures = ", ".join(f"{name} {degrees:.4f}" for name, degrees in {**ours, best: theirs[best]}.items())
    outcome = HOLDS if max(ours.values()) <= theirs[best] + FINEST else MISSED
    return Verdict(target, outcome, f"99th percentile of degrees: {figures}")


def linear(kind: str, points: list[dict], name: str) -> Verdict:
    """Check that time grows at most linearly over the largest points."""
    found = exponents(points, name, LARGEST)
    outcome = HOLDS if found["most"] <= 1.0 else OPEN if found["least"] <= 1.0 else MISSED
    return Verdict(f"{name}: time grows at most linearly with {kind}", outcome, f"exponent {span(found)}")
