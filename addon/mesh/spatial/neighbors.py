# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the triangles on the other side of each edge."""

import numpy as np

from ..uv_islands import hashes


def neighbors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangle across the edge from corner k to the next corner, (T, 3) int64, or -1 where the surface ends.

    points (P, 3) float32; triangles (T, 3) int, indices into them. Points in the same place are the same, as exporters split
    vertices at seams. Where more than two triangles meet, each has the next one around, so that all are reached.
    """
    places = np.unique(hashes(points + np.float32(0.0)), return_inverse=True)[1].reshape(-1)[triangles]
    first, last = places.reshape(-1), np.roll(places, -1, axis=1).reshape(-1)
    keys = np.minimum(first, last) * np.int64(len(points)) + np.maximum(first, last)
    order = np.argsort(keys, kind="stable")
    begins = np.flatnonzero(np.diff(keys[order], prepend=-1))
    counts = np.diff(begins, append=len(keys))
    following = np.arange(1, len(keys) + 1)
    following[begins + counts - 1] = begins  # the last one of a run is followed by the first
    result = np.empty(len(keys), np.int64)
    result[order] = order[following] // 3
    result[order[begins[counts == 1]]] = -1
    result[first == last] = -1
    return result.reshape(-1, 3)
