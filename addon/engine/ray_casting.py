# SPDX-License-Identifier: GPL-3.0-or-later
"""Prepares meshes for rays: a tree over all high triangles, which is cached, and the rays of the low mesh."""

import zlib
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gpu
import numpy as np

from ..core.errors import BakeError
from ..core.progress import Pace
from ..core.timings import Timings
from ..mesh import bvh
from ..mesh.local_space import LocalSpace, local_space_of
from ..mesh.triangle_mesh import Mesh
from ..passes import data_texture, mesh_upload, target
from ..passes.bake import cast

CACHE_BYTES = 1024 * 2**20
"""The most GPU memory for cached trees."""
CACHED_TREES = 4
"""The most trees in the cache. Each change of a high mesh adds a tree."""


@dataclass(frozen=True)
class RayScene:
    """What rays can hit: all high meshes.

    local_space: of the tree. tables: the tree on the GPU. order (T,) int: the triangles, numbered mesh after mesh, in the
    order of the tree.
    """

    local_space: LocalSpace
    tables: cast.Tables
    order: np.ndarray


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


class TreeCache:
    """Trees over high meshes, cached on the GPU while the meshes stay the same.

    most_bytes, most_trees: limits. Beyond them, the tree that was used longest ago is freed first.
    """

    def __init__(self, most_bytes: int = CACHE_BYTES, most_trees: int = CACHED_TREES):
        self.most_bytes, self.most_trees = most_bytes, most_trees
        self.built = 0
        """How many trees were built since the start."""
        self._scenes: OrderedDict[tuple, RayScene] = OrderedDict()

    def __len__(self) -> int:
        return len(self._scenes)

    @property
    def scenes(self) -> list[RayScene]:
        """The cached trees, the one used longest ago first."""
        return list(self._scenes.values())

    @property
    def bytes(self) -> int:
        """The GPU memory of the cached trees."""
        return sum(scene.tables.bytes for scene in self._scenes.values())

    def ray_scene_of(self, highs: Sequence[Mesh], timings: Timings) -> RayScene:
        """The tree over `highs`, built and uploaded unless it is cached.

        The key is the content, not the name: Blender does not report every change of a mesh.
        """
        with timings.timed("tree"):
            key = tuple(
                (zlib.crc32(np.ascontiguousarray(array)), array.shape)
                for mesh in highs
                for array in (mesh.positions, mesh.vertices, mesh.normals, mesh.triangles, mesh.to_world)
            )
            found = self._scenes.pop(key, None)
            if found is None:
                found = _build(highs, timings)
                self.built += 1
            self._scenes[key] = found
            while len(self) > 1 and (len(self) > self.most_trees or self.bytes > self.most_bytes):
                self._scenes.popitem(last=False)
        return found

    def trim(self) -> None:
        """Free all trees if together they hold more than `most_bytes`."""
        if self.bytes > self.most_bytes:
            self.free()

    def free(self) -> None:
        """Free all trees."""
        self._scenes.clear()


trees = TreeCache()
"""The cache that bakes share."""


def _build(highs: Sequence[Mesh], timings: Timings) -> RayScene:
    count, most = sum(len(high.triangles) for high in highs), data_texture.limit() // 3
    if count > most:
        raise BakeError(f"The high meshes have {count:,} triangles together; this GPU takes {most:,} to cast rays at.")
    local_space = local_space_of(highs)
    points, normals, vertices, corners = [], [], [], []
    points_before = corners_before = 0
    for high in highs:
        # A mirrored matrix reverses the winding, which decides whether a ray hits the front or the back.
        triangles = high.triangles[:, ::-1] if np.linalg.det(high.to_world[:3, :3]) < 0.0 else high.triangles
        points.append(local_space.points(high))
        normals.append(high.to_world_normals(high.normals))
        vertices.append(_shifted(points_before, np.take(high.vertices, triangles, mode="clip")))
        corners.append(_shifted(corners_before, triangles))
        points_before, corners_before = points_before + len(high.positions), corners_before + len(high.normals)
    points, normals, vertices, corners = (
        parts[0] if len(parts) == 1 else np.concatenate(parts) for parts in (points, normals, vertices, corners)
    )
    tree = bvh.build(points, vertices)
    with timings.timed("upload"):
        tables = cast.upload(
            tree.nodes,
            points,
            np.take(vertices, tree.order, axis=0),
            normals,
            np.take(corners, tree.order, axis=0),
            first_leaf=tree.first_leaf,
            origin=tree.origin,
            scale=tree.scale,
        )
    return RayScene(local_space, tables, tree.order)


def _shifted(count: int, numbers: np.ndarray) -> np.ndarray:
    """`numbers` plus `count`, without a copy if `count` is 0: the arrays are large."""
    return numbers + count if count else numbers


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
