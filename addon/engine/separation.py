# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the vectors from the low surface to the high one, texel by texel."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import gpu
import numpy as np

from ..core import udim
from ..core.declarations.choices import Method
from ..core.settings import TracingSettings
from ..core.udim import UvToClip
from ..mesh import uv_layout
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, local_space_of, world_box
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, high_in_uv, mesh_upload, target
from . import ray_casting
from .high_meshes import DENSE

PROBE_SIZE = 128
"""Texels a side, at most, of a quick sample."""
TRIANGLES = 2**16
"""The most triangles of a high mesh that a quick sample draws. Of a larger mesh it draws every second, third, ..."""
LIMIT = 0.05
"""Share of the low mesh's radius: the limit for the distance between the surfaces if the settings have none."""

CENTERS_APART, LARGER, FLAT_SIDE = 0.15, 1.5, 0.1
"""Boxes around high and low fit each other if, along each axis, their centers are no more than this share of the low box's
side apart, and neither side is more than this many times the other. Sides of the low box shorter than this share of its
longest one do not count: there, the detail may be larger."""

Probe = Callable[[tuple[int, int], UvToClip], np.ndarray]
"""A function from (width, height) and uv_to_clip to texels (height, width, 4) float32. w: 1 where both meshes are, -1 where
there is only the low mesh, 0 outside it. xyz: where both are, the vector from the low point to the high one, in scene units
and world space."""


def full_probe(meshes: Meshes, ray_cast: ray_casting.RayCast | None) -> Probe:
    """Measures along the rays of a bake. Without rays, measures between meshes that are drawn in UV space."""
    return _ray_probe(ray_cast) if ray_cast else flat_probe(meshes.low, meshes.drawn_highs)


def quick_probe(meshes: Meshes) -> Probe:
    """As `full_probe` without rays, but it draws at most TRIANGLES of each high mesh."""
    return flat_probe(meshes.low, [high.with_triangles(_every(high)) for high in meshes.drawn_highs])


def limit(low: Mesh, tracing: TracingSettings) -> float:
    """The greatest distance between points of one texel that is not reported, in scene units."""
    return usual_limit(low) if tracing.limit is None else tracing.limit


def usual_limit(low: Mesh) -> float:
    """As `limit`, if the settings have none."""
    return LIMIT * local_space_of([low]).size


def boxes_fit(meshes: Meshes, *, may_be_part: bool = False) -> bool:
    """Whether the high meshes have about the place and size of the low one. may_be_part: whether it is enough that they extend
    beyond the low mesh on all sides."""
    (low_min, low_max), (high_min, high_max) = world_box([meshes.low]), world_box(meshes.highs)
    sides, high_sides = low_max - low_min, high_max - high_min
    compared = sides > FLAT_SIDE * sides.max()
    if may_be_part and (high_min <= low_min)[compared].all() and (high_max >= low_max)[compared].all():
        return True
    is_apart = np.abs((low_min + low_max) - (high_min + high_max)) / 2.0 > CENTERS_APART * sides
    larger = np.maximum(high_sides, sides) > LARGER * np.minimum(high_sides, sides)
    return not (is_apart | larger)[compared].any()


def sample(probe: Probe, size: tuple[int, int], tiles: Sequence[int]) -> np.ndarray:
    """The texels of `probe` for a map of `size`, at most PROBE_SIZE a side: (tiles, height, width, 4) float32."""
    small = min(size[0], PROBE_SIZE), min(size[1], PROBE_SIZE)
    return np.stack([probe(small, udim.uv_to_clip(tile)) for tile in tiles])


def offset(texels: np.ndarray, method: str) -> np.ndarray:
    """The offset (3,) between the high meshes and the low one as wholes, from texels (..., 4) of a Probe.

    For Flatten, the meshes may be side by side in the scene, and the offset does not count as a distance. For rays it is 0.
    """
    # Points very far from the low mesh overflow single precision.
    together = texels[(texels[..., 3] > 0.0) & np.isfinite(texels).all(axis=-1)]
    if method != Method.FLATTEN or not len(together):
        return np.zeros(3, np.float32)
    return np.median(together[:, :3], axis=0)


def distances(texels: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """The distances (...) float32 of texels (..., 4), minus the offset (3,); -1 where one of the meshes is missing."""
    x, y, z = (texels[..., axis] - offset[axis] for axis in range(3))
    far = np.hypot(np.hypot(x, y), z)  # the squares may overflow single precision
    return np.where(texels[..., 3] > 0.0, far, np.float32(-1.0))


def flat_probe(low: Mesh, highs: Sequence[Mesh]) -> Probe:
    """Measures between meshes that are drawn in UV space."""
    local_space = local_space_of([low])
    on_low, on_high = PointMeshes([low], local_space), PointMeshes(highs, local_space)

    def probe(size: tuple[int, int], uv_to_clip: UvToClip) -> np.ndarray:
        below, above = on_low.draw(size, uv_to_clip), on_high.draw(size, uv_to_clip)
        is_low_only = above[..., 3] == 0.0
        above -= below
        above *= np.float32(local_space.size)
        above[..., 3] = np.where(is_low_only, -below[..., 3], below[..., 3])
        return above

    return probe


def thinned(mesh: Mesh) -> Mesh:
    """`mesh`, or every second, third, ... of its triangles, so that at most TRIANGLES remain."""
    every = _every(mesh)
    return mesh if every.step == 1 else _alone(mesh, every)


def _every(mesh: Mesh) -> slice:
    """The triangles that `thinned` keeps."""
    return slice(None, None, max(1, -(-len(mesh.triangles) // TRIANGLES)))


def _alone(mesh: Mesh, kept: np.ndarray | slice) -> Mesh:
    """Some triangles of `mesh` with nothing but the points and UVs that they need."""
    corners = mesh.triangles[kept].reshape(-1)
    numbers = np.arange(len(corners), dtype=np.int32)
    vertices = np.take(mesh.vertices, corners, mode="clip")
    return replace(
        mesh,
        positions=np.take(mesh.positions, vertices, axis=0, mode="clip"),
        vertices=numbers,
        uv=np.take(mesh.uv, corners, axis=0, mode="clip"),
        triangles=numbers.reshape(-1, 3),
    )


def _ray_probe(ray_cast: ray_casting.RayCast) -> Probe:
    """Measures along rays."""
    unit = np.float32(ray_cast.ray_scene.local_space.size)

    def probe(size: tuple[int, int], uv_to_clip: UvToClip) -> np.ndarray:
        rays = target.get("audit rays", *size, "RGBA32F", "RGBA32F")
        hits = target.get("audit hits", *size, "RGBA32UI")
        into = target.get("audit far", *size, "RGBA32F")
        ray_cast.draw(rays, uv_to_clip)
        ray_cast.trace(hits, rays)
        cast.heights(into, hits, rays)
        heights, away = into.texels(), rays.texels(1)
        away[..., :3] *= (heights[..., :1] + np.float32(ray_cast.offset)) * unit
        away[..., 3] = heights[..., 3]
        return away

    return probe


class PointMeshes:
    """Meshes whose points are drawn in UV space. Of a dense mesh, only triangles over the centers of texels are uploaded."""

    def __init__(self, meshes: Sequence[Mesh], local_space: LocalSpace):
        self.meshes, self.local_space = meshes, local_space
        self._whole: dict[int, gpu.types.GPUBatch] = {}

    def draw(self, size: tuple[int, int], uv_to_clip: UvToClip) -> np.ndarray:
        """As `draw_points`."""
        return draw_points(list(self._uploaded(size, uv_to_clip)), size, uv_to_clip)

    def _uploaded(self, size: tuple[int, int], uv_to_clip: UvToClip) -> Iterator[gpu.types.GPUBatch]:
        for number, mesh in enumerate(self.meshes):
            if len(mesh.triangles) > DENSE * size[0] * size[1] or 3 * len(mesh.triangles) < len(mesh.vertices):
                kept = uv_layout.over_centers(mesh, uv_to_clip, size)
                if len(kept):
                    yield upload(_alone(mesh, kept), self.local_space)
            else:
                if number not in self._whole:
                    self._whole[number] = upload(mesh, self.local_space)
                yield self._whole[number]


def upload(mesh: Mesh, local_space: LocalSpace) -> gpu.types.GPUBatch:
    """`mesh` as `draw_points` takes it."""
    return mesh_upload.upload(
        mesh.triangles,
        uv=mesh.uv,
        position=np.take(local_space.points(mesh), mesh.vertices, axis=0),
        labels=np.zeros_like(mesh.uv),
    )


def draw_points(meshes: Sequence[gpu.types.GPUBatch], size: tuple[int, int], uv_to_clip: UvToClip) -> np.ndarray:
    """The points, in local space, of `meshes` drawn in UV space: (height, width, 4) float32, alpha 0 where there is no mesh."""
    drawn = target.get("audit points", *size, "RGBA32F", "RGBA32F")
    high_in_uv.draw_points(drawn, meshes, uv_to_clip)
    return drawn.texels()
