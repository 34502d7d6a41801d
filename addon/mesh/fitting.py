# SPDX-License-Identifier: GPL-3.0-or-later
"""Moves the vertices of a coarse mesh to where the surface that it stands for is nearest."""

from dataclasses import dataclass

import numpy as np

from .closest import Surface

ROUNDS = 4
"""How often the closest points are looked for: they change as vertices move."""
STEPS = 60
"""Of conjugate gradients in a round, at most."""
SMOOTH, PULL = 0.02, 0.001
"""How much the differences of neighbors' moves and the moves themselves count, against the distances of samples."""
WITHIN = float(np.cos(np.radians(70.0)))
"""The cosine up to which the normals of a sample and of the closest triangle differ, or they lie on different sides."""
TURNED = 0.2
"""The cosine between the normals of a triangle before and after, below which its vertices stay where they were."""
THIN = 0.05
"""The share of its area that a triangle keeps at least."""
A_TRIANGLE, LEAST, MOST = 30, 60_000, 120_000
"""Samples for each triangle of the coarse mesh, and the fewest and the most of all."""


@dataclass(frozen=True)
class Samples:
    """Places on a surface. points, normals: (N, 3) float64, of the faces. triangles: (N,) int, the faces."""

    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray

    def chosen(self, which: np.ndarray | slice) -> "Samples":
        """Some of them. which: (N,) bool, numbers, or a slice."""
        return Samples(self.points[which], self.normals[which], self.triangles[which])

    def thinned(self, count: int) -> "Samples":
        """About this many of them, or more, as evenly."""
        return self.chosen(slice(None, None, max(1, len(self.points) // count)))


def samples(points: np.ndarray, triangles: np.ndarray, count: int, seed: int = 1) -> Samples:
    """Places on a surface, evenly by its area.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int; those without an area have no sample.
        count: their number.
        seed: of the places.
    """
    dice = np.random.default_rng(seed)
    first, second, third = (points[triangles[:, i]] for i in range(3))
    normals = np.cross(second - first, third - first)
    areas = np.linalg.norm(normals, axis=1)
    sums = np.cumsum(areas)
    # One place in each of `count` equal parts of the area, so that no part is left out.
    chosen = np.searchsorted(sums, (np.arange(count) + dice.random(count)) / count * sums[-1], side="right")
    chosen = np.minimum(chosen, len(triangles) - 1)
    chosen = chosen[areas[chosen] > 0.0]
    u, v = dice.random((2, len(chosen)))
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u), np.where(outside, 1.0 - v, v)
    corners = points[triangles[chosen]].astype(np.float64)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    return Samples((corners * weights[..., None]).sum(axis=1), normals[chosen] / areas[chosen, None], chosen)


def sample_count(triangles: int) -> int:
    """How many samples a coarse mesh of so many triangles needs."""
    return int(np.clip(A_TRIANGLE * triangles, LEAST, MOST))


def fitted(points: np.ndarray, triangles: np.ndarray, around: Samples) -> np.ndarray:
    """Where vertices lie so that the squares of the distances of samples from the mesh are least.

    No triangle is turned over, or loses nearly all of its area: its vertices stay.

    Args:
        points: (V, 3) float, of the coarse mesh.
        triangles: (T, 3) int.
        around: of the surface that it stands for, in the same space.

    Returns:
        (V, 3) float64.
    """
    start = points.astype(np.float64)
    is_free = np.zeros(len(start), bool)
    is_free[triangles] = True
    edges = np.unique(np.sort(np.concatenate([triangles[:, [i, i - 1]] for i in range(3)]), axis=1), axis=0)
    now = start
    for _ in range(ROUNDS):
        found, where, _ = Surface(now.astype(np.float32), triangles).closest(around.points.astype(np.float32))
        corners = triangles[found]
        normals, _ = _normals(now, corners)
        is_same_side = (normals * around.normals).sum(axis=1) > WITHIN
        corners = corners[is_same_side]
        if not len(corners):
            break
        weights = _weights(where[is_same_side].astype(np.float64), now[corners])
        system = _System(corners, weights, edges, len(start))
        missing = around.points[is_same_side] - (start[corners] * weights[..., None]).sum(axis=1)
        now = _without_turns(start, start + system.solved(missing, now - start), triangles, is_free)
    return now


class _System:
    """Least squares for the moves of vertices: samples, differences along edges, and the moves themselves."""

    def __init__(self, corners: np.ndarray, weights: np.ndarray, edges: np.ndarray, count: int):
        self._corners, self._weights, self._edges, self._count = corners, weights, edges, count
        self._scale = len(corners) / count

    def solved(self, missing: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """The moves (V, 3), by conjugate gradients from `moves`. missing: (N, 3), the way from each sample's place."""
        rest = self._gathered(missing) - self._applied(moves)
        along, power = rest, (rest * rest).sum(axis=0)
        enough = 1e-12 * np.maximum(power, 1e-300)
        for _ in range(STEPS):
            if (power <= enough).all():
                break
            image = self._applied(along)
            share = power / np.maximum((along * image).sum(axis=0), 1e-300)
            moves, rest = moves + share * along, rest - share * image
            before, power = power, (rest * rest).sum(axis=0)
            along = rest + power / np.maximum(before, 1e-300) * along
        return moves

    def _applied(self, moves: np.ndarray) -> np.ndarray:
        result = self._gathered((moves[self._corners] * self._weights[..., None]).sum(axis=1))
        first, last = self._edges.T
        differences = moves[first] - moves[last]
        along = _sums(first, differences, self._count) - _sums(last, differences, self._count)
        return result + self._scale * (SMOOTH * along + PULL * moves)

    def _gathered(self, values: np.ndarray) -> np.ndarray:
        """The sums (V, 3) of values (N, 3) of samples, by the weights of their triangles' vertices."""
        each = (values[:, None] * self._weights[..., None]).reshape(-1, 3)
        return _sums(self._corners.reshape(-1), each, self._count)


def _sums(places: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    return np.stack([np.bincount(places, column, count) for column in values.T], axis=1)


def _weights(places: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The barycentric coordinates (N, 3) of places (N, 3) on triangles (N, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normals = np.cross(b - a, c - a)
    area = np.maximum((normals * normals).sum(axis=1), 1e-300)
    parts = [(np.cross(q - places, r - places) * normals).sum(axis=1) / area for q, r in ((b, c), (c, a), (a, b))]
    found = np.clip(np.stack(parts, axis=1), 0.0, 1.0)
    sums = found.sum(axis=1, keepdims=True)
    return np.where(sums > 0.0, found / np.maximum(sums, 1e-300), 1.0 / 3.0)


def _normals(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (T, 3), zero without an area, and twice the areas (T,)."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    return normals / np.maximum(areas, 1e-300)[:, None], areas


def _without_turns(start: np.ndarray, moved: np.ndarray, triangles: np.ndarray, is_free: np.ndarray) -> np.ndarray:
    """`moved`, where vertices of triangles that would turn over or become thin lie where they did at first."""
    normals, areas = _normals(start, triangles)
    is_moved = is_free.copy()
    while True:
        now = np.where(is_moved[:, None], moved, start)
        new_normals, new_areas = _normals(now, triangles)
        is_bad = ((normals * new_normals).sum(axis=1) < TURNED) | (new_areas < THIN * areas)
        is_bad &= is_moved[triangles].any(axis=1) & (areas > 0.0)
        if not is_bad.any():
            return now
        is_moved[triangles[is_bad]] = False
