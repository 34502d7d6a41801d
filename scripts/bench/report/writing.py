# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of Markdown, and numbers as text."""

import statistics

from scripts.bench.report.statistics_of_rounds import ratios

GAP = "–"


def span(ratio: dict[str, float], digits: int = 2) -> str:
    """A median with the minimum and maximum of its rounds."""
    return f"{ratio['median']:.{digits}f} ({ratio['least']:.{digits}f} to {ratio['most']:.{digits}f})"


def table(head: list[str], rows: list[list]) -> list[str]:
    """A Markdown table, as lines."""
    return [f"| {' | '.join(map(str, line))} |" for line in (head, ["---"] * len(head), *rows)] + [""]


def milliseconds(timed: dict | None) -> str:
    """A contender's median with the minimum and maximum of its rounds, or a gap."""
    if not timed or not timed["seconds"]:
        return GAP
    rounds = [1000.0 * second for second in timed["seconds"]]
    return f"{statistics.median(rounds):,.0f} ({min(rounds):,.0f} to {max(rounds):,.0f})"


def seconds(timed: dict) -> str:
    """As `milliseconds`, in seconds."""
    rounds = timed["seconds"]
    return f"{statistics.median(rounds):.2f} ({min(rounds):.2f} to {max(rounds):.2f})" if rounds else GAP


def ratio(row: dict, slower: str, faster: str) -> str:
    found = ratios(row, slower, faster)
    return span(found, 1 if found["median"] >= 10.0 else 2) if found else GAP
