# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail, as plain data: limits, the search for the coarsest mesh within one, and the report of a chain."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Protocol, TypeVar

from .errors import BakeError
from .progress import Task
from .report import Report

MOST = 12
"""The most levels of a chain."""
DEGREES, PERCENT = "1, 2, 4", "1"
"""The usual limits. Without one for the distance, a relief could become flat: its map shows it from straight above."""


@dataclass(frozen=True)
class Limit:
    """What a level may deviate, infinite for no limit. degrees: of normals. distance: a share of the longest side.

    triangles: how many it has, whatever it deviates; up to 1 a share of those of the mesh, and 0 for as few as possible.
    """

    degrees: float = math.inf
    distance: float = math.inf
    triangles: float = 0.0

    def wanted(self, triangles: int) -> int:
        """How many triangles a level of a mesh of so many has."""
        return max(LEAST, round(self.triangles * triangles if self.triangles <= 1.0 else self.triangles))

    def excess(self, degrees: float, distance: float) -> float:
        """How much of the limit these deviations take: more than 1 if they are beyond it."""
        return max(degrees / self.degrees, distance / self.distance)

    def __str__(self) -> str:
        if self.triangles:
            is_share = self.triangles <= 1.0
            return f"{100.0 * self.triangles:g} % of the triangles" if is_share else f"{self.triangles:,.0f} triangles"
        parts = [f"{self.degrees:g} degrees"] * (self.degrees < math.inf)
        return ", ".join(parts + [f"{100.0 * self.distance:g} % of the size"] * (self.distance < math.inf))


def limits(degrees: str, percent: str = "", triangles: str = "") -> list[Limit]:
    """The limits in two lists of numbers, separated by commas: in degrees, and in percent of the size.

    One list may be empty. A single number counts with each of the other list. With `triangles`, both do not count, and the
    limits are its `counts`. Raises BakeError.
    """
    if triangles.strip():
        return counts(triangles)
    angles, distances = _numbers(degrees, "degrees", 180.0), _numbers(percent, "percent of the size", 100.0)
    count = max(len(angles), len(distances))
    if not count:
        raise BakeError("No limit is set: give at least one number of degrees, or percent of the size.")
    if count > MOST:
        raise BakeError(f"{count} levels are too many: give at most {MOST} limits.")
    if min(len(angles), len(distances)) not in {0, 1, count}:
        raise BakeError(
            f"{len(angles)} angles and {len(distances)} distances make no pairs: give one, or as many as of the other."
        )
    angles, distances = (
        values * count if len(values) == 1 else values or [math.inf] * count for values in (angles, distances)
    )
    return [Limit(angle, distance / 100.0) for angle, distance in zip(angles, distances, strict=True)]


def counts(text: str) -> list[Limit]:
    """Limits from numbers of triangles, separated by commas: each a number, or a share with %. Raises BakeError."""
    found = []
    for word in filter(None, (part.strip() for part in text.split(","))):
        try:
            number = float(word.removesuffix("%")) / (100.0 if word.endswith("%") else 1.0)
        except ValueError as error:
            raise BakeError(
                f"{word!r} is no number of triangles: give numbers or shares, as 50 %, 25 %, 500."
            ) from error
        if not (0.0 < number < 1.0 if word.endswith("%") else LEAST <= number < math.inf):
            raise BakeError(
                f"{word} cannot be a number of triangles: give {LEAST} or more, or a share between 0 and 100 %."
            )
        found.append(Limit(triangles=number))
    if not 0 < len(found) <= MOST:
        raise BakeError(f"{len(found)} levels are not possible: give 1 to {MOST} numbers of triangles.")
    return found


def _numbers(text: str, what: str, most: float) -> list[float]:
    try:
        found = [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise BakeError(f"{text!r} are not {what}: give numbers, as {DEGREES}.") from error
    wrong = next((number for number in found if not 0.0 < number <= most), None)
    if wrong is not None:
        raise BakeError(f"{wrong:g} {what} cannot be a limit: give numbers above 0, up to {most:g}.")
    return found


@dataclass(frozen=True)
class Level:
    """One level of a chain.

    name: of its object. limit: what it may deviate. degrees, bare_degrees, distance: as in level_judge.Deviations.
    beyond: the number of triangles of the coarser mesh that was measured beyond the limit, 0 if there is no coarser one.
    beyond_degrees, beyond_distance: of that mesh. bake: the report of its map.
    """

    name: str
    limit: Limit
    triangles: int
    degrees: float
    bare_degrees: float
    distance: float
    beyond: int = 0
    beyond_degrees: float = 0.0
    beyond_distance: float = 0.0
    bake: Report | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for json.dump, without the report of the map."""
        values = asdict(replace(self, bake=None))
        del values["bake"]
        values["limit"] = {name: amount for name, amount in values["limit"].items() if 0.0 < amount < math.inf}
        return values


@dataclass(frozen=True)
class ChainReport:
    """The results of a chain. original: the name of its object. measured: how many meshes were measured."""

    original: str
    triangles: int
    collection: str
    levels: Sequence[Level]
    measured: int
    seconds: float
    warnings: list[str] = field(default_factory=list)

    @property
    def left_out(self) -> list[str]:
        """The warnings that are not of a map: limits that have no level of their own."""
        of_maps = {warning for level in self.levels if level.bake is not None for warning in level.bake.warnings}
        return [warning for warning in self.warnings if warning not in of_maps]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for json.dump, without what the reports of the maps have."""
        levels = [level.to_dict() for level in self.levels]
        whole = {"original": self.original, "triangles": self.triangles, "collection": self.collection}
        return {**whole, "levels": levels, "measured": self.measured}

    def table(self) -> list[str]:
        """Lines of a table: angles and distances at the 99th percentile of texels."""
        head = ("level", "limit", "triangles", "share", "degrees", "without map", "distance", "5 % fewer")
        rows = [head, (self.original, "", f"{self.triangles:,}", "100 %", "", "", "", "")]
        rows += [
            (
                level.name,
                str(level.limit),
                f"{level.triangles:,}",
                _percent(level.triangles / self.triangles, 1),
                f"{level.degrees:.2f}",
                f"{level.bare_degrees:.1f}",
                _percent(level.distance, 3),
                self._beyond(level),
            )
            for level in self.levels
        ]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return [
            "  ".join(
                word.ljust(width) if number < 2 else word.rjust(width)
                for number, (word, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in rows
        ]

    def summary(self) -> list[str]:
        """Lines for the user."""
        lines = [
            f"{level.name}: {level.triangles:,} of {self.triangles:,} triangles, {level.degrees:.2f} degrees and "
            f"{_percent(level.distance, 3)} of the size at the 99th percentile"
            for level in self.levels
        ]
        return [*lines, f"{self.measured} meshes were measured in {self.seconds:.1f} s"]

    @staticmethod
    def _beyond(level: Level) -> str:
        if level.limit.triangles:
            return ""
        if not level.beyond:
            return "borders"
        if level.beyond_degrees > level.limit.degrees:
            return f"{level.beyond:,}: {level.beyond_degrees:.2f}"
        return f"{level.beyond:,}: {_percent(level.beyond_distance, 3)}"


def _percent(share: float, digits: int) -> str:
    return f"{100.0 * share:.{digits}f} %"


STRIDE = 0.5
"""The share of triangles that the first steps leave. After a step beyond the limit, they become smaller."""
FAR = 1.6
"""The excess from which a step is taken for much too large."""
FEWER = 0.95
"""The share of triangles that the last step leaves: a search ends when this one is beyond the limit."""
LEAST = 4
"""The fewest triangles that enclose a volume. No coarser mesh is looked for."""
ODD = 2
"""The triangles that an edge inside a mesh takes along when it collapses."""


class Measured(Protocol):
    """A mesh that was measured. excess: how much of the limit it takes, more than 1 beyond it. spent: the share of texels that
    are beyond it, of which a few may be."""

    triangles: int
    excess: float
    spent: float


Candidate = TypeVar("Candidate", bound=Measured)


def search(
    start: Candidate, attempt: Callable[[Candidate, int, bool], Task[Sequence[Candidate]]], share: float = STRIDE
) -> Task[tuple[Candidate, Candidate | None]]:
    """The coarsest mesh within the limit, and the mesh with FEWER of its triangles that is beyond it; None if there is none.

    start: a mesh within the limit. attempt: makes coarser meshes of one of about as many triangles as it is given, in one or
    several ways, or with more if it cannot; it is also told whether the step is the last one. share: of triangles, that the
    first step leaves.
    """
    within = start
    while True:
        wanted = max(min(int(share * within.triangles), within.triangles - ODD), LEAST)
        made = yield from attempt(within, wanted, share >= FEWER)
        coarser = [each for each in made if each.triangles < within.triangles]
        good = [each for each in coarser if each.excess <= 1.0]
        if good:
            within = min(good, key=lambda each: (each.spent, each.excess))
        elif share >= FEWER:
            return within, min(coarser, key=lambda each: each.excess, default=None)
        else:
            is_far = min((each.excess for each in coarser), default=1.0) > FAR
            share = min(share ** (0.25 if is_far else 0.5), FEWER)


TRIES = 16
"""The most meshes that are made for the fewest triangles."""
CLOSER = 1.5
"""The least factor between the numbers of triangles of two tries before one is within the limit and one beyond it."""


def fewest(
    first: int, most: int, attempt: Callable[[int], Task[Candidate]]
) -> Task[tuple[Candidate | None, Candidate | None]]:
    """The mesh with the fewest triangles within a limit, and the one with more than FEWER of them that is beyond it.

    Each is None if there is none. To be used where each mesh is made anew, of any number of triangles.

    Args:
        first: the triangles of the first try.
        most: the most of any.
        attempt: makes a mesh of about as many triangles.
    """
    within, beyond, wanted = None, None, min(first, most)
    for _ in range(TRIES):
        found = yield from attempt(wanted)
        if found.excess <= 1.0:
            if within is not None and found.triangles >= within.triangles:
                break  # there is no coarser mesh
            within = found
        else:
            beyond = found
        if within is None:
            if wanted >= most:
                break
            wanted = min(most, int(wanted * min(max(found.excess**2, CLOSER), 4.0)) + 1)
        elif beyond is None or beyond.triangles >= within.triangles:
            wanted = max(LEAST, int(within.triangles / min(max(found.excess**-2.0, CLOSER), 4.0)))
            if wanted >= within.triangles:
                break
        elif beyond.triangles >= FEWER * within.triangles - ODD:
            break
        else:
            wanted = _between(beyond, within)
    return within, beyond


def _between(beyond: Measured, within: Measured) -> int:
    """The triangles at which a straight line of logarithms meets the limit, but not close to either end."""
    low, high = math.log(beyond.triangles), math.log(within.triangles)
    above, below = math.log(beyond.excess), -math.log(max(within.excess, 1e-6))
    share = above / max(above + below, 1e-6)
    step = min(0.5 * (high - low), -math.log(FEWER) * 0.9)
    return round(math.exp(min(max(low + share * (high - low), low + step), high - step)))
