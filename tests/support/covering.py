"""Which triangles cover the center of each texel, in float64, with their distances from the edges."""

from dataclasses import dataclass

import numpy as np

from tests.support.raster import cross


@dataclass(frozen=True)
class Covering:
    """One row for each texel and triangle over its center: texel (N,) int, row by row, triangle (N,) int, weights (N, 3) of its
    corners, and inside (N,), how far the center is inside its edges, in texels; negative outside."""

    texel: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray
    inside: np.ndarray

    def between(self, values):
        """Values (T, 3, n) of corners at the centers: (N, n)."""
        return np.einsum("pcn,pc->pn", values[self.triangle], self.weights)


def covering(uv, size, room):
    """uv (T, 3, 2), size (width, height). room: how far outside a triangle, in texels, a center may be."""
    found = []
    for number, corners in enumerate(uv * size):
        low = np.maximum(np.ceil(corners.min(axis=0) - 0.5 - room), 0).astype(int)
        high = np.minimum(np.floor(corners.max(axis=0) - 0.5 + room) + 1, size).astype(int)
        ends = np.stack([np.roll(corners, -1, axis=0), np.roll(corners, -2, axis=0)])
        edges = ends[1] - ends[0]
        area = cross(edges[0], edges[1])
        if area == 0.0 or (low >= high).any():
            continue
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        x, y = x.ravel(), y.ravel()
        centers = np.stack([x + 0.5, y + 0.5], axis=-1)
        weights = cross(edges, centers[:, None] - ends[0]) / area
        inside = (weights * abs(area) / np.linalg.norm(edges, axis=-1)).min(axis=-1)
        is_over = inside >= -room
        found.append([(y * size[0] + x)[is_over], np.full(is_over.sum(), number), weights[is_over], inside[is_over]])
    return Covering(*(np.concatenate(values) for values in zip(*found, strict=True)))
