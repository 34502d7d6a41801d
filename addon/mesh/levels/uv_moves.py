# SPDX-License-Identifier: GPL-3.0-or-later
"""Moves the UVs of a coarser mesh to where its vertices lie on the original surface, as far as nothing folds."""

import numpy as np

from ..uv_seams import CONNECTED

REACH = 0.5
"""The farthest move, as a share of the longest edge at the vertex in UV space. What is farther belongs to another island."""
FLAT = 0.1
"""The smallest share of its area in UV space that a triangle keeps."""


def accepted(
    before: np.ndarray, after: np.ndarray, vertices: np.ndarray, triangles: np.ndarray, fixed: np.ndarray
) -> np.ndarray:
    """The UVs `before` (C, 2), moved to `after` (C, 2) at the vertices where that is safe: (C, 2) float32.

    vertices (C,) int: the vertex of each corner. triangles (T, 3) int: corners. fixed (V,) bool: vertices that do not move. All
    corners of a vertex move, or none: those that move together and not far. A move is taken back while a triangle would turn
    over or lose nearly all of its area.
    """
    moves = (after - before).astype(np.float64)
    is_free = ~fixed & (_largest(_length(moves), vertices, len(fixed)) > 0.0)
    for values in (before, after):
        lowest = np.full((len(fixed), 2), np.inf)
        highest = np.full((len(fixed), 2), -np.inf)
        np.minimum.at(lowest, vertices, values)
        np.maximum.at(highest, vertices, values)
        is_free &= ~((highest - lowest) > CONNECTED).any(axis=1)
    longest = np.zeros(len(fixed))
    for i in range(3):
        start, stop = triangles[:, i], triangles[:, i - 2]
        edge = _length(before[stop] - before[start])
        np.maximum.at(longest, vertices[start], edge)
        np.maximum.at(longest, vertices[stop], edge)
    is_free &= _largest(_length(moves), vertices, len(fixed)) <= REACH * longest
    areas = _areas(before.astype(np.float64), triangles)
    while True:
        moved = before + np.where(is_free[vertices][:, None], moves, 0.0)
        now = _areas(moved, triangles)
        is_bad = (now * np.sign(areas) < FLAT * np.abs(areas)) & (now != areas)
        back = np.zeros(len(fixed), bool)
        back[vertices[triangles[is_bad]]] = True
        if not (back & is_free).any():
            return moved.astype(np.float32)
        is_free &= ~back


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _largest(values: np.ndarray, vertices: np.ndarray, count: int) -> np.ndarray:
    """The largest of the values by corner (C,) at each vertex."""
    result = np.zeros(count)
    np.maximum.at(result, vertices, values)
    return result


def _areas(uv: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area of each triangle."""
    a, b, c = (uv[triangles[:, i]] for i in range(3))
    first, second = b - a, c - a
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
