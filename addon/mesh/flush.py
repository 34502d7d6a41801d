# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes solids touch exactly that touch but for rounding, as boards do that are objects of their own under a turned parent.

Corners of them that were in one place differ, and turned planes are none in single precision: a corner that lies on the face of
another board lies above or below it. So corners are joined first, and then all points are given along axes across the largest
planes, where what is in one plane has one coordinate.
"""

from dataclasses import dataclass

import numpy as np

from . import topology
from .triangles import unit, unit_normals

STEPS = 8.0
"""The steps of single precision, at the largest coordinate, up to which places are the same. Measured: corners of boards below
parents that are turned, scaled and moved at random, some turned by 90 degrees themselves, differ by 1.6."""
ALIKE = 1e-3
"""How far products of unit normals differ that are counted as one direction."""
LEAST_APART = 0.1
"""The volume between three unit normals from which they are axes."""
STRAIGHT = 1e-6
"""How far axes are from those of the space that differ from them by rounding."""


def rounding(points: np.ndarray) -> float:
    """The distance up to which points (V, 3) are in one place but for single precision, where they were rounded: in world
    space."""
    largest = max(float(points.max(initial=0.0)), -float(points.min(initial=0.0)))
    return STEPS * float(np.finfo(np.float32).eps) * largest


@dataclass(frozen=True, eq=False)
class Flush:
    """A mesh whose planes are flush.

    Attributes:
        points: (V, 3) float64, along the axes.
        triangles: (T, 3) int.
        axes: (3, 3) float64, unit normals of planes in rows; those of the space itself for boxes along them.
    """

    points: np.ndarray
    triangles: np.ndarray
    axes: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, triangles: np.ndarray, within: float) -> "Flush":
        """A mesh with points in one place, and planes across the axes in one, that are up to about `within` apart.

        What is in one place or plane stays there. Points are not joined if triangles as small as that would go.

        Args:
            points: (V, 3) float.
            triangles: (T, 3) int.
            within: as `rounding` finds it.
        """
        joined = topology.places(points, within)[triangles]
        triangles = joined if topology.has_corners(joined).all() else triangles
        axes = _axes(points, triangles, within)
        along = points @ axes.T
        for axis in range(3):
            heights = along[triangles, axis]
            flat = np.ptp(heights, axis=1) <= within
            on_planes = np.unique(triangles[flat])
            along[on_planes, axis] = _levels(along[on_planes, axis], within)
        return cls(along, triangles, axes)

    def placed(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) along the axes, in the space of the mesh: float64."""
        return points @ np.linalg.inv(self.axes).T


def _axes(points: np.ndarray, triangles: np.ndarray, within: float) -> np.ndarray:
    """The directions (3, 3) to which most of the area faces, each across those before as far as there are any."""
    units, areas = unit_normals(points, triangles, np.float64)
    products = units[:, [0, 1, 2, 0, 1, 2]] * units[:, [0, 1, 2, 1, 2, 0]]  # the same for a side and its back
    labels = topology.places(products, ALIKE)
    sums, noise = np.bincount(labels, areas, len(units)), within / np.sqrt(np.maximum(areas, 1e-300))

    def largest(weights: np.ndarray) -> np.ndarray:
        """The mean of what differs from the largest triangle by rounding alone."""
        best = np.argmax(areas * (labels == np.argmax(sums * weights)))
        ways = np.sign(units @ units[best])
        is_alike = np.linalg.norm(ways[:, None] * units - units[best], axis=1) <= noise + noise[best]
        mean = (areas * ways * is_alike) @ units
        return unit(mean * np.sign(mean[np.argmax(np.abs(mean))]))

    first = largest(np.ones(len(units)))
    second = largest(np.linalg.norm(np.cross(units, first), axis=1))
    third = largest(np.abs(units @ np.cross(first, second)))
    axes = np.stack(sorted((first, second, third), key=lambda axis: int(np.argmax(np.abs(axis)))))
    volume = np.linalg.det(axes)
    if abs(volume) < LEAST_APART or np.abs(axes - np.eye(3)).max() <= STRAIGHT:
        return np.eye(3)
    return axes * np.array([(1.0,), (1.0,), (np.sign(volume),)])


def _levels(heights: np.ndarray, within: float) -> np.ndarray:
    """Heights (N,) with the lowest of those that follow one another by up to `within` for each. Where they do so over more,
    they stay."""
    order = np.argsort(heights)
    ordered = heights[order]
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > within)
    sizes = np.diff(starts, append=len(ordered))
    is_thin = ordered[starts + sizes - 1] - ordered[starts] <= 2.0 * within
    result = np.empty_like(heights)
    result[order] = np.where(np.repeat(is_thin, sizes), np.repeat(ordered[starts], sizes), ordered)
    return result
