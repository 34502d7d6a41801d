# SPDX-License-Identifier: GPL-3.0-or-later
"""The names of bakers, and the comparison of two runs: what became slower or faster, and whether it is beyond the spread."""

import json
import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FLATTEN, CAST, OUTERMOST, KEPT, CYCLES, MULTIRES = (
    "Imprint, Flatten",
    "Imprint, Cast",
    "Imprint, Cast, outermost hit",
    "Imprint, Cast, tree kept",
    "Cycles, selected to active",
    "Blender, multires",
)
PRESENT = "Imprint"
"""This version, where it is compared with an older one."""
ALL_SAMPLES = "Imprint, all samples"
"""This version, without adaptive samples."""
OURS = (PRESENT, ALL_SAMPLES, FLATTEN, CAST, OUTERMOST, KEPT)
"""The names of this version, by which two runs are compared."""
ASSUMED_SPREAD = 0.1
"""The share by which a measurement of less than three rounds may vary: its own rounds do not show it."""
SAME = ("processor", "cores", "renderer", "backend", "blender")
"""What a machine must share with another one for their times to be comparable."""


class NoRun(Exception):
    """A file is no result of the benchmark. Its text is the message."""


def read(path: Path) -> dict:
    """The result of a run. Raises NoRun."""
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise NoRun(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise NoRun(f"{path} is no bench.json: {error}") from error
    if not isinstance(result, dict) or not isinstance(result.get("machine"), dict):
        raise NoRun(f"{path} is no bench.json: it does not name a machine")
    return result


def measurements(result: dict) -> Iterator[tuple[str, str, list[float]]]:
    """The name, the baker and the rounds of each measurement: seconds, or bytes at the peak. Less is better for all."""
    for part, rows in result.items():
        for row in rows if isinstance(rows, list) and part != "versions" else ():
            keys = ("what", "pair", "size", "samples", "triangles")
            where = ", ".join([part, *(f"{key} {row[key]}" for key in keys if key in row)])
            for baker, timed in row.get("times", {}).items():
                yield f"{where}: {baker}", baker, timed["seconds"]
            for baker, peaks in row.get("peak_bytes", {}).items():
                yield f"{where}, peak memory: {baker}", baker, peaks
            for key, baker in (("seconds", OURS[0]), ("cycles_seconds", "Cycles")):
                if key in row:
                    yield f"{where}: {baker}", baker, [row[key]]
            for key in ("update_ms", "image_ms"):
                if key in row:
                    yield f"{where}, {key}: {OURS[0]}", OURS[0], [each / 1e3 for each in row[key]]
    for kind, points in result.get("growth", {}).items():
        for point in points:
            for baker, rounds in point["seconds"].items():
                yield f"growth by {kind}, {point['amount']:,}: {baker}", baker, rounds


@dataclass(frozen=True)
class Change:
    """A measurement in two runs. old, new: its rounds, of which less is better."""

    name: str
    old: list[float]
    new: list[float]

    @property
    def ratio(self) -> float:
        """The new median divided by the old one: above 1 is slower."""
        return statistics.median(self.new) / statistics.median(self.old)

    @property
    def is_slower(self) -> bool:
        """Whether all new rounds are slower than all old ones."""
        return _span(self.new)[0] > _span(self.old)[1]

    @property
    def is_faster(self) -> bool:
        return _span(self.new)[1] < _span(self.old)[0]

    def __str__(self) -> str:
        old, new = (f"{statistics.median(rounds):.4g}" for rounds in (self.old, self.new))
        how = "slower" if self.is_slower else "faster" if self.is_faster else "the same within the spread"
        return f"{self.ratio:5.2f}  {self.name}: {old}, now {new}, {how}"


def _span(rounds: list[float]) -> tuple[float, float]:
    """The least and the most of the rounds."""
    spread = ASSUMED_SPREAD if len(rounds) < 3 else 0.0
    return min(rounds) * (1.0 - spread), max(rounds) * (1.0 + spread)


def changes(old: dict, new: dict, *, ours: bool = True) -> list[Change]:
    """The measurements that both runs have, the slowest first. ours: of this version; otherwise of other bakers."""
    before, after = (
        {name: rounds for name, baker, rounds in measurements(result) if rounds and (baker in OURS) == ours}
        for result in (old, new)
    )
    found = [Change(name, rounds, after[name]) for name, rounds in before.items() if name in after]
    return sorted(found, key=lambda change: -change.ratio)


def lines(old: dict, new: dict) -> list[str]:
    """The comparison in words: what makes the runs hard to compare, and each measurement with the new through the old."""
    found, others = changes(old, new), changes(old, new, ours=False)
    slower, faster = sum(change.is_slower for change in found), sum(change.is_faster for change in found)
    result = [f"{slower} of {len(found)} measurements are slower beyond the spread, {faster} faster."]
    for key in SAME:
        was, now = (run["machine"].get(key) for run in (old, new))
        result += [f"Note: {key} was {was} and is {now}."] if was != now else []
    if others:
        median = statistics.median(change.ratio for change in others)
        result.append(f"Other bakers take {median:.2f} times as long as before.")
    return result + list(map(str, found))
