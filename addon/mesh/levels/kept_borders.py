# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the vertices that a coarser mesh must keep, so that the borders of UV islands stay where they are."""

from collections.abc import Sequence

import numpy as np

from ..uv_seams import CONNECTED


def kept(
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
    keys = vertices[first].astype(np.int64) * count + vertices[last]
    order = np.argsort(keys, kind="stable")
    at = np.flatnonzero(np.diff(keys[order], prepend=-1))
    pairs = at[np.diff(at, append=len(keys)) == 2]  # one triangle, or three and more, is a border
    left, right = order[pairs], order[pairs + 1]
    goes_on = label[left] == label[right]
    for values in by_corner:
        for corner in (first, last):
            between = np.abs(values[corner[left]] - values[corner[right]])
            goes_on &= (between <= CONNECTED).all(axis=1)
    is_border = np.ones(len(keys), bool)
    is_border[left[goes_on]] = is_border[right[goes_on]] = False
    result = np.zeros(count, bool)
    result[vertices[first[is_border]]] = result[vertices[last[is_border]]] = True
    return result
