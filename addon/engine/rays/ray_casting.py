# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of a bake: from the low mesh, or from its cage, to the high meshes. passes/bake/cast.py casts them."""

from collections.abc import Iterator
from dataclasses import dataclass

import gpu
import numpy as np

from ...core.progress import Pace
from ...mesh.local_space import LocalSpace
from ...mesh.triangle_mesh import Mesh
from ...passes import mesh_upload, target
from ...passes.bake import cast
from .tree_cache import RayScene


@dataclass(frozen=True)
class RayCast:
    """Rays from a low mesh to the high ones.

    ray_mesh: from `upload_ray_mesh`. extrusion, max_distance: in scene units. is_measured: whether at least one of the two
    distances was measured, not set.
    """

    ray_scene: RayScene
    ray_mesh: gpu.types.GPUBatch
    extrusion: float
    max_distance: float
    facing_only: bool
    is_measured: bool = False

    @property
    def start_offset(self) -> float:
        """As cast.trace takes it, in units of the scene's local space."""
        return self.extrusion / self.ray_scene.local_space.size

    @property
    def max_t(self) -> float:
        """As cast.trace takes it, in units of the scene's local space."""
        return self.max_distance / self.ray_scene.local_space.size

    def trace(self, hits: target.Target, rays: target.Target, pace: Pace | None = None) -> None:
        """Cast the `rays` that gbuffer.draw has written, as cast.trace does."""
        for _ in self.traced(hits, rays, pace or Pace()):
            pass

    def traced(self, hits: target.Target, rays: target.Target, pace: Pace) -> Iterator[range]:
        """As `trace`, in slices. Yields the rows that are done."""
        for rows in pace.slices(rays.height):
            cast.trace(
                hits,
                rays,
                self.ray_scene.tables,
                direction_sign=-1.0,
                start_offset=self.start_offset,
                max_t=self.max_t,
                facing_only=self.facing_only,
                rows=rows,
            )
            hits.finish()
            yield rows


def upload_ray_mesh(
    low: Mesh, directions: np.ndarray, cage: Mesh | None, local_space: LocalSpace
) -> gpu.types.GPUBatch:
    """The low mesh with the positions and directions of its rays, as gbuffer.draw takes it.

    directions (C, 3) float32: normals by corner, in the low mesh's space. With a cage, which has the same corners, rays
    start on it and point at the low mesh. Where the two touch, they follow the low mesh's normals.
    """
    positions = local_space.points(low)[low.vertices]
    away = low.to_world_normals(directions)
    if cage is not None:
        starts = local_space.points(cage)[cage.vertices]
        to_cage = starts - positions
        touching = np.linalg.norm(to_cage, axis=1) < 1e-6
        away = np.where(touching[:, None], away * np.float32(1e-6), to_cage)
        positions = starts
    return mesh_upload.upload(
        low.triangles,
        uv=low.uv,
        position=np.ascontiguousarray(positions),
        direction=np.ascontiguousarray(away, dtype=np.float32),
    )
