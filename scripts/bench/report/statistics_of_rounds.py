# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures of several rounds: ratios, exponents, and their spread."""

import statistics

import numpy as np

from scripts.bench.contenders.names import PRESENT


def exponents(points: list[dict], name: str, last: int | None = None) -> dict[str, float]:
    """The b of seconds = a * amount ** b, by least squares of the logarithms: of the medians, and its range over rounds.

    last: use only this many of the largest points, where the constant cost of a bake hides the growth least.
    """
    points = points[-last:] if last else points
    amounts = np.log([point["amount"] for point in points])
    rounds = np.array([point["seconds"][name] for point in points])

    def fitted(seconds: np.ndarray) -> float:
        return float(np.polyfit(amounts, np.log(seconds), 1)[0])

    each = [fitted(column) for column in rounds.T]
    return {"median": fitted(np.median(rounds, axis=1)), "least": min(each), "most": max(each)}


def ratios(row: dict, slower: str, faster: str) -> dict[str, float] | None:
    """The speedup: the ratio of the medians, and the minimum and maximum of the rounds. None for a gap."""
    theirs, ours = (row["times"].get(name, {}).get("seconds") for name in (slower, faster))
    if not theirs or not ours:
        return None
    each = [a / b for a, b in zip(theirs, ours, strict=True)]
    return {"median": statistics.median(theirs) / statistics.median(ours), "least": min(each), "most": max(each)}


def older_name(row: dict) -> str | None:
    """The name of the older version of Imprint in a row that compares versions, if it was measured."""
    return next((name for name in row["times"] if name.startswith(f"{PRESENT} ")), None)
