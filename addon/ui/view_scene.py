# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects that a view draws, where they are now, and the camera that looks at them."""

from dataclasses import dataclass, replace
from typing import Protocol

import gpu
import numpy as np
from mathutils.bvhtree import BVHTree

from ..core.settings import Settings
from ..jobs.job import Job
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, gap, local_space_of
from ..mesh.triangle_mesh import Mesh, normal_matrix
from ..passes import mesh_upload
from ..scene import mesh_reader


class Subject(Protocol):
    """What a view shows: Live's session, one that was made for the views, or the last bake of a low object.

    job: its objects. settings: of the bake. meshes: the objects as last read; the high ones may be missing. upload: keeps
    batches, as UploadCache.upload.
    """

    job: Job
    settings: Settings
    meshes: Meshes

    def upload(self, key: str, mesh: Mesh, **attributes: np.ndarray) -> gpu.types.GPUBatch: ...


PULL = 0.1
"""Share of the low mesh's radius: the drawing is pulled towards the viewer by at least this much, so that neither the low
object nor the high one around it shows through."""
SIDEWAYS = 3.0
"""Factor on the height of the highest bump: the drawing is pulled this far, because a bump seen from the side hides more."""
PROBES = 1000
"""How many vertices of all high meshes have their height over the low mesh measured, besides the outermost of each."""


@dataclass(frozen=True)
class Eye:
    """A view and its light.

    Attributes:
        view, projection (4, 4): From world to view space, and from view to clip space.
        light (4,): The direction of the light in the world and 0, or its position and 1.
    """

    view: np.ndarray
    projection: np.ndarray
    light: np.ndarray


@dataclass(frozen=True)
class ViewScene:
    """The batches that a view draws, with the normal matrices of their objects.

    Attributes:
        local_space: Of the batches, around the low mesh.
        pull: How far the drawing is pulled towards the viewer, in its units.
        low_to_world (4, 4): The matrix of the low object.
    """

    local_space: LocalSpace
    pull: float
    low: tuple[gpu.types.GPUBatch, np.ndarray]
    highs: list[tuple[gpu.types.GPUBatch, np.ndarray]]
    low_to_world: np.ndarray

    def part(self, low: Mesh) -> gpu.types.GPUBatch:
        """Some triangles of the low mesh, with UVs of their own."""
        positions = _positions(replace(low, to_world=self.low_to_world), self.local_space)
        return mesh_upload.upload(low.triangles, **low.tangent_space, position=positions)


class ViewObjects:
    """Places the objects of `subject`, with their meshes as last read."""

    def __init__(self, subject: Subject):
        self.subject = subject
        self._scene: ViewScene | None = None
        self._placed: tuple[Meshes, list[bytes]] | None = None
        self._near: tuple[tuple | None, BVHTree | None] = None, None

    @property
    def low(self) -> Mesh:
        """The low mesh, with tangents where the map has them."""
        meshes = self.subject.meshes
        return meshes.basis or meshes.low

    def upload_low(self, low: Mesh, **attributes: np.ndarray) -> gpu.types.GPUBatch:
        """The low mesh with its tangent space, and other attributes by corner."""
        return self.subject.upload(f"{low.name} as basis", low, **low.tangent_space, **attributes)

    def place(self, *, with_highs: bool) -> ViewScene | None:
        """The objects where they are now, without high objects that were deleted.

        Returns None if the low object was deleted, if an object has zero scale, or, `with_highs`, if a high one was deleted.
        """
        meshes = self.subject.meshes
        shown = [self.low, *meshes.highs]
        objects = [ref.find() for ref in self.subject.job.refs[: len(shown)]]
        if objects[0] is None or (with_highs and None in objects):
            return None
        shown = [mesh for mesh, obj in zip(shown, objects, strict=True) if obj is not None]
        matrices = [mesh_reader.matrix(obj) for obj in objects if obj is not None]
        if not all(np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3]) for matrix in matrices):
            return None
        bytes_of_matrices = [matrix.tobytes() for matrix in matrices]
        if self._placed is None or self._placed[0] is not meshes or self._placed[1] != bytes_of_matrices:
            low, *highs = (replace(mesh, to_world=matrix) for mesh, matrix in zip(shown, matrices, strict=True))
            self._scene, self._placed = self._scene_of(low, highs), (meshes, bytes_of_matrices)
        return self._scene

    def _scene_of(self, low: Mesh, highs: list[Mesh]) -> ViewScene:
        local_space = local_space_of([low])
        around, pull = local_space, PULL
        if highs and gap(low, highs) > 0.0:  # moved aside: drawn around the low mesh
            around = LocalSpace(local_space_of(highs).origin, local_space.size)
        elif highs:
            surface = self._surface(low, local_space)
            pull = max(
                PULL,
                SIDEWAYS * max(height_over(surface, local_space.points(high), PROBES // len(highs)) for high in highs),
            )
        return ViewScene(
            local_space,
            pull,
            (self.upload_low(low, position=_positions(low, local_space)), low.normal_matrix),
            [
                (
                    self.subject.upload(high.name, high, normal=high.normals, position=_positions(high, around)),
                    normal_matrix(high.to_world),
                )
                for high in highs
            ],
            low.to_world,
        )

    def _surface(self, low: Mesh, local_space: LocalSpace) -> BVHTree:
        """The low mesh as a tree for nearest points, built again only for another mesh."""
        key = low.triangles, low.positions, low.to_world.tobytes()
        known, surface = self._near
        if known is None or known[0] is not key[0] or known[1] is not key[1] or known[2] != key[2]:
            surface = BVHTree.FromPolygons(local_space.points(low).tolist(), low.vertices[low.triangles].tolist())
            self._near = key, surface
        return surface


def _positions(mesh: Mesh, local_space: LocalSpace) -> np.ndarray:
    return local_space.points(mesh)[mesh.vertices]


def height_over(surface: BVHTree, points: np.ndarray, count: int) -> float:
    """The greatest distance of points (V, 3) from a surface, over the outermost points and about `count` others."""
    outermost = [*points.argmin(axis=0), *points.argmax(axis=0)]
    probes = np.concatenate([points[outermost], points[:: -(-len(points) // max(1, count))]])
    return max(surface.find_nearest(probe)[3] or 0.0 for probe in probes.tolist())


def view_projection(eye: Eye, local_space: LocalSpace, pull: float) -> np.ndarray:
    """The matrix (4, 4) from `local_space` to clip space, with depths pulled towards the viewer by `pull` of its units.

    Pixels stay in place.
    """
    to_world = np.diag([*[local_space.size] * 3, 1.0])
    to_world[:3, 3] = local_space.origin
    projection, pull = np.array(eye.projection, np.float64), pull * local_space.size
    if projection[3, 3] == 0.0:  # perspective: points move along their rays by the same share of their distance
        distance = max(-(eye.view @ (*local_space.origin, 1.0))[2], 2.0 * pull)
        projection[2, 3] /= 1.0 - pull / distance
    else:
        projection[2, 3] += pull * projection[2, 2]
    return projection @ eye.view @ to_world
