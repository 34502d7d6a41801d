# SPDX-License-Identifier: GPL-3.0-or-later
"""Divides triangles into equal smaller ones."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Pieces:
    """The parts of divided triangles.

    Attributes:
        parents: (P,) int, the triangle of each point.
        weights: (P, 3) float32, the point's barycentric coordinates in it.
        triangles: (S, 3) int32, indices of points, in the parents' winding.
    """

    parents: np.ndarray
    weights: np.ndarray
    triangles: np.ndarray

    def interpolate(self, values: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """`values` (C, n) float32 by corner at the points: (P, n) float32. corners (T, 3): those of each triangle."""
        return np.einsum("pk,pkn->pn", self.weights, values[corners[self.parents]])


def divide(counts: np.ndarray) -> Pieces:
    """Divide triangle i along each of its edges into counts[i] parts, which gives counts[i] ** 2 pieces. counts (T,) int."""
    parents, weights, triangles, start = [], [], [], 0
    for count in np.unique(counts):
        chosen = np.flatnonzero(counts == count)
        own_weights, own_triangles = _pattern(int(count))
        parents.append(np.repeat(chosen, len(own_weights)))
        weights.append(np.tile(own_weights, (len(chosen), 1)))
        starts = start + np.arange(len(chosen)) * len(own_weights)
        triangles.append((starts[:, None, None] + own_triangles).reshape(-1, 3))
        start += len(chosen) * len(own_weights)
    if not parents:
        return Pieces(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    return Pieces(np.concatenate(parents), np.concatenate(weights), np.concatenate(triangles).astype(np.int32))


def _pattern(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The points of one triangle as barycentric coordinates (P, 3) float32, and its pieces (count ** 2, 3)."""
    second, third = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
    is_inside = second + third <= count
    numbers = np.full(is_inside.shape, -1)
    numbers[is_inside] = np.arange(np.count_nonzero(is_inside))
    second, third = second[is_inside], third[is_inside]
    weights = np.stack([count - second - third, second, third], axis=1) / np.float32(count)
    upright = second + third < count
    i, j = second[upright], third[upright]
    first = np.stack([numbers[i, j], numbers[i + 1, j], numbers[i, j + 1]], axis=1)
    turned = second + third < count - 1
    i, j = second[turned], third[turned]
    other = np.stack([numbers[i + 1, j], numbers[i + 1, j + 1], numbers[i, j + 1]], axis=1)
    return weights.astype(np.float32), np.concatenate([first, other])
