# SPDX-License-Identifier: GPL-3.0-or-later
"""Searches the coarsest meshes of an object within limits, each made step by step from finer ones that were measured."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ...core import levels
from ...core.errors import BakeError
from ...core.levels import Level, Limit
from ...core.progress import Pace, Progress, Task, part
from ...core.settings import Settings
from .. import decimation
from ..decimation import Source
from . import deviation_measuring
from .deviation_measuring import Deviations


@dataclass(frozen=True, eq=False)
class Candidate:
    """A mesh that was measured. excess, spent: as levels.Measured has them. is_beyond (height, width) bool: the texels whose
    normals are beyond the limit."""

    source: Source
    deviations: Deviations
    limit: Limit

    @property
    def triangles(self) -> int:
        return self.source.triangles

    @property
    def excess(self) -> float:
        return self.limit.excess(self.deviations.degrees, self.deviations.distance)

    @property
    def is_beyond(self) -> np.ndarray:
        return self.deviations.by_texel > self.limit.degrees

    @property
    def spent(self) -> float:
        return float(self.is_beyond.mean())


class LevelSearch:
    """Searches levels of one mesh. Call `measure_original` first. count: how many meshes were measured."""

    def __init__(self, original: Source, settings: Settings, pace: Pace, meshes: decimation.Meshes):
        self.original, self.pace, self.meshes, self.count = original, pace, meshes, 0
        self.settings = deviation_measuring.settings_for(settings)
        self._found: list[tuple[Source, Deviations]] = []
        """The original, and the levels that were found: a search starts from the coarsest within its limit."""

    def measure_original(self) -> Task[None]:
        """Measure the original with its own map. Raises BakeError if it has no texel on the map."""
        self._found.append((self.original, (yield from self._measured(self.original))))

    def coarsest(self, limit: Limit) -> Task[tuple[bpy.types.Mesh, Level]]:
        """The coarsest mesh within a limit. Raises BakeError."""
        known = [Candidate(*found, limit) for found in self._found]
        original = known[0]
        if original.excess > 1.0:
            raise BakeError(
                f"The map of {self.original.surface.name!r} alone deviates by {original.deviations.degrees:.2f} degrees: allow "
                f"more than {limit}, or store more bits."
            )
        start = min((each for each in known if each.excess <= 1.0), key=lambda each: each.triangles)
        made: list[Candidate] = []
        within, beyond = yield from levels.search(start, self._attempts(limit, made))
        self._keep(within, made)
        self._found.append((within.source, within.deviations))
        found, other = within.deviations, beyond and beyond.deviations
        of_beyond = (beyond.triangles, other.degrees, other.distance) if beyond else ()
        level = Level("", limit, within.triangles, found.degrees, found.bare_degrees, found.distance, *of_beyond)
        return within.source.data, level

    def _attempts(self, limit: Limit, made: list[Candidate]) -> Callable[[Candidate, int, bool], Task[list[Candidate]]]:
        """Makes the candidates of a step, as levels.search takes it. made: those that exist; the others are removed.

        A step is done again without touching the triangles whose texels came to lie beyond the limit: narrow bevels keep their
        triangles while the rest becomes coarser. Where that leaves too few triangles to remove, or before a search ends, a step
        is done with all triangles free.
        """
        frozen = np.zeros((self.settings.sampling.height, self.settings.sampling.width), bool)
        shares = self._shares()

        def attempt(base: Candidate, wanted: int, is_last: bool) -> Task[list[Candidate]]:
            nonlocal frozen
            self._keep(base, made)
            start, stop = next(shares)

            def coarser(number: int, texels: np.ndarray) -> Task[Candidate]:
                ends = (start + (stop - start) * share / 3.0 for share in (number, number + 1))
                return part(self._coarser(base, wanted, texels, limit, made), *ends)

            def has_good() -> bool:
                return any(each.excess <= 1.0 and each.triangles < base.triangles for each in result)

            result = [(yield from coarser(0, frozen))]
            has_room = result[0].triangles <= wanted + levels.ODD
            more = frozen | result[0].is_beyond
            if has_room and (more & ~frozen).any():
                result.append((yield from coarser(1, more)))
            if has_good():
                frozen = more
            elif frozen.any() and (is_last or not has_room):
                result.append((yield from coarser(2, np.zeros_like(frozen))))
                frozen = np.zeros_like(frozen) if has_good() else frozen
            return result

        return attempt

    @staticmethod
    def _shares() -> Iterator[tuple[float, float]]:
        """Shares of a search, whose number of steps is not known."""
        left = 1.0
        while True:
            yield 1.0 - left, 1.0 - 0.9 * left
            left *= 0.9

    def _coarser(
        self, base: Candidate, wanted: int, frozen: np.ndarray, limit: Limit, made: list[Candidate]
    ) -> Task[Candidate]:
        """A mesh of about `wanted` triangles: with UVs that are moved, or without if those are beyond the limit and this is
        better."""
        source, found = base.source, []
        is_frozen = decimation.frozen_vertices(source, frozen)
        for moved_to in (self.original.data, None):
            yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
            data = self.meshes.own(decimation.coarser(source, wanted, is_frozen, moved_to))
            coarser = decimation.of_mesh(data, source.layer, source.surface.name, source.surface.to_world)
            found.append(Candidate(coarser, (yield from self._measured(coarser)), limit))
            made.append(found[-1])
            if found[-1].excess <= 1.0:
                break
        return min(found, key=lambda each: each.excess)

    def _keep(self, kept: Candidate, made: list[Candidate]) -> None:
        """Remove all meshes of `made` but one."""
        for each in made:
            if each is not kept:
                self.meshes.remove(each.source.data)
        made[:] = [each for each in made if each is kept]

    def _measured(self, source: Source) -> Task[Deviations]:
        self.count += 1
        found = yield from deviation_measuring.measure(
            self.original.surface, source.data, source.layer, self.settings, self.pace
        )
        if found is None:
            raise BakeError(
                f"No triangle of {self.original.surface.name!r} lies on the map: its UVs are outside 0 to 1, or empty."
            )
        return found
