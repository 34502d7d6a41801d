# SPDX-License-Identifier: GPL-3.0-or-later
"""Removes folds of a coarse mesh: triangles that point to the other side than the surface there, and than a neighbor.

Found by no paper. Tried: the normal of the nearest sample alone takes the rims of thin parts for folds, where the other side is
nearer; neighbors decide there.
"""

from dataclasses import dataclass

import numpy as np

from . import orientation, topology
from .closest import Surface
from .fitting import Samples
from .triangles import checked, face_areas, unit_normals

OPPOSED_COSINE = -0.1
"""The cosine between normals below which they point to opposite sides."""
AXIS_COSINE = 0.3
"""The cosine from which a normal points to the side of an axis."""


@dataclass(frozen=True)
class UnfoldOptions:
    """What `unfold` removes.

    Attributes:
        rounds: how often folds are looked for: a collapse can make another one.
        most: the share of folded triangles from which the mesh is too coarse to tell folds from its shape: it stays.
    """

    rounds: int = 8
    most: float = 0.2


def unfold(
    points: np.ndarray, triangles: np.ndarray, surface: Samples, options: UnfoldOptions = UnfoldOptions()
) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with the shortest edges of folded triangles collapsed.

    >>> surface = surface_samples(points, triangles, 5000)
    >>> same, left = unfold(points, triangles, surface)  # nothing is folded
    >>> len(left) == len(triangles)
    True

    Args:
        points: (V, 3) float64.
        triangles: (T, 3) int.
        surface: samples of the surface that it stands for, in the same space.
        options: what counts as a fold.

    Returns:
        Points (P, 3) float64 and triangles (N, 3) int64. Those of the arguments, if nothing is folded.
    """
    points, triangles = checked(points, triangles)
    if not (len(triangles) and len(surface.points)):
        return points, triangles
    places = _tree_of(surface.points)
    for _ in range(options.rounds):
        chosen = np.flatnonzero(_is_folded(points, triangles, places, surface))
        if not len(chosen) or len(chosen) > options.most * len(triangles):
            break
        points, triangles = _collapsed(points, triangles, chosen)
    return points, triangles


def _tree_of(points: np.ndarray) -> Surface:
    """Of single points (N, 3)."""
    numbers = np.arange(len(points))
    return Surface(points.astype(np.float32), np.stack([numbers, numbers, numbers], axis=1))


def _is_folded(points: np.ndarray, triangles: np.ndarray, places: Surface, surface: Samples) -> np.ndarray:
    """Which triangles (T,) bool are. places: the surface of the samples surface."""
    own, _ = unit_normals(points, triangles)
    nearest, _, _ = places.closest(points[triangles].mean(axis=1).astype(np.float32))
    is_opposed = (own * surface.normals[nearest]).sum(axis=1) < OPPOSED_COSINE
    if not is_opposed.any():
        return is_opposed
    # Near a thin part, the other side of the surface can be nearest: then neighbors point to the same side.
    pairs, _ = orientation.edge_pairs(triangles, own)
    one, other = pairs.first // 3, pairs.second // 3
    against = (own[one] * own[other]).sum(axis=1) < OPPOSED_COSINE
    counts = np.bincount(np.concatenate([one[against], other[against]]), minlength=len(triangles))
    chosen = np.flatnonzero(is_opposed & (counts > 0))
    corners = points[triangles[chosen]]
    sides = corners - np.roll(corners, 1, axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1, initial=0.0)
    height = 2.0 * face_areas(corners) / np.maximum(longest, 1e-300)
    reach = 0.5 * np.where(counts[chosen] > 1, height, longest)  # what is at a rim opposes the other side of it alone
    is_folded = np.zeros(len(triangles), bool)
    is_folded[chosen] = ~_is_of_surface(corners, own[chosen], surface, reach)
    return is_folded


def _is_of_surface(corners: np.ndarray, normals: np.ndarray, surface: Samples, reach: np.ndarray) -> np.ndarray:
    """Which triangles, with corners (K, 3, 3) and normals (K, 3), have a place of the surface that points to their side nearer
    than `reach` (K,): (K,) bool. Those at a thin rim have."""
    result = np.zeros(len(corners), bool)
    axes = np.abs(normals).argmax(axis=1)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            some = np.flatnonzero((axes == axis) & (sign * normals[:, axis] > 0.0))
            towards = surface.points[sign * surface.normals[:, axis] > AXIS_COSINE]
            if len(some) and len(towards):
                _, _, squares = _tree_of(towards).closest(corners[some].mean(axis=1).astype(np.float32))
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
    used, numbers = topology.numbered(topology.whole_once(new[triangles]))
    return points[used], numbers
