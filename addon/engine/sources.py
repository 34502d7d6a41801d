# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources of normals and other values: high meshes drawn in UV space, rays, or maps that were drawn before."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Protocol

import gpu
import numpy as np

from ..core.declarations.choices import Hit, Method, Space
from ..core.map_types import NORMAL
from ..core.progress import Pace, Progress, Task
from ..core.settings import Settings
from ..core.timings import Timings
from ..mesh.local_space import local_space_of
from ..mesh.triangle_mesh import Mesh, normal_matrix
from ..passes import data_texture, mesh_upload, target
from ..passes.bake import cast, flatten, points
from .bands import Band
from .method_choice import Plan
from .other_maps import OtherMaps
from .rays import ray_casting, ray_directions, ray_distances, tree_cache


class Source(Protocol):
    """Draws a band of the normal map and of the other maps.

    takes_time: whether it draws normals in slices. ray_cast: the rays that it casts, or None.
    """

    takes_time: bool
    ray_cast: ray_casting.RayCast | None

    def normals(self, band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        """Unit normals in world space or the low object's: RGBA32F with alpha 1 for a hit, 0 outside the mesh, -1 for a miss.

        In slices: yields the texture and the rows that are ready.
        """

    def surface_map(self, name: str, band: Band, into: target.Target) -> gpu.types.GPUTexture:
        """One of map_types.OTHERS for the band of the last `normals`, as other_map_pass.draw writes it.

        Returns the texture of `into`, or another texture.
        """


def normal_source(
    plan: Plan, settings: Settings, timings: Timings, pace: Pace, *, uploads: mesh_upload.UploadCache | None = None
) -> Task[Source]:
    """The source of a bake. uploads: a cache of uploaded meshes. Raises BakeError for more triangles than the GPU takes."""
    meshes = plan.meshes
    if plan.method == Method.FLATTEN:
        return Flat(meshes.low, meshes.highs, settings, timings, uploads=uploads)
    ray_cast = yield from _ray_cast(plan, settings, timings)
    return Rays(meshes.low, ray_cast, meshes.highs, settings, pace)


def _ray_cast(plan: Plan, settings: Settings, timings: Timings) -> Task[ray_casting.RayCast]:
    """The rays of a bake. Distances that the settings do not set are measured."""
    meshes, has_cage = plan.meshes, plan.meshes.cage is not None
    yield Progress("Building the tree", 0.0)
    ray_scene = tree_cache.trees.ray_scene_of(meshes.highs, timings)
    low_surface = tree_cache.trees.low_surface_of(meshes.low, ray_scene.local_space, timings)
    yield Progress("Measuring distances", 0.5)
    with timings.timed("upload"):
        ray_mesh = ray_casting.upload_ray_mesh(meshes, low_surface, ray_scene.local_space)
    with timings.timed("distances"):
        directions = ray_directions.choose(settings.directions, meshes, low_surface, ray_scene.tables)
    # With a cage, rays start exactly on it.
    extrusion, max_distance = 0.0 if has_cage else settings.extrusion, settings.max_distance
    is_measured = extrusion is None or max_distance is None
    if is_measured:
        with timings.timed("distances"):
            unit = ray_scene.local_space.size
            # What is painted scales the measured distance, and does not change it.
            unpainted = replace(meshes, offset=None)
            probe = ray_distances.Probe(
                ray_scene.tables,
                ray_mesh
                if meshes.offset is None
                else ray_casting.upload_ray_mesh(unpainted, low_surface, ray_scene.local_space),
                directions,
                (settings.width, settings.height),
                plan.tiles,
            )
            outside, inside = ray_distances.measure(probe, has_cage=has_cage, facing_only=settings.facing_only)
            if settings.hit == Hit.OWN and not has_cage:
                length = None if max_distance is None else max_distance / unit
                outside, inside = ray_distances.with_room((outside, inside), length, probe, low_surface.owners)
        extrusion = outside * unit if extrusion is None else extrusion
        # Measured from the low surface; rays start `extrusion` outside it.
        max_distance = extrusion + inside * unit if max_distance is None else max_distance
    return ray_casting.RayCast(
        ray_scene,
        low_surface,
        ray_mesh,
        directions,
        Hit(settings.hit),
        extrusion,
        max_distance,
        settings.facing_only,
        has_cage,
        is_measured,
    )


class Flat:
    """Draws `highs` in UV space. uploads: a cache of uploaded meshes."""

    takes_time = False
    ray_cast = None

    def __init__(
        self,
        low: Mesh,
        highs: Sequence[Mesh],
        settings: Settings,
        timings: Timings,
        *,
        uploads: mesh_upload.UploadCache | None = None,
    ):
        uploads = uploads or mesh_upload.UploadCache()
        to_world = None if settings.space == Space.WORLD else low.to_world
        with timings.timed("upload"):
            self.drawn = [
                (
                    uploads.upload(high.name, high.triangles, uv=high.uv, normal=high.normals),
                    normal_matrix(high.to_world, to_world),
                )
                for high in highs
            ]
            if settings.maps:
                self.other_maps = OtherMaps(low, local_space_of([low]), settings)
                self.surfaces = [
                    mesh_upload.upload(
                        high.triangles,
                        uv=high.uv,
                        position=self.other_maps.local_space.points(high)[high.vertices],
                        labels=_labels_by_corner(high),
                    )
                    for high in highs
                ]

    def normals(self, band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        """As Source has it, all rows at once, in a GPUOffScreen."""
        self._normals, self._points = target.offscreen("high", band.width, band.height, "RGBA32F"), None
        flatten.draw(self._normals, self.drawn, band.uv_to_clip)
        yield self._normals.texture, range(band.height)

    def surface_map(self, name: str, band: Band, into: target.Target) -> gpu.types.GPUTexture:
        """As Source has it."""
        if self._points is None:
            self._points = target.get("points", band.width, band.height, "RGBA32F", "RGBA32F")
            points.draw(self._points, self.surfaces, band.uv_to_clip)
            self.other_maps.start(band)
        return self.other_maps.draw(into, name, self._normals.texture, self._points)


class Rays:
    """Casts the rays of `ray_cast` from `low` to `highs`."""

    takes_time = True

    def __init__(self, low: Mesh, ray_cast: ray_casting.RayCast, highs: Sequence[Mesh], settings: Settings, pace: Pace):
        self.ray_cast, self.settings, self.pace = ray_cast, settings, pace
        ray_scene = ray_cast.ray_scene
        matrix = low.to_world[:3, :3]
        self.to_space = np.eye(3) if settings.space == Space.WORLD else matrix.T / np.abs(matrix).max()
        if settings.maps:
            self.other_maps = OtherMaps(low, ray_scene.local_space, settings)
            self.labels = data_texture.upload(
                np.pad(np.concatenate([high.labels for high in highs])[ray_scene.order], ((0, 0), (0, 1)))
            )

    def normals(self, band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        """As Source has it."""
        size = band.width, band.height
        rays = target.get("rays", *size, "RGBA32F", "RGBA32F")
        self.ray_cast.draw(rays, band.uv_to_clip)
        self._hits = target.get("hits", *size, "RGBA32UI")
        self._normals, self._points = target.get("high", *size, "RGBA32F"), None
        if not self.pace.has_listener:
            self.ray_cast.trace(self._hits, rays, self.pace)
            self._look_up(rays, range(band.height))
            yield self._normals.texture, range(band.height)
            return
        target.clear(self._normals)  # the picture must not show an earlier map
        for rows in self.ray_cast.traced(self._hits, rays, self.pace):
            self._look_up(rays, rows)
            yield self._normals.texture, rows

    def _look_up(self, rays: target.Target, rows: range) -> None:
        cast.look_up(self._normals, self._hits, rays, self.ray_cast.ray_scene.tables, self.to_space, rows=rows)

    def surface_map(self, name: str, band: Band, into: target.Target) -> gpu.types.GPUTexture:
        """As Source has it."""
        if self._points is None:
            self._points = target.get("points", band.width, band.height, "RGBA32F", "RGBA32F")
            cast.points(self._points, self._hits, self.ray_cast.ray_scene.tables, self.labels)
            self.other_maps.start(band)
        return self.other_maps.draw(into, name, self._normals.texture, self._points)


class DrawnMaps:
    """Maps that were drawn before, by name, (height, width, 4) float32 as rendering.Renderer.raw returns them."""

    takes_time = False
    ray_cast = None

    def __init__(self, maps: dict[str, np.ndarray]):
        self.maps = maps

    def normals(self, band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        """As Source has it, all rows at once."""
        yield self._upload(NORMAL.name, band), range(band.height)

    def surface_map(self, name: str, band: Band, _into: target.Target) -> gpu.types.GPUTexture:
        """As Source has it."""
        return self._upload(name, band)

    def _upload(self, name: str, band: Band) -> gpu.types.GPUTexture:
        values = np.zeros((band.height, band.width, 4), np.float32)
        first, last = band.start - band.halo, band.stop + band.halo
        uploads = slice(max(0, first), min(last, len(self.maps[name])))
        values[uploads.start - first : uploads.stop - first] = self.maps[name][uploads]
        data = gpu.types.Buffer("FLOAT", values.shape, values)
        return gpu.types.GPUTexture((band.width, band.height), format="RGBA32F", data=data)


def _labels_by_corner(mesh: Mesh) -> np.ndarray:
    """The labels (C, n) float32 by corner; no two faces share a corner."""
    values = np.zeros((len(mesh.vertices), mesh.labels.shape[1]), np.float32)
    values[mesh.triangles] = mesh.labels[:, None]
    return values
