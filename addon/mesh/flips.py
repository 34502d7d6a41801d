# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns edges within planes, so that triangles are as little thin as their vertices allow.

Source: Lawson, "Software for C1 surface interpolation", 1977: an edge is turned where the angles opposite of it sum to more
than 180 degrees. Here, all that do not touch are turned at once.
"""

import numpy as np

from .topology import EdgeTable, edge_keys
from .triangles import cross, dot

ROUNDS = 200
"""How often edges are turned, at most: each time, the smallest angles grow."""
FLAT = 1e-9
"""How much of a turn counts as none: of four corners on a circle, either edge will do."""


def delaunay(points: np.ndarray, triangles: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """The triangles (T, 3) with edges turned between those of one plane. Each stays in its plane.

    Args:
        points: (V, 3) float64.
        triangles: (T, 3) int.
        planes: (T,) int, the plane of each triangle.
    """
    triangles = triangles.copy()
    for _ in range(ROUNDS):
        table = EdgeTable.of(triangles)
        one, other = table.pairs
        inside = (planes[one // 3] == planes[other // 3]) & ~table.is_against
        one, other = one[inside], other[inside]
        start, stop = table.first[one], table.last[one]
        left, right = (triangles[side // 3, (side % 3 + 2) % 3] for side in (one, other))
        corners = [points[vertices].T for vertices in (start, stop, left, right)]
        gain = _gain(*corners)
        chosen = (gain > FLAT) & (left != right) & ~np.isin(edge_keys(left, right, table.width), table.keys)
        if not chosen.any():
            break
        which = np.flatnonzero(chosen)
        which = which[np.argsort(-gain[which], kind="stable")]
        faces = np.stack([one[which] // 3, other[which] // 3], axis=1)
        best = np.full(len(triangles), len(which))
        np.minimum.at(best, faces, np.arange(len(which))[:, None])
        # Nor may two new edges have the same ends.
        keys = edge_keys(left[which], right[which], table.width)
        _, at_first = np.unique(keys, return_index=True)
        is_first = np.zeros(len(which), bool)
        is_first[at_first] = True
        turned = is_first & (best[faces] == np.arange(len(which))[:, None]).all(axis=1)
        if not turned.any():
            break
        some = which[turned]
        a, b, c, d = start[some], stop[some], left[some], right[some]
        triangles[one[some] // 3] = np.stack([c, a, d], axis=1)
        triangles[other[some] // 3] = np.stack([d, b, c], axis=1)
    return triangles


def _gain(start: np.ndarray, stop: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The sine (E,) of the angles at left and right beyond 180 degrees; 0 where turned triangles would turn over."""
    sides = start - left, stop - left, start - right, stop - right
    lengths = [np.sqrt(np.maximum(dot(side, side), 1e-300)) for side in sides]
    normal = np.stack(cross(stop - start, left - start))
    sines = [np.sqrt(dot(each, each)) for each in (normal, np.stack(cross(start - stop, right - stop)))]
    cosines = dot(sides[0], sides[1]), dot(sides[2], sides[3])
    gain = -(sines[0] * cosines[1] + sines[1] * cosines[0]) / np.prod(lengths, axis=0)
    flat = dot(cross(start - left, right - left), normal), dot(cross(right - left, stop - left), normal)
    is_convex = (flat[0] > 0.0) & (flat[1] > 0.0)
    return np.where(is_convex, gain, 0.0)
