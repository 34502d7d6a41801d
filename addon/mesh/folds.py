# SPDX-License-Identifier: GPL-3.0-or-later
"""Removes folds of a coarse mesh: triangles that point to the other side than the surface there, and than a neighbor."""

import numpy as np

from . import orientation, topology
from .closest import Surface
from .fitting import Samples
from .triangles import face_areas, unit_normals

OPPOSED = -0.1
"""The cosine between normals below which they point to opposite sides."""
MOST = 0.2
"""The share of folded triangles from which the mesh is too coarse to tell folds from its shape."""
TOWARDS = 0.3
"""The cosine from which a normal points to the side of an axis."""
ROUNDS = 8
"""How often folds are looked for: a collapse can make another one."""


def removed(points: np.ndarray, triangles: np.ndarray, around: Samples) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with the shortest edges of folded triangles collapsed.

    Args:
        points: (V, 3) float64.
        triangles: (T, 3) int.
        around: of the surface that it stands for, in the same space.

    Returns:
        Points (P, 3) float64 and triangles (N, 3) int64. Those of the arguments, if nothing is folded.
    """
    places = _surface(around.points)
    for _ in range(ROUNDS):
        chosen = np.flatnonzero(_is_folded(points, triangles, places, around))
        if not len(chosen) or len(chosen) > MOST * len(triangles):
            break
        points, triangles = _collapsed(points, triangles, chosen)
    return points, triangles


def _surface(points: np.ndarray) -> Surface:
    """Of single points (N, 3)."""
    numbers = np.arange(len(points))
    return Surface(points.astype(np.float32), np.stack([numbers, numbers, numbers], axis=1))


def _is_folded(points: np.ndarray, triangles: np.ndarray, places: Surface, around: Samples) -> np.ndarray:
    """Which triangles (T,) bool are. places: the surface of the samples around."""
    own, _ = unit_normals(points, triangles)
    nearest, _, _ = places.closest(points[triangles].mean(axis=1).astype(np.float32))
    is_opposed = (own * around.normals[nearest]).sum(axis=1) < OPPOSED
    if not is_opposed.any():
        return is_opposed
    # Near a thin part, the other side of the surface can be nearest: then neighbors point to the same side.
    pairs, _ = orientation.edge_pairs(triangles, own)
    one, other = pairs.first // 3, pairs.second // 3
    against = (own[one] * own[other]).sum(axis=1) < OPPOSED
    counts = np.bincount(np.concatenate([one[against], other[against]]), minlength=len(triangles))
    chosen = np.flatnonzero(is_opposed & (counts > 0))
    corners = points[triangles[chosen]]
    sides = corners - np.roll(corners, 1, axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1, initial=0.0)
    height = 2.0 * face_areas(corners) / np.maximum(longest, 1e-300)
    reach = 0.5 * np.where(counts[chosen] > 1, height, longest)  # what is at a rim opposes the other side of it alone
    found = np.zeros(len(triangles), bool)
    found[chosen] = ~_is_of_surface(corners, own[chosen], around, reach)
    return found


def _is_of_surface(corners: np.ndarray, normals: np.ndarray, around: Samples, reach: np.ndarray) -> np.ndarray:
    """Which triangles, with corners (K, 3, 3) and normals (K, 3), have a place of the surface that points to their side nearer
    than `reach` (K,): (K,) bool. Those at a thin rim have."""
    result = np.zeros(len(corners), bool)
    axes = np.abs(normals).argmax(axis=1)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            some = np.flatnonzero((axes == axis) & (sign * normals[:, axis] > 0.0))
            towards = around.points[sign * around.normals[:, axis] > TOWARDS]
            if len(some) and len(towards):
                _, _, squares = _surface(towards).closest(corners[some].mean(axis=1).astype(np.float32))
                result[some] = squares < reach[some] ** 2
    return result


def _collapsed(points: np.ndarray, triangles: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mesh without the shortest edges of some triangles (N,) int, of those that share no vertex."""
    sides = np.stack([triangles[chosen], np.roll(triangles[chosen], -1, axis=1)], axis=-1)
    lengths = np.linalg.norm(points[sides[..., 0]] - points[sides[..., 1]], axis=-1)
    edges = np.sort(sides[np.arange(len(chosen)), lengths.argmin(axis=1)], axis=1)
    owner = np.full(len(points), len(edges))
    np.minimum.at(owner, edges, np.arange(len(edges))[:, None])
    edges = edges[(owner[edges] == np.arange(len(edges))[:, None]).all(axis=1)]
    points, new = points.copy(), np.arange(len(points))
    points[edges[:, 0]] = points[edges].mean(axis=1)
    new[edges[:, 1]] = edges[:, 0]
    triangles = new[triangles]
    triangles = triangles[topology.has_corners(triangles)]
    triangles = triangles[topology.first_rows(np.sort(triangles, axis=1)) == np.arange(len(triangles))]
    used, numbers = topology.numbered(triangles)
    return points[used], numbers
