# SPDX-License-Identifier: GPL-3.0-or-later
"""The connected patches of the high meshes, and a sample of their triangles compared with the low mesh."""

from dataclasses import dataclass, fields
from functools import cached_property, partial

import numpy as np

from ..mesh import orientation, topology
from ..mesh.closest import Surface
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, gap, local_space_of
from ..mesh.orientation import Patches
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import diagonal, enclosed_volumes, unit_normals
from .method_choice import FAR_APART

FEW, MANY = 64, 4096
"""How many triangles of all high meshes are compared with the low mesh, if they agree with each other, and if not."""
OF_PATCH = 8
"""The least of them in a patch, if it has so many."""
SURE = 0.1
"""A patch that agrees with the low mesh by less than this, from -1 to 1, points to no side."""


@dataclass(frozen=True)
class Samples:
    """Triangles of a high mesh that are compared with the low mesh.

    Attributes:
        triangles, patches (N,) int: Their numbers, and the patch of each.
        weights (N,): Areas.
        cosines (N,): Between the triangle's normal, turned as its patch says, and that of the low mesh at the closest point.
        places (N, 3), on_low (N, 3): The triangle's middle and that point, in the low mesh's local space.
        closest (N,) int: The triangle of the low mesh.
        count: Of the patches.
    """

    triangles: np.ndarray
    patches: np.ndarray
    weights: np.ndarray
    cosines: np.ndarray
    places: np.ndarray
    on_low: np.ndarray
    closest: np.ndarray
    count: int

    def means(self, values: np.ndarray, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """The mean (count,) of values (N,) over each patch, by area. chosen: the samples that count; 0 for patches of none."""
        weights = np.bincount(self.patches[chosen], self.weights[chosen], self.count)
        return np.bincount(self.patches[chosen], (self.weights * values)[chosen], self.count) / np.maximum(
            weights, 1e-300
        )

    def at(self, chosen: np.ndarray) -> "Samples":
        """Some of them, (N,) bool."""
        arrays = {each.name: getattr(self, each.name)[chosen] for each in fields(self) if each.name != "count"}
        return Samples(**arrays, count=self.count)

    def shares(self, chosen: np.ndarray) -> np.ndarray:
        """The share (count,) of each patch's samples that are chosen, (N,) bool or int."""
        of_all = np.maximum(np.bincount(self.patches, minlength=self.count), 1)
        return np.bincount(self.patches[chosen], minlength=self.count) / of_all


class HighPatches:
    """The patches of all high meshes of a bake. High meshes beside the low one are compared in its place.

    of (N,): the patches of each mesh. low_triangles (T, 3) int, low_normals (T, 3): of the low mesh, unit normals. samples: of
    each mesh. is_clean: whether no triangle is against another one that shares an edge. is_aside: whether the high meshes lie
    beside the low one.
    """

    def __init__(self, meshes: Meshes):
        """Find the patches. `compare` finds the rest."""
        self.meshes, self.low = meshes, meshes.whole_low
        self.of = [patches_of(high) for high in meshes.highs]
        self.count = sum(patches.count for patches in self.of)
        self.is_clean = all(patches.pairs is None for patches in self.of)

    def compare(self, count: int = 0) -> None:
        """Compare a sample of about `count` triangles with the low mesh; 0 for as many as it takes to find their sides."""
        self.space = local_space_of([self.low])
        self.low_points = self.space.points(self.low)
        self.low_triangles = self.low.vertices[self.low.front_triangles]
        self._surface = Surface(self.low_points, self.low_triangles)
        apart = gap(self.low, self.meshes.highs)
        self._aside, self.is_aside = np.zeros(3), apart > FAR_APART * self.space.size
        if self.is_aside:
            self._aside = (self.space.origin - local_space_of(self.meshes.highs).origin) / self.space.size
        count = count or (FEW if self.is_clean else MANY)
        self.samples = [
            self._samples(high, patches, count) for high, patches in zip(self.meshes.highs, self.of, strict=True)
        ]

    @cached_property
    def low_normals(self) -> np.ndarray:
        """Of the low mesh's triangles (T, 3) float64, unit vectors."""
        return self._low_normals_and_areas[0]

    @cached_property
    def low_areas(self) -> np.ndarray:
        """Twice those of the low mesh's triangles (T,) float64."""
        return self._low_normals_and_areas[1]

    @cached_property
    def _low_normals_and_areas(self) -> tuple[np.ndarray, np.ndarray]:
        return unit_normals(self.low_points, self.low_triangles, np.float64)

    @cached_property
    def _is_two_sided(self) -> np.ndarray:
        """Which triangles of the low mesh (T,) bool are in the place of others that point to the other side."""
        return orientation.copies(self.low_points, self.low_triangles)[1]

    @property
    def agreements(self) -> list[np.ndarray]:
        """How much the patches (count,) of each mesh agree with the low mesh, from -1 to 1."""
        return [some.means(some.cosines) for some in self.samples]

    def is_dirty(self, number: int) -> np.ndarray:
        """Which patches (count,) bool of a mesh have triangles against others of the patch."""
        return self.of[number].against > 0

    def volumes(self, number: int, asked: np.ndarray) -> np.ndarray:
        """The volumes (count,) that some patches (count,) bool of a mesh enclose, 0 for the others; negative if they point
        inward, with their triangles turned as most of them are."""
        one = self.of[number]
        if not asked.any():
            return np.zeros(one.count)
        high, some = self.meshes.highs[number], slice(None) if asked.all() else np.flatnonzero(asked[one.labels])
        points = _placed(high, high.positions, self.space) + self._aside
        volumes = enclosed_volumes(points, high.vertices[high.front_triangles[some]])
        return np.bincount(one.labels[some], volumes * np.where(one.is_against[some], -1.0, 1.0), one.count)

    def is_outward(self, number: int, asked: np.ndarray) -> np.ndarray:
        """Which of some patches (count,) bool of a mesh are closed and point outward: nothing is wrong with them."""
        return self.volumes(number, asked & self.of[number].is_closed) > 0.0

    def _samples(self, high: Mesh, patches: Patches, count: int) -> Samples:
        chosen = _spread(patches.labels, patches.count, count)
        corners = _corners(high, chosen, self.space) + self._aside
        normals, areas = unit_normals(corners)
        places = corners.mean(axis=1).astype(np.float32)
        closest, on_low, _ = self._surface.closest(places)
        on_low_normals, _ = unit_normals(self.low_points, self.low_triangles[closest], np.float64)
        cosines = (normals * on_low_normals).sum(axis=1)
        cosines *= np.where(patches.is_against[chosen], -1.0, 1.0)
        against = np.flatnonzero(cosines < 0.0)
        if len(against):
            two_sided = against[self._is_two_sided[closest[against]]]
            cosines[two_sided] = -cosines[two_sided]
        return Samples(chosen, patches.labels[chosen], areas, cosines, places, on_low, closest, patches.count)


def patches_of(mesh: Mesh) -> Patches:
    """The patches of a mesh."""
    patches = orientation.patches(mesh.positions, np.take(mesh.vertices, mesh.triangles, mode="clip"), _diagonal(mesh))
    mesh.remembered("places", (), lambda: patches.places)
    return patches


def places_of(mesh: Mesh) -> np.ndarray:
    """As Patches has them, found once."""
    return mesh.remembered("places", (), partial(_places, mesh))


def _places(mesh: Mesh) -> np.ndarray:
    columns = orientation.columns_of(np.take(mesh.vertices, mesh.triangles, mode="clip"))
    is_open = orientation.open_vertices(columns, len(mesh.positions))
    return topology.places(mesh.positions, orientation.WELD * _diagonal(mesh), is_open)


def _diagonal(mesh: Mesh) -> float:
    return diagonal(mesh.box) if len(mesh.triangles) else 0.0


def corners_in(mesh: Mesh, chosen: np.ndarray, space: LocalSpace) -> np.ndarray:
    """The corners (N, 3, 3) float32 of some triangles in a local space, counter-clockwise from the front."""
    return _corners(mesh, chosen, space).astype(np.float32)


def _corners(mesh: Mesh, chosen: np.ndarray | slice, space: LocalSpace) -> np.ndarray:
    return _placed(mesh, mesh.positions[mesh.vertices[mesh.front_triangles[chosen]]], space)


def _placed(mesh: Mesh, points: np.ndarray, space: LocalSpace) -> np.ndarray:
    """Points (..., 3) of a mesh in a local space, float64."""
    points = points.astype(np.float64)
    return (points @ mesh.to_world[:3, :3].T + (mesh.to_world[:3, 3] - space.origin)) / space.size


def _spread(labels: np.ndarray, count: int, most: int) -> np.ndarray:
    """Some triangles (N,) int, about `most`: spread over each patch, and at least OF_PATCH of it."""
    if count == 1:
        return np.unique(np.linspace(0, len(labels) - 1, most).astype(np.int64))
    order = np.argsort(labels, kind="stable")
    sizes = np.bincount(labels, minlength=count)
    wanted = np.minimum(sizes, np.maximum(OF_PATCH, -(-sizes * most // max(1, len(labels)))))
    starts = np.cumsum(sizes) - sizes
    patch = np.repeat(np.arange(count), wanted)
    number = np.arange(len(patch)) - np.repeat(np.cumsum(wanted) - wanted, wanted)
    return order[starts[patch] + ((number + 0.5) * (sizes / np.maximum(wanted, 1))[patch]).astype(np.int64)]
