# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares two runs of the benchmark: what became slower or faster, and whether that is more than the spread."""

import json
import statistics
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from scripts.bench.report import figures_of_a_run

ASSUMED_SPREAD = 0.1
"""The share by which a figure of less than three rounds may vary: its own rounds do not show it."""


class NoRun(Exception):
    """A file is no result of the benchmark. Its text is the message."""


@dataclass(frozen=True)
class Change:
    """A figure in two runs. old, new: its rounds, of which less is better."""

    name: str
    old: list[float]
    new: list[float]

    @property
    def ratio(self) -> float:
        """The new median through the old one: above 1 is slower."""
        return statistics.median(self.new) / statistics.median(self.old)

    @property
    def is_slower(self) -> bool:
        """Whether all new rounds are slower than all old ones."""
        return _span(self.new)[0] > _span(self.old)[1]

    @property
    def is_faster(self) -> bool:
        return _span(self.new)[1] < _span(self.old)[0]

    def __str__(self) -> str:
        how = "beyond" if self.is_slower or self.is_faster else "within"
        word, times = ("slower", self.ratio) if self.ratio >= 1.0 else ("faster", 1.0 / self.ratio)
        return f"{self.name}: {_shown(self.old)}, now {_shown(self.new)}, {times:.2f} times {word}, {how} the spread"


def _span(rounds: list[float]) -> tuple[float, float]:
    """The least and the most of the rounds."""
    if len(rounds) < 3:
        return min(rounds) * (1.0 - ASSUMED_SPREAD), max(rounds) * (1.0 + ASSUMED_SPREAD)
    return min(rounds), max(rounds)


def _shown(rounds: list[float]) -> str:
    """A median with the minimum and maximum of its rounds; peaks of memory in GB."""
    middle = statistics.median(rounds)
    unit, scale = ("GB", 1e-9) if middle > 1e6 else ("s", 1.0) if middle >= 1.0 else ("ms", 1e3)
    values = [scale * value for value in (middle, min(rounds), max(rounds))]
    return "{:.3g} {} ({:.3g} to {:.3g})".format(values[0], unit, *values[1:])


@dataclass(frozen=True)
class Comparison:
    """Two runs. changes: the figures that both have, the slowest first. only_old, only_new: the names of the others.

    others: the ratio of the medians of the bakers that are not Imprint. warnings: what makes the runs hard to compare.
    """

    changes: list[Change]
    only_old: list[str]
    only_new: list[str]
    others: list[float]
    warnings: list[str]

    @property
    def has_slower(self) -> bool:
        return any(change.is_slower for change in self.changes)

    def lines(self) -> list[str]:
        """The comparison in words, what became slower first."""
        slower = [change for change in self.changes if change.is_slower]
        faster = [change for change in self.changes if change.is_faster]
        same = [change for change in self.changes if not (change.is_slower or change.is_faster)]
        lines = [
            f"{len(slower)} of {len(self.changes)} figures are slower beyond the spread, {len(faster)} faster, "
            f"{len(same)} within it.",
            *(f"Note: {warning}." for warning in self.warnings),
        ]
        if self.others:
            spread = f"{min(self.others):.2f} to {max(self.others):.2f}"
            lines.append(f"Other bakers take {statistics.median(self.others):.2f} ({spread}) times as long as before.")
        for title, group in (("Slower", slower), ("Faster", faster[::-1]), ("Within the spread", same)):
            lines += _list(title, map(str, group))
        return lines + _list("Only in the old run", self.only_old) + _list("Only in the new run", self.only_new)


def _list(title: str, lines: Iterable[str]) -> list[str]:
    entries = [f"  {line}" for line in lines]
    return [f"{title}:", *entries] if entries else []


def compare(old: dict, new: dict) -> Comparison:
    """Compare two results of the benchmark, as bench.json has them."""
    before, after = figures_of_a_run.figures(old), figures_of_a_run.figures(new)
    changes = [Change(name, rounds, after[name]) for name, rounds in before.items() if name in after]
    theirs, theirs_now = (figures_of_a_run.figures(result, ours=False) for result in (old, new))
    others = [Change(name, rounds, theirs_now[name]).ratio for name, rounds in theirs.items() if name in theirs_now]
    return Comparison(
        sorted(changes, key=lambda change: -change.ratio),
        [name for name in before if name not in after],
        [name for name in after if name not in before],
        others,
        figures_of_a_run.differences(old, new),
    )


def read(path: Path) -> dict:
    """The result of a run. Raises NoRun."""
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise NoRun(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise NoRun(f"{path} is no bench.json: {error}") from error
    if not isinstance(result, dict) or not isinstance(result.get("machine"), dict) or "quick" not in result:
        raise NoRun(f"{path} is no bench.json: it does not name a machine")
    return result
