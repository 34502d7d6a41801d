# SPDX-License-Identifier: GPL-3.0-or-later
"""Divides flat polygons into triangles, all of them at once.

Source: ears, as Meisters, "Polygons have ears", 1975, which are cut here wherever they do not touch.
"""

import numpy as np

from . import topology
from .triangles import cross, dot


def triangulated(
    points: np.ndarray, first: np.ndarray, last: np.ndarray, polygons: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The triangles of polygons: (N, 3) int, vertices, and the polygon (N,) int of each.

    Where a polygon crosses itself, the rest of it is cut without looking.

    Args:
        points: (V, 3) float64.
        first, last: (S,) int, the vertices at which each side starts and ends, counter-clockwise around the normal; each vertex
            once in a polygon.
        polygons: (S,) int, the polygon of each side.
        normals: (P, 3), of the polygons.
    """
    order = np.lexsort((first, polygons))
    first, last, polygons = first[order], last[order], polygons[order]
    width = int(max(first.max(initial=0), last.max(initial=0))) + 1
    after = np.searchsorted(polygons * width + first, polygons * width + last)
    before = np.empty_like(after)
    before[after] = np.arange(len(after))
    places, up = points[first], normals[polygons]
    left, triangles, of = np.ones(len(first), bool), [], []
    while True:
        sizes = np.bincount(polygons[left], minlength=len(normals))
        nodes = np.flatnonzero(left & (sizes[polygons] > 2))
        if not len(nodes):
            break
        corners = np.stack([before[nodes], nodes, after[nodes]], axis=1)
        quality = _quality(places[corners], up[nodes])
        is_ear = (quality > 0.0) & ~_is_filled(places, corners, up, polygons, nodes)
        has_ear = np.zeros(len(normals), bool)
        has_ear[polygons[nodes[is_ear]]] = True
        is_ear |= ~has_ear[polygons[nodes]]
        # The best ears, of which no two touch.
        ranks = np.full(len(first), len(first))
        ears = nodes[is_ear]
        ranks[ears[np.argsort(-quality[is_ear], kind="stable")]] = np.arange(len(ears))
        is_best = (ranks[ears] < ranks[before[ears]]) & (ranks[ears] < ranks[after[ears]])
        cut = ears[is_best]
        # A quadrangle is done with one: the other would leave a line.
        cut = cut[(sizes[polygons[cut]] > 4) | (topology.first_rows(polygons[cut][:, None]) == np.arange(len(cut)))]
        triangles.append(first[np.stack([before[cut], cut, after[cut]], axis=1)])
        of.append(polygons[cut])
        left[cut] = False
        after[before[cut]], before[after[cut]] = after[cut], before[cut]
        done = np.bincount(polygons[left], minlength=len(normals)) < 3
        left &= ~done[polygons]
    if not triangles:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    return np.concatenate(triangles), np.concatenate(of)


def _quality(corners: np.ndarray, up: np.ndarray) -> np.ndarray:
    """How good triangles (N, 3, 3) are (N,): 1 if equilateral, below 0 if they point away from `up` (N, 3)."""
    a, b, c = corners.transpose(1, 2, 0)
    areas = dot(cross(b - a, c - a), up.T)
    squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    return 2.0 * np.sqrt(3.0) * areas / np.maximum(squares, 1e-300)


def _is_filled(
    places: np.ndarray, corners: np.ndarray, up: np.ndarray, polygons: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """Which triangles (N, 3) int have another node of their polygon inside, (N,) bool. nodes: (N,) int, by polygon."""
    begins = np.searchsorted(polygons[nodes], polygons[nodes])
    counts = np.searchsorted(polygons[nodes], polygons[nodes], side="right") - begins
    which = np.repeat(np.arange(len(nodes)), counts)
    other = nodes[topology.ranges(begins, counts)]
    is_other = (other[:, None] != corners[which]).all(axis=1)
    which, other = which[is_other], other[is_other]
    place, normal = places[other].T, up[nodes[which]].T
    inside = np.ones(len(which), bool)
    for corner in range(3):
        start, stop = places[corners[which, corner]].T, places[corners[which, (corner + 1) % 3]].T
        inside &= dot(cross(stop - start, place - start), normal) >= 0.0
    result = np.zeros(len(nodes), bool)
    result[which[inside]] = True
    return result
