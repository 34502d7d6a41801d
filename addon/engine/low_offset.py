# SPDX-License-Identifier: GPL-3.0-or-later
"""A low mesh that lies at one distance from the high meshes everywhere: its rays start from where it was before that."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..mesh import topology
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, local_space_of
from ..mesh.orientation import WELD
from ..mesh.triangle_mesh import Mesh, normal_matrix
from ..mesh.triangles import diagonal, vertex_normals

LEAST_OFFSET, ALIKE_SHARE = 0.0045, 0.6
"""A low mesh is off if the median of its distances is at least this share of its diagonal, and this share of them is within
half of the median."""
LEAST_APART, MOST_APART = 0.25, 1.5
"""The share of that distance by which the meshes end apart on each side: points move along their normals, which are askew."""
BETTER, BEYOND = 0.7, 0.3
"""A mesh is moved if at most the first share of what lies elsewhere does so then, and at least the second share of it lay on
the other side: where parts of a mesh that shrank or grew meet others. Frames around deep panels lie at the mesh itself."""
STEPS = 10
"""The mesh is moved in so many steps, each along the normals that it has after the step before."""


def offset(heights: np.ndarray, diagonal: float) -> float:
    """The distance at which the high surface lies outside the low one everywhere; 0 if there is no such distance.

    heights (N,): of points of the high surface. diagonal: of the low mesh.
    """
    median = float(np.median(heights)) if heights.size else 0.0
    if abs(median) < LEAST_OFFSET * diagonal or np.mean(np.abs(heights - median) < 0.5 * abs(median)) < ALIKE_SHARE:
        return 0.0
    return median


def is_around(meshes: Meshes, distance: float) -> bool:
    """Whether the high meshes end farther outside than the low one by about `distance`, in scene units, on all sides. If they
    do not, they are not larger or smaller: parts of them are deep, as panels are."""
    space = local_space_of(meshes.highs)
    shares = (_ends(meshes.highs, space) - _ends([meshes.whole_low], space)) * space.size / distance
    return bool(((shares > LEAST_APART) & (shares < MOST_APART)).all())


def fits_better(before: np.ndarray, after: np.ndarray, distance: float) -> bool:
    """Whether the low mesh fits better once it is moved by a distance. before, after (N,): heights of the high surface above
    it."""
    if not (before.size and after.size):
        return False
    is_far = np.abs(before - distance) > 0.5 * abs(distance)
    is_beyond = before * distance < 0.0
    still_far = np.mean(np.abs(after) > 0.5 * abs(distance))
    return bool(still_far < BETTER * is_far.mean() and is_beyond.mean() > BEYOND * is_far.mean())


def _ends(meshes: Sequence[Mesh], space: LocalSpace) -> np.ndarray:
    """How far meshes reach along each axis and against it, (2, 3) in a local space."""
    ends = np.full((2, 3), -np.inf)
    for mesh in meshes:
        is_used = np.zeros(len(mesh.positions), bool)
        is_used[np.take(mesh.vertices, mesh.triangles, mode="clip")] = True
        used = space.points(mesh)[is_used].T  # one axis after another: reducing along a short last axis is slow
        ends = np.maximum(ends, [[axis.max() for axis in used], [-axis.min() for axis in used]])
    return ends


def moved(meshes: Meshes, distance: float) -> Meshes:
    """`meshes` whose low mesh lies `distance` farther outside, in scene units, with the normals that it has there."""
    move = _Move(meshes.whole_low, distance)
    return replace(
        meshes,
        low=move.of(meshes.low),
        whole=None if meshes.whole is None else move.of(meshes.whole),
        smooth_normals=move.normals(meshes.smooth_normals),
    )


def moved_low(low: Mesh, distance: float) -> Mesh:
    """The whole low mesh of `moved`."""
    return _Move(low, distance).of(low) if distance else low


class _Move:
    """Moves a low mesh by a distance along its normals, as it was moved before along normals that it has no more."""

    def __init__(self, low: Mesh, distance: float):
        triangles = np.take(low.vertices, low.front_triangles, mode="clip")
        matrix, place = low.to_world[:3, :3], low.to_world[:3, 3]
        start = low.positions @ matrix.T + place
        # Vertices that are at one place, but not joined, stay together.
        same = topology.places(start, WELD * diagonal(start))
        triangles, places = same[triangles], start[same]
        after = before = vertex_normals(places, triangles)[same]
        for _ in range(STEPS):
            places = places + distance / STEPS * after
            after = vertex_normals(places, triangles)[same]
        self._low, self._before, self._after = low, before[low.vertices], after[low.vertices]
        self._positions = ((places - place) @ np.linalg.inv(matrix).T).astype(np.float32)

    def of(self, low: Mesh) -> Mesh:
        """The same mesh, or one with some of its triangles, moved."""
        return replace(low, positions=self._positions, normals=self.normals(low.normals))

    def normals(self, normals: np.ndarray) -> np.ndarray:
        """Normals (C, 3) of its corners, turned the shortest way as the smooth normals were."""
        before, after = self._before, self._after
        world = self._low.to_world_normals(normals).astype(np.float64)
        length = 1.0 + (before * after).sum(axis=1, keepdims=True)
        middle = before + after
        turned = world - (middle * world).sum(axis=1, keepdims=True) / np.maximum(length, 1e-6) * middle
        turned += 2.0 * (before * world).sum(axis=1, keepdims=True) * after
        world = np.where(length > 1e-3, turned, world)
        return (world @ np.linalg.inv(normal_matrix(self._low.to_world)).T).astype(np.float32)
