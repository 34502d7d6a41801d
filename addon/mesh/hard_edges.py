# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth groups of a surface, and the hard edges and the normals of a coarse mesh that keeps them."""

from dataclasses import dataclass

import numpy as np

from . import topology
from .planes import SOFT
from .topology import EdgeTable
from .triangles import cross, dot, unit, unit_normals

LOST = np.radians(60.0)
"""The angle from which an edge within a group is hard, too: the round that it stands for is gone."""


def smooth_groups(triangles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The group (T,) int of each triangle (T, 3): those that no hard edge parts. normals: (T, 3), of their planes."""
    one, other = (side // 3 for side in EdgeTable.of(triangles).pairs)
    is_soft = (normals[one] * normals[other]).sum(axis=1) > np.cos(SOFT)
    return topology.connected(len(triangles), one[is_soft], other[is_soft])


@dataclass(frozen=True, eq=False)
class Shading:
    """How a mesh is shaded.

    Attributes:
        hard: (E, 2) int, the vertices of its hard edges.
        normals: (T, 3, 3) float64, of corners: between hard edges the mean of the faces around, by the area of the whole plane
            of each, so that what is flat and large stays flat.
    """

    hard: np.ndarray
    normals: np.ndarray


def shading(points: np.ndarray, triangles: np.ndarray, groups: np.ndarray, planes: np.ndarray) -> Shading:
    """The shading of a mesh with the edges between groups hard.

    Args:
        points: (V, 3) float64.
        triangles: (T, 3) int.
        groups: (T,) int, the smooth group of each.
        planes: (T,) int, the plane of each.
    """
    normals, twice_areas = unit_normals(points, triangles, np.float64)
    table = EdgeTable.of(triangles)
    one, other = table.pairs
    turned = (normals[one // 3] * normals[other // 3]).sum(axis=1) < np.cos(LOST)
    is_hard = (groups[one // 3] != groups[other // 3]) | turned | table.is_against
    soft, beside = one[~is_hard], other[~is_hard]
    # Two sides of an edge run against each other: where one starts, the other ends.
    starts = soft, _next(soft)
    ends = _next(beside), beside
    fans = topology.connected(triangles.size, np.concatenate(starts), np.concatenate(ends))
    a, b, c = (points[np.roll(triangles, -turn, axis=1)].reshape(-1, 3).T for turn in range(3))
    angles = np.arctan2(np.linalg.norm(cross(b - a, c - a), axis=0), dot(b - a, c - a))
    weights = angles * np.bincount(planes, twice_areas)[planes].repeat(3)
    sums = topology.sums_of(fans, weights[:, None] * normals.repeat(3, axis=0), triangles.size)
    hard = np.stack([table.first[one[is_hard]], table.last[one[is_hard]]], axis=1)
    return Shading(hard, unit(sums[fans]).reshape(-1, 3, 3))


def _next(sides: np.ndarray) -> np.ndarray:
    """The following side (N,) int of the same triangle."""
    return sides - sides % 3 + (sides + 1) % 3
