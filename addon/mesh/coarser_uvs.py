# SPDX-License-Identifier: GPL-3.0-or-later
"""UVs of a coarser mesh: the vertices that it must keep, and where UVs move as far as nothing folds."""

from collections.abc import Sequence

import numpy as np

from .topology import EdgeTable
from .uv_seams import CONNECTED


def kept_vertices(
    vertices: np.ndarray, triangles: np.ndarray, by_corner: Sequence[np.ndarray], labels: np.ndarray
) -> np.ndarray:
    """Which vertices (V,) bool lie on a border: of the surface, of a UV island, or between labels.

    vertices (C,) int: the vertex of each corner; V is one more than the largest. triangles (T, 3) int: corners. by_corner: the
    UV layers, (C, 2) each, whose islands count. labels (T,) int: of triangles, as the material slot.
    """
    start, stop = (np.roll(triangles, -i, axis=1).reshape(-1) for i in range(2))
    label = np.repeat(labels, 3)
    is_turned = vertices[start] > vertices[stop]
    first, last = np.where(is_turned, stop, start), np.where(is_turned, start, stop)
    count = int(vertices.max(initial=-1)) + 1
    left, right = EdgeTable.of_sides(
        vertices[first], vertices[last]
    ).pairs  # one triangle, or three and more, is a border
    goes_on = label[left] == label[right]
    for values in by_corner:
        for corner in (first, last):
            between = np.abs(values[corner[left]] - values[corner[right]])
            goes_on &= (between <= CONNECTED).all(axis=1)
    is_border = np.ones(len(first), bool)
    is_border[left[goes_on]] = is_border[right[goes_on]] = False
    result = np.zeros(count, bool)
    result[vertices[first[is_border]]] = result[vertices[last[is_border]]] = True
    return result


FARTHEST_MOVE = 0.5
"""The farthest move, as a share of the longest edge at the vertex in UV space. What is farther belongs to another island."""
LEAST_UV_AREA = 0.1
"""The smallest share of its area in UV space that a triangle keeps."""


def moved_uvs(
    before: np.ndarray, after: np.ndarray, vertices: np.ndarray, triangles: np.ndarray, fixed: np.ndarray
) -> np.ndarray:
    """The UVs `before` (C, 2), moved to `after` (C, 2) at the vertices where that is safe: (C, 2) float32.

    vertices (C,) int: the vertex of each corner. triangles (T, 3) int: corners. fixed (V,) bool: vertices that do not move. All
    corners of a vertex move, or none: those that move together and not far. A move is taken back while a triangle would turn
    over or lose nearly all of its area.
    """
    moves = (after - before).astype(np.float64)
    largest = _Largest(vertices, len(fixed))
    farthest = largest.of(_length(moves))
    is_free = ~fixed & (farthest > 0.0)
    for values in (before, after):
        for axis in values.T.astype(np.float64):
            is_free &= largest.of(axis) + largest.of(-axis) <= CONNECTED
    first, second, third = (_length(before[triangles[:, i]] - before[triangles[:, i - 2]]) for i in range(3))
    at_corners = np.maximum([first, second, third], [third, first, second]).T
    longest = _Largest(vertices[triangles.reshape(-1)], len(fixed)).of(at_corners.reshape(-1))
    is_free &= farthest <= FARTHEST_MOVE * longest
    areas = _areas(before.astype(np.float64), triangles)
    while True:
        moved = before + np.where(is_free[vertices][:, None], moves, 0.0)
        now = _areas(moved, triangles)
        is_bad = (now * np.sign(areas) < LEAST_UV_AREA * np.abs(areas)) & (now != areas)
        back = np.zeros(len(fixed), bool)
        back[vertices[triangles[is_bad]]] = True
        if not (back & is_free).any():
            return moved.astype(np.float32)
        is_free &= ~back


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.hypot(vectors[:, 0], vectors[:, 1])


class _Largest:
    """Finds the largest of values by corner at each of `count` vertices; 0 at vertices without a corner."""

    def __init__(self, vertices: np.ndarray, count: int):
        self._order = np.argsort(vertices, kind="stable")
        ordered = vertices[self._order]
        self._starts = np.flatnonzero(np.diff(ordered, prepend=-1))
        self._found, self._count = ordered[self._starts], count

    def of(self, values: np.ndarray) -> np.ndarray:
        """values: (C,). Returns (V,)."""
        result = np.zeros(self._count)
        result[self._found] = np.maximum.reduceat(values[self._order], self._starts)
        return result


def _areas(uv: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area of each triangle."""
    a, b, c = (uv[triangles[:, i]] for i in range(3))
    first, second = b - a, c - a
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
