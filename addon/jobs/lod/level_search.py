# SPDX-License-Identifier: GPL-3.0-or-later
"""Searches the coarsest meshes of an object within limits, and measures each candidate once."""

from collections.abc import Iterator

import bpy

from ...core.errors import BakeError
from ...core.levels import coarsest
from ...core.levels.coarsest import Tried
from ...core.levels.level_report import Level, Limit
from ...core.progress import Pace, Progress, Task, part
from ...core.settings import Settings
from . import decimation, deviation_measuring
from .decimation import Original
from .deviation_measuring import Deviations

VARIANTS = (True, False)
"""Whether UVs are moved. Mostly that is better; where it is not, a level keeps the UVs that collapsing edges gives."""
Candidate = tuple[int, Deviations, bool]
"""A number of triangles, what was measured, and which of VARIANTS it is."""


class LevelSearch:
    """Searches levels of one mesh. Call `measure_original` first. count: how many meshes were measured."""

    def __init__(self, original: Original, settings: Settings, pace: Pace, meshes: decimation.Meshes):
        self.original, self.pace, self.meshes, self.count = original, pace, meshes, 0
        self.settings = deviation_measuring.settings_for(settings)
        self._known: dict[tuple[int, bool], Candidate] = {}
        """The candidates by the number of triangles that was asked for, and their variant."""

    def measure_original(self) -> Task[None]:
        """Measure the original with its own map. Raises BakeError if it has no texel on the map."""
        data = self.meshes.own(self.original.data.copy())
        self.own = yield from self._measured(data)

    def coarsest(self, limit: Limit) -> Task[tuple[bpy.types.Mesh, Level]]:
        """The coarsest mesh within a limit. Raises BakeError."""
        name, most = self.original.surface.name, self.original.triangles
        own = _excess(limit, self.own)
        if own > 1.0:
            raise BakeError(
                f"The map of {name!r} alone deviates by {self.own.degrees:.2f} degrees: allow more than {limit}, or store more "
                "bits."
            )
        best: dict[int, Candidate] = {most: (most, self.own, False)}
        tried = Tried({most: own})

        def learn(found: list[Candidate]) -> int:
            candidate = min(found, key=lambda each: _excess(limit, each[1]))
            best[candidate[0]] = candidate
            tried.values[candidate[0]] = _excess(limit, candidate[1])
            return candidate[0]

        for wanted in {wanted for wanted, _ in self._known}:
            found = [self._known[wanted, variant] for variant in VARIANTS if (wanted, variant) in self._known]
            if len(found) == len(VARIANTS) or _are_within(limit, found):
                learn(found)
        steps = self._steps()

        def attempt(wanted: int) -> Task[int]:
            found, (start, stop) = [], next(steps)
            for variant in VARIANTS:
                found.append((yield from part(self._candidate(wanted, variant), start, stop)))
                if _are_within(limit, found):
                    break
            return learn(found)

        result = yield from coarsest.search(tried, 1.0, attempt)
        number, deviations, moves_uvs = best[result.triangles]
        yield Progress(f"Making {name}", 1.0)
        data = self.meshes.own(self._made(number, moves_uvs))
        beyond = best[result.beyond][1] if result.beyond else Deviations(0.0, 0.0, 0.0, 0)
        level = Level(
            "",
            limit,
            number,
            deviations.degrees,
            deviations.bare_degrees,
            deviations.distance,
            result.beyond,
            beyond.degrees,
            beyond.distance,
        )
        return data, level

    @staticmethod
    def _steps() -> Iterator[tuple[float, float]]:
        """Shares of a search, whose number of steps is not known."""
        left = 1.0
        while True:
            yield 1.0 - left, 1.0 - 0.8 * left
            left *= 0.8

    def _candidate(self, wanted: int, moves_uvs: bool) -> Task[Candidate]:
        """Make and measure a mesh of about `wanted` triangles."""
        if (wanted, moves_uvs) not in self._known:
            yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
            data = self.meshes.own(self._made(wanted, moves_uvs))
            number = len(data.polygons)
            self._known[wanted, moves_uvs] = number, (yield from self._measured(data)), moves_uvs
        return self._known[wanted, moves_uvs]

    def _made(self, wanted: int, moves_uvs: bool) -> bpy.types.Mesh:
        return decimation.coarser(self.original, wanted, self.original.layer, moves_uvs=moves_uvs)

    def _measured(self, data: bpy.types.Mesh) -> Task[Deviations]:
        """Measure a mesh and remove it."""
        self.count += 1
        original = self.original
        found = yield from deviation_measuring.measure(original.surface, data, original.layer, self.settings, self.pace)
        self.meshes.remove(data)
        if found is None:
            raise BakeError(
                f"No triangle of {original.surface.name!r} lies on the map: its UVs are outside 0 to 1, or empty."
            )
        return found


def _excess(limit: Limit, deviations: Deviations) -> float:
    return limit.excess(deviations.degrees, deviations.distance)


def _are_within(limit: Limit, found: list[Candidate]) -> bool:
    return any(_excess(limit, deviations) <= 1.0 for _, deviations, _ in found)
