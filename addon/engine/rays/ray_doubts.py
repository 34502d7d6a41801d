# SPDX-License-Identifier: GPL-3.0-or-later
"""What the rays of a map hit, and which of these hits are doubtful, by triangles of the low mesh."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.udim import UvToClip
from ...mesh.local_space import local_space_of
from ...mesh.triangle_mesh import Mesh
from ...passes import target
from .ray_casting import RayCast
from .unsure_texels import GAP, Explorer

STEEP = 3.0
"""A ray that turns moves its hit along the surface. The most that it moves on one surface, in times of the turn's own arc."""


@dataclass(frozen=True)
class Traced:
    """The texels of a map that lie on the low mesh, and their rays, in local space.

    triangles (N,) int: of the low mesh. directions, hits (N, 3) float32: of the rays, and the points that they hit. heights
    (N,) float32: of these points above the low surface. is_missed, is_unsure, is_doubtful (N,) bool: doubtful are misses, hits
    that their texel does not own, and what Explorer is unsure about. gap: closer hits are the same. count: of the low mesh's
    triangles.
    """

    triangles: np.ndarray
    directions: np.ndarray
    hits: np.ndarray
    heights: np.ndarray
    is_missed: np.ndarray
    is_unsure: np.ndarray
    is_doubtful: np.ndarray
    gap: float
    count: int

    def doubtful(self) -> np.ndarray:
        """How many doubtful texels each triangle has, (T,) int."""
        return self._by_triangle(self.is_doubtful)

    def lost(self, other: "Traced") -> np.ndarray:
        """How many texels get worse in `other`, by triangles (T,) int: rays miss that hit here, or hit another surface.

        The surface may change where texels are unsure here, or doubtful here and not in `other`.
        """
        arc = np.linalg.norm(self.directions - other.directions, axis=1) * np.maximum(
            np.abs(self.heights), np.abs(other.heights)
        )
        has_moved = np.linalg.norm(self.hits - other.hits, axis=1) > STEEP * arc + self.gap
        is_better = self.is_unsure | (self.is_doubtful & ~other.is_doubtful)
        return self._by_triangle(~self.is_missed & (other.is_missed | (has_moved & ~is_better)))

    def _by_triangle(self, is_counted: np.ndarray) -> np.ndarray:
        return np.bincount(self.triangles[is_counted], minlength=self.count)


def trace(ray_cast: RayCast, low: Mesh, size: tuple[int, int], views: Sequence[UvToClip]) -> Traced:
    """Cast the rays of `views`, each of width and height `size`."""
    explorer, numbers = Explorer(ray_cast, low), np.argsort(ray_cast.low.numbers)
    parts = []
    for view in views:
        doubts = explorer.doubts(size, view)
        places, away = _rays(ray_cast, size, view)
        on_low = doubts.on_low
        directions, heights = away[on_low][:, :3], doubts.heights[on_low]
        parts.append(
            (
                numbers[doubts.triangles[on_low] - 1],
                directions,
                places[on_low][:, :3] + directions * heights[:, None],
                heights,
                doubts.missed[on_low],
                doubts.unsure[on_low],
                (doubts.missed | doubts.not_owned | doubts.unsure)[on_low],
            )
        )
    gap = GAP * local_space_of([low]).size / ray_cast.ray_scene.local_space.size
    return Traced(*map(np.concatenate, zip(*parts, strict=True)), gap, len(numbers))


def _rays(ray_cast: RayCast, size: tuple[int, int], view: UvToClip) -> list[np.ndarray]:
    """Where rays begin and their directions, as RayCast.draw has them, (height, width, 4) float32 each."""
    drawn = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
    ray_cast.draw(drawn, view)
    texels = [np.empty((size[1], size[0], 4), np.float32) for _ in range(2)]
    for slot, into in enumerate(texels):
        drawn.read(into, slot)
    return texels
