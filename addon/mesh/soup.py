# SPDX-License-Identifier: GPL-3.0-or-later
"""Joins triangles at places where they meet, and tells surfaces from soups of triangles."""

from dataclasses import dataclass

import numpy as np

from . import topology


@dataclass(frozen=True)
class Edges:
    """How many edges a mesh has. open: those of one triangle. against: of two that point to different sides. crowded: of more
    than two."""

    count: int
    open: int
    against: int
    crowded: int

    @property
    def faults(self) -> float:
        """The share of edges at which triangles are against each other or crowded."""
        return (self.against + self.crowded) / max(1, self.count)


def welded(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with one vertex in each place, and without triangles that are a line, or in the place of another.

    Args:
        points: (V, 3) float32.
        triangles: (T, 3) int.

    Returns:
        Points (P, 3), those that triangles use, and triangles (N, 3) int64.
    """
    whole = np.ascontiguousarray(points, np.float32)
    joined = topology.places(whole)[triangles]
    joined = joined[topology.has_corners(joined)]
    joined = joined[topology.first_rows(np.sort(joined, axis=1)) == np.arange(len(joined))]
    used, numbers = topology.numbered(joined)
    # In the order of their bits: what takes triangles or edges in the order of vertices then takes them all over the surface.
    bits = (whole[used] + np.float32(0.0)).view(np.dtype((np.void, 12))).reshape(-1)
    order = np.argsort(bits, kind="stable")
    ranks = np.empty(len(order), np.int64)
    ranks[order] = np.arange(len(order))
    return points[used[order]], ranks[numbers]


def clustered(
    points: np.ndarray, triangles: np.ndarray, cell: float, *, is_torn: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with one vertex, in the middle of them, for all vertices in each cell of a grid that edges in it connect: where
    two parts of the surface share a cell they stay apart. Triangles that are a line are left out, and thin parts pressed
    flat: as many in one place that point to one side as to the other.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int.
        cell: the side of a cell.
        is_torn: whether all vertices in a cell become one, since hardly any edges connect the triangles.

    Returns:
        Points (P, 3) float64 and triangles (N, 3) int64.
    """
    cells = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    cells = cells @ [1, 2**21, 2**42]
    if not is_torn:
        of_corners, ends = cells[triangles], []
        for first, last in ((0, 1), (1, 2), (2, 0)):
            ends.append(triangles[of_corners[:, first] == of_corners[:, last]][:, [first, last]])
        cells = topology.connected(len(points), *np.concatenate(ends).T)
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


def edges(triangles: np.ndarray) -> Edges:
    """Counts the edges of a mesh that is welded. triangles: (T, 3) int."""
    starts, ends = triangles.reshape(-1).astype(np.int64), np.roll(triangles, -1, axis=1).reshape(-1).astype(np.int64)
    width = int(triangles.max(initial=0)) + 1
    keys = np.minimum(starts, ends) * width + np.maximum(starts, ends)
    _, numbers, counts = np.unique(keys, return_inverse=True, return_counts=True)
    sums = np.bincount(numbers.reshape(-1), np.where(starts < ends, 1, -1), len(counts))
    is_pair = counts == 2
    return Edges(
        len(counts),
        int(np.count_nonzero(counts == 1)),
        int(np.count_nonzero(is_pair & (sums != 0))),
        int(np.count_nonzero(counts > 2)),
    )
