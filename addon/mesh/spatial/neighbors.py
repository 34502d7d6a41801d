# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the triangles on the other side of each edge."""

import numpy as np

from ..uv_islands import hashes

NO_AREA = 1e-5
"""Triangles with less area than this share of a square on their longest edge have none: rounding decides their normals."""


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


def has_area(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles (T, 3), indices into points (P, 3) float32, have an area, (T,) bool."""
    corners = points[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return areas > NO_AREA * (edges * edges).sum(axis=2).max(axis=1)


def past_flat(points: np.ndarray, triangles: np.ndarray, has_area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbors for walks, which cannot cross a triangle without area: it has no sides to choose from.

    Returns `neighbors` as if such triangles were not there, and a triangle with area at each one, (T,) int64: itself, or a
    neighbor. Without any it stays itself.
    """
    across, nearest = neighbors(points, triangles), np.arange(len(triangles))
    flat = np.flatnonzero(~has_area)
    if not len(flat):
        return across, nearest
    corners, beside = points[triangles[flat]], across[flat]
    fits = (beside >= 0) & has_area[beside]
    # All of a triangle without area lies on its longest edge.
    lengths = ((np.roll(corners, -1, axis=1) - corners) ** 2).sum(axis=2)
    longest = np.where(fits, lengths, -1.0).argmax(axis=1)
    nearest[flat] = np.where(fits.any(axis=1), beside[np.arange(len(flat)), longest], flat)
    kept = np.flatnonzero(has_area)
    found = neighbors(points, triangles[kept])
    across[flat], across[kept] = -1, np.where(found >= 0, kept[found] if len(kept) else -1, -1)
    return across, nearest
