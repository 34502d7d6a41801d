# SPDX-License-Identifier: GPL-3.0-or-later
"""Joins vertices: those in one place, so that single triangles become a surface, or all in a cell of a grid.

A *triangle soup* is a list of triangles that share no vertices, as STL files and many scans have them.

Source of `cluster`: Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993. There, all
vertices in a cell become one; here, only those that edges in the cell connect.
Tried, for the 603,456 corners of single triangles: numpy.unique over rows of bytes 0.10 s, hashes of rows 0.03 s.
"""

import math
from dataclasses import dataclass

import numpy as np

from . import topology
from .topology import EdgeTable
from .triangles import checked, face_areas, unit

LEAST_LEFT = 0.5
"""The share of the area below which thinning has lost single triangles, which no edges connect with others."""
ONE_WAY, FLAT = 1e-3, 1e-6
"""The angle up to which triangles at an edge lie in one plane, and the share of the edge that is the height of a line."""


@dataclass(frozen=True)
class WeldOptions:
    """What `weld` joins.

    Attributes:
        within: vertices that are closer become one, in the place of the first of them; 0 for those in exactly one place.
        keeps_backs: whether two triangles in one place stay if they point to opposite sides: solids that touch have them.
    """

    within: float = 0.0
    keeps_backs: bool = False


def weld(
    points: np.ndarray, triangles: np.ndarray, options: WeldOptions = WeldOptions()
) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with one vertex in each place, and without triangles that are a line, or in the place of another.

    >>> corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0), (1, 1, 0), (0, 1, 0)]
    >>> points, triangles = weld(np.array(corners, float), np.arange(6).reshape(2, 3))
    >>> points.shape, triangles.shape
    ((4, 3), (2, 3))

    Args:
        points: (V, 3) float; those that are the same in single precision are in one place.
        triangles: (T, 3) int.
        options: how far apart vertices may be.

    Returns:
        Points (P, 3), those that triangles use, and triangles (N, 3) int64.
    """
    points, triangles = checked(points, triangles)
    single = points.astype(np.float32)
    once = topology.whole_once_a_side if options.keeps_backs else topology.whole_once
    used, numbers = topology.numbered(once(topology.places(single, options.within)[triangles]))
    # In the order of their bits: what takes triangles or edges in the order of vertices then takes them all over the surface.
    bits = (single[used] + np.float32(0.0)).view(np.dtype((np.void, 12))).reshape(-1)
    order = np.argsort(bits, kind="stable")
    ranks = np.empty(len(order), np.int64)
    ranks[order] = np.arange(len(order))
    return points[used[order]], ranks[numbers]


def with_backs(mesh: tuple[np.ndarray, np.ndarray], source: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """The triangles (N, 3) of a welded mesh, and turned over those that its source has to both sides: two solids touch there.

    mesh, source: points (V, 3) float32 and triangles (T, 3) int.
    """
    (points, triangles), (read, corners) = mesh, source
    of_read = topology.places(np.concatenate([points, read]))[len(points) :][corners]
    turned = triangles[:, ::-1]
    first = topology.first_rows(topology.from_lowest(np.concatenate([of_read, triangles, turned])))
    is_there = (first < len(corners))[len(corners) :].reshape(2, -1).all(axis=0)
    return np.concatenate([triangles, turned[is_there]])


def parted(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with vertices of its own for each part that edges connect: solids that touch are apart again.

    points: (V, 3). triangles: (T, 3) int, which keep their order.
    """
    table = EdgeTable.of(triangles)
    plain = (side[~table.is_against] for side in table.pairs)
    around = _around_solids(points, triangles, table)
    one, other = (np.concatenate(sides) // 3 for sides in zip(plain, around, strict=True))
    parts = topology.connected(len(triangles), one, other)
    keys, numbers = np.unique(parts[:, None] * len(points) + triangles, return_inverse=True)
    return points[keys % len(points)], numbers.reshape(triangles.shape)


def _around_solids(points: np.ndarray, triangles: np.ndarray, table: EdgeTable) -> tuple[np.ndarray, np.ndarray]:
    """Of edges with more than two sides, the pairs (P,) int between whose triangles a solid lies. None where one of these is a
    line, which lies nowhere around the edge."""
    crowded = np.flatnonzero(table.is_crowded)
    counts = table.counts[crowded]
    begins, of = np.cumsum(counts) - counts, np.repeat(np.arange(len(crowded)), counts)
    sides = table.sides[topology.ranges(table.begins[crowded], counts)]
    low, high = points[table.ends[crowded]].astype(np.float64).transpose(1, 0, 2)
    along = unit(high - low)
    away = points[triangles[sides // 3, (sides + 2) % 3]] - low[of]
    away -= (away * along[of]).sum(axis=1, keepdims=True) * along[of]
    is_line = np.linalg.norm(away, axis=1) <= FLAT * np.linalg.norm(high - low, axis=1)[of]
    has_line = np.bincount(of, is_line, len(crowded)) > 0
    u = away[begins]
    v = np.cross(along, u)
    angles = np.arctan2((away * v[of]).sum(axis=1), (away * u[of]).sum(axis=1))
    angles = (angles + ONE_WAY) % (2.0 * np.pi)
    order = np.lexsort((angles, of))
    ways = np.cumsum(np.diff(angles[order] + 4.0 * np.pi * of, prepend=0.0) > ONE_WAY)
    # A side that runs to the lower vertex has the inside of its solid ahead. Where two solids touch, one ends first.
    is_ahead = table.first[sides] > table.last[sides]
    order = order[np.lexsort((is_ahead[order], ways))]
    sides, is_ahead = sides[order], is_ahead[order]
    following = np.arange(1, len(sides) + 1)
    following[begins + counts - 1] = begins
    chosen = is_ahead & ~is_ahead[following] & ~has_line[of]
    return sides[chosen], sides[following[chosen]]


@dataclass(frozen=True)
class ClusterOptions:
    """How `cluster` thins a mesh.

    Attributes:
        cell: the side of a cell of the grid.
        is_torn: whether all vertices in a cell become one, since hardly any edges connect the triangles.
    """

    cell: float
    is_torn: bool = False


def cluster(points: np.ndarray, triangles: np.ndarray, options: ClusterOptions) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with one vertex, in the middle of them, for all vertices in each cell of a grid that edges in it connect: where
    two parts of the surface share a cell they stay apart. Triangles that are a line are left out, and thin parts pressed
    flat: as many in one place that point to one side as to the other.

    >>> thin, left = cluster(points, triangles, ClusterOptions(cell=0.3))
    >>> 0 < len(left) < len(triangles) / 2
    True

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int.
        options: the grid.

    Returns:
        Points (P, 3) float64 and triangles (N, 3) int64.
    """
    points, triangles = checked(points, triangles)
    cells = np.floor((points - points.min(axis=0, initial=np.inf)) / options.cell).astype(np.int64)
    cells = cells @ [1, 2**21, 2**42]
    if not options.is_torn:
        of_corners, ends = cells[triangles], []
        for first, last in ((0, 1), (1, 2), (2, 0)):
            ends.append(triangles[of_corners[:, first] == of_corners[:, last]][:, [first, last]])
        _, numbers = topology.numbered(topology.connected(len(points), *np.concatenate(ends).T))
    else:
        _, numbers = np.unique(cells, return_inverse=True)
    counts = np.bincount(numbers)
    middles = topology.sums_of(numbers, points, len(counts)) / counts[:, None]
    joined = numbers[triangles]
    joined = joined[topology.has_corners(joined)]
    places = topology.first_rows(np.sort(joined, axis=1))
    rises = np.count_nonzero(joined < np.roll(joined, -1, axis=1), axis=1)
    sides = np.where(rises == 2, 1, -1)  # two rises: turned until the least comes first, the corners are in order
    sums = np.bincount(places, sides)[places]
    return middles, joined[sums * sides > 0.0]


def thinned(points: np.ndarray, triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with about `count` triangles, by `cluster`: points (P, 3) float64 and triangles (N, 3) int64, not welded.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, more than `count`.
        count: two a cell of the grid that holds the surface.
    """
    area = float(face_areas(points, triangles).sum())
    cell = max(math.sqrt(2.0 * area / count), float(np.ptp(points, axis=0).max()) / 2**20)
    result = cluster(points, triangles, ClusterOptions(cell))
    if face_areas(*result).sum() < LEAST_LEFT * area:
        result = cluster(points, triangles, ClusterOptions(cell, is_torn=True))
    return result
