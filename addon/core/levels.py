# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail, as plain data: their limits in texts, and the report of a chain."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from .errors import BakeError
from .report import Report
from .simplify import LEAST, Limit

MOST = 12
"""The most levels of a chain."""
DEGREES, PERCENT = "1, 2, 4", "1"
"""The usual limits. Without one for the distance, a relief could become flat: its map shows it from straight above."""


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
    limits = []
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
        limits.append(Limit(triangles=number))
    if not 0 < len(limits) <= MOST:
        raise BakeError(f"{len(limits)} levels are not possible: give 1 to {MOST} numbers of triangles.")
    return limits


def _numbers(text: str, what: str, most: float) -> list[float]:
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise BakeError(f"{text!r} are not {what}: give numbers, as {DEGREES}.") from error
    wrong = next((number for number in values if not 0.0 < number <= most), None)
    if wrong is not None:
        raise BakeError(f"{wrong:g} {what} cannot be a limit: give numbers above 0, up to {most:g}.")
    return values


@dataclass(frozen=True)
class Level:
    """One level of a chain.

    Attributes:
        name: Of its object.
        limit: What it may deviate.
        degrees, bare_degrees, distance: As in texel_judge.Deviations.
        beyond: The number of triangles of the coarser mesh that was measured beyond the limit, 0 if there is no coarser one.
        beyond_degrees, beyond_distance: Of that mesh.
        bake: The report of its map.
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
    """The results of a chain.

    Attributes:
        original: The name of its object.
        measured: How many meshes were measured.
        triangles: Of the mesh that the levels are made of.
        collection: The name of the collection that holds the levels.
        seconds: Of all.
        warnings: Sentences.
    """

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
