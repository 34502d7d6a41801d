# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares measurements with targets. A target holds if all rounds reach it; if only some do, it is open."""

import statistics
from dataclasses import dataclass

from scripts.bench.contenders.names import CAST, FLATTEN
from scripts.bench.report.statistics_of_rounds import exponents
from scripts.bench.report.writing import span

HOLDS, OPEN, MISSED, GAP = "holds", "open", "missed", "not measured"
ORDER = (MISSED, OPEN, HOLDS, GAP)
FINEST = 0.01
"""Two maps whose errors differ by less than these degrees are equally exact. 8 bits resolve 0.4 degrees, 16 bits 0.002."""
LARGEST = 3
"""Growth must be linear over this many of the largest points."""
STEEPEST = 1.05
"""The largest exponent of growth that counts as linear."""


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
    outcome = HOLDS if found["most"] <= STEEPEST else OPEN if found["least"] <= STEEPEST else MISSED
    return Verdict(
        f"{name}: time grows at most linearly with {kind}, exponent {STEEPEST}", outcome, f"exponent {span(found)}"
    )


def at_most(target: str, most: float, found: list[tuple[str, list[float]]], unit: str) -> Verdict:
    """Check that the rounds of all figures, with their names, are at most `most`."""
    found = [(name, rounds) for name, rounds in found if rounds]
    if not found:
        return Verdict(target, GAP, "Nothing was measured")
    missed = [name for name, rounds in found if min(rounds) > most]
    unsure = [name for name, rounds in found if min(rounds) <= most < max(rounds)]
    outcome = MISSED if missed else OPEN if unsure else HOLDS
    shown = (
        f"{name} {statistics.median(rounds):.4g} {unit} ({min(rounds):.4g} to {max(rounds):.4g})"
        for name, rounds in found
        if outcome == HOLDS or name in (missed or unsure)
    )
    return Verdict(target, outcome, ", ".join(shown))
