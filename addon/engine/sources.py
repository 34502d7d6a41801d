# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources of normals and hits: high meshes drawn in UV space, rays, or both."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import TypeAlias

import gpu
import numpy as np

from ..core.declarations.choices import Method, Space
from ..core.errors import BakeError
from ..core.map_types import BY_NAME
from ..core.progress import SLICE_ROWS, Progress, Task, Timings, costs_of_rows
from ..core.settings import MapSettings, Run
from ..mesh import cutouts, uv_layout
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, high_in_uv, mesh_upload, samples, target
from ..passes.samples import Active
from . import ray_casting, ray_distances, tree_cache
from .bands import Band
from .high_meshes import HighBatches, HighSurface
from .planning import Plan

Slices: TypeAlias = Generator[tuple[gpu.types.GPUTexture, range], None, None]
"""Normals, and the rows of them that are ready, slice by slice."""


class Source(ABC):
    """Draws samples of a band: normals of the high surface, and hits, as shaders/lib/hit_lib.glsl reads them.

    The slot of a sample is a number: its normals and hits stay beside those of other slots.
    """

    takes_time = False
    """Whether it draws normals in slices."""
    is_within_low = False
    """Whether hits are only where the low mesh is."""
    ray_cast: ray_casting.RayCast | None = None
    """The rays that it casts."""
    share_of_rays = 0.0
    """The share of the low mesh's texels for which rays were cast."""
    surface: HighSurface | None
    """What the hits are on; None if no map needs them."""
    method: Method
    _size: tuple[int, int]
    """Of the last band."""

    @abstractmethod
    def normals(self, band: Band, slot: int = 0) -> Slices:
        """Unit normals in world space or the low object's: RGBA32F with alpha 1 for a hit, 0 outside the mesh, -1 for a miss.

        In slices: yields the texture and the rows that are ready. An empty range stops at the share of rows that is done.
        """

    @abstractmethod
    def covered(self, band: Band) -> np.ndarray:
        """How many texels (N,) of each SLICE_ROWS rows of a band have hits, about."""

    @abstractmethod
    def of_part(self, meshes: Meshes, is_drawn: np.ndarray | None, run: Run) -> "Source":
        """The same for some triangles of the low mesh.

        Args:
            meshes: with these triangles alone; by Flatten, with those triangles of the high meshes that are drawn for them.
            is_drawn: which triangles (T,) bool of the high meshes, mesh after mesh, these are; None with rays.
        """

    def drawn(self, slot: int = 0) -> target.Target:
        """The target of the last `normals` with this slot."""
        return target.get(_role("high", slot), *self._size, "RGBA32F")

    def hits(self, band: Band, slot: int = 0) -> target.Target:
        """The hits (RGBA32UI) of the last `normals` with this slot."""
        return target.get(_role("hits", slot), band.width, band.height, "RGBA32UI")


def normal_source(plan: Plan, run: Run, *, uploads: mesh_upload.UploadCache | None = None) -> Task[Source]:
    """The source of a bake. uploads: a cache of uploaded meshes. Raises BakeError for more triangles than the GPU takes, and
    for meshes that are far apart, if most rays miss."""
    meshes = plan.meshes
    if not plan.casts_rays:
        surface = None
        turns_normals = meshes.turns_normals(run.settings)
        if run.settings.map.drawn_maps or turns_normals or any(map(cutouts.has_layer, meshes.highs)):
            yield Progress("Reading the surface", 0.0)
            surface = _flat_surface(meshes.highs, run.settings.map, run.timings)
        return Flat(
            meshes.low,
            meshes.drawn_highs,
            run.settings.map,
            run.timings,
            surface=surface,
            is_drawn=meshes.is_drawn,
            is_changed_later=turns_normals,
            uploads=uploads,
        )
    ray_cast = yield from ray_distances.measured_rays(
        meshes, plan.tiles, run.settings, run.timings, has_clearances=plan.has_clearances
    )
    if plan.apart and ray_distances.share_of_hits(ray_cast, plan.tiles, run.settings) < ray_distances.LEAST_HITS:
        raise BakeError(plan.apart)
    if plan.has_rays:
        return FlatAndRays(meshes, ray_cast, run)
    return Rays(meshes, ray_cast, run)


def _flat_surface(highs: Sequence[Mesh], map_settings: MapSettings, timings: Timings) -> HighSurface:
    """What hits of Flatten are on, with a tree only if maps cast rays or edges are rounded."""
    if map_settings.edge_radius or any(BY_NAME[name].family.casts_rays for name in map_settings.drawn_maps):
        return HighSurface(highs, tree_cache.trees.ray_scene_of(highs, timings))
    return HighSurface(highs, tree_cache.without_tree(highs, timings))


class Flat(Source):
    """Draws `highs` in UV space.

    surface: the triangles, for hits. is_drawn: which of them (T,) bool, mesh after mesh, `highs` have; None for all. uploads: a
    cache of uploaded meshes.
    """

    method = Method.FLATTEN

    def __init__(
        self,
        low: Mesh,
        highs: Sequence[Mesh],
        map_settings: MapSettings,
        timings: Timings,
        *,
        surface: HighSurface | None = None,
        is_drawn: np.ndarray | None = None,
        is_changed_later: bool = False,
        uploads: mesh_upload.UploadCache | None = None,
    ):
        self.surface, self.is_drawn, self.timings = surface, is_drawn, timings
        self.is_changed_later = is_changed_later or self._cut is not None
        self.to_space = world_to_space(low, map_settings)
        to_world = None if map_settings.space == Space.WORLD else low.to_world
        self.batches = HighBatches(highs, to_world, timings, uploads)
        self._in_uv: tuple[gpu.types.GPUBatch, int] | None = None
        """For hits, and the number of its triangles."""
        self._covered = CoveredRows(highs)

    def of_part(self, meshes: Meshes, is_drawn: np.ndarray | None, run: Run) -> "Flat":
        return Flat(
            meshes.low,
            meshes.highs,
            run.settings.map,
            run.timings,
            surface=self.surface,
            is_drawn=is_drawn,
            is_changed_later=meshes.turns_normals(run.settings),
        )

    def covered(self, band: Band) -> np.ndarray:
        return self._covered.of(band)

    def normals(self, band: Band, slot: int = 0) -> Slices:
        """All rows at once; before, no rows while parts of the meshes are drawn."""
        self._size = band.width, band.height
        into = self.drawn(slot)
        if tables := self._cut:  # what is clear lies below all else: the hits know
            nowhere = target.get("no points", *self._size, "RGBA32F")
            target.clear(nowhere)
            cast.look_up(into, self.hits(band, slot), nowhere, tables, self.to_space)
            yield into.texture, range(band.height)
            return
        for done in self.batches.draw(into, band):
            row = int(done * band.height)
            yield into.texture, range(0 if done == 1.0 else row, row)

    @property
    def _cut(self) -> cast.Tables | None:
        """The tables of the high meshes, if these are clear somewhere."""
        return self.surface.tables if self.surface is not None and self.surface.tables.cutouts is not None else None

    def drawn(self, slot: int = 0) -> target.Target:
        make = target.get if self.is_changed_later else target.offscreen
        return make(_role("high", slot), *self._size, "RGBA32F")

    def hits(self, band: Band, slot: int = 0) -> target.Target:
        into = super().hits(band, slot)
        surface = self.surface
        if surface is None:
            raise ValueError("hits need the surface of the high meshes")
        if self._in_uv is None:
            numbers = surface.numbers if self.is_drawn is None else surface.numbers[self.is_drawn]
            with self.timings.timed("upload"):
                self._in_uv = high_in_uv.upload_for_hits(surface.uv, numbers), len(numbers)
        with self.timings.timed("draw"):
            high_in_uv.draw_hits(into, *self._in_uv, band.uv_to_clip, surface.tables.cutouts)
        return into


class Rays(Source):
    """Casts the rays of `ray_cast` from the low mesh to the high ones."""

    takes_time = True
    is_within_low = True
    share_of_rays = 1.0
    method = Method.CAST
    ray_cast: ray_casting.RayCast
    surface: HighSurface

    def __init__(self, meshes: Meshes, ray_cast: ray_casting.RayCast, run: Run):
        low = meshes.low
        self.ray_cast, self.settings, self.pace = ray_cast, run.settings.sampling, run.pace
        self.surface = HighSurface(meshes.highs, ray_cast.ray_scene)
        self.to_space = world_to_space(low, run.settings.map)
        self.low, self._near = low, NearTriangles(low)
        self._covered = CoveredRows([low])

    def of_part(self, meshes: Meshes, _is_drawn: np.ndarray | None, run: Run) -> "Rays":
        return Rays(meshes, self.ray_cast.of(meshes), run)

    def covered(self, band: Band) -> np.ndarray:
        return self._covered.of(band)

    def normals(self, band: Band, slot: int = 0) -> Slices:
        self._size = size = band.width, band.height
        rays = target.get("rays", *size, "RGBA32F", "RGBA32F")
        self.ray_cast.draw(rays, band.uv_to_clip)
        hits, normals = self.hits(band, slot), self.drawn(slot)
        if self.pace.has_listener:
            target.clear(normals)  # the picture must not show an earlier map
        left = self._left(rays, band)
        covered = self.covered(band)
        if not self.pace.has_listener:
            for _ in self.ray_cast.traced(hits, left, self.pace, covered=covered):
                pass
            self._join(hits, rays, left, range(band.height))
            self._look_up(normals, hits, rays, range(band.height))
            yield normals.texture, range(band.height)
            return
        for rows in self.ray_cast.traced(hits, left, self.pace, covered=covered):
            if rows:
                self._join(hits, rays, left, rows)
                self._look_up(normals, hits, rays, rows)
            yield normals.texture, rows

    def normals_of(self, band: Band, some: Active) -> Generator[gpu.types.GPUTexture | None, None, None]:
        """`normals` in some texels alone; others are left as they are, or cleared. Yields None after each slice, and at last
        the texture."""
        size = band.width, band.height
        rays = target.get("rays", *size, "RGBA32F", "RGBA32F")
        self._draw_some(rays, band, some)
        hits, normals = self.hits(band), target.get("high of some texels", *size, "RGBA32F")
        left = self._left(rays, band, some)
        for _ in self.ray_cast.traced(hits, left, self.pace, some):
            yield None
        self._join(hits, rays, left, None, some)
        self._look_up(normals, hits, rays, some=some)
        yield normals.texture

    def _draw_some(self, rays: target.Target, band: Band, some: Active) -> None:
        """Draw the rays of some texels."""
        self.ray_cast.draw(rays, band.uv_to_clip, some, self._near.parts(band, some))

    def _left(self, rays: target.Target, band: Band, some: Active | None = None) -> target.Target:
        """Those of `rays` that have to be cast."""
        return rays

    def _join(
        self,
        hits: target.Target,
        rays: target.Target,
        left: target.Target,
        rows: range | None,
        some: Active | None = None,
    ) -> None:
        """Add the hits of rays that were not cast."""

    def _look_up(
        self,
        normals: target.Target,
        hits: target.Target,
        rays: target.Target,
        rows: range | None = None,
        some: Active | None = None,
    ) -> None:
        cast.look_up(normals, hits, rays, self.ray_cast.ray_scene.tables, self.to_space, rows=rows, some=some)


class FlatAndRays(Rays):
    """Draws the high meshes in UV space, and casts rays from the low mesh where what is drawn is not at its own place.

    Both number the triangles alike, so that all maps take the hits as they are.
    """

    def __init__(self, meshes: Meshes, ray_cast: ray_casting.RayCast, run: Run):
        super().__init__(meshes, ray_cast, run)
        self._whole = meshes.whole
        numbers = self.surface.numbers if meshes.is_drawn is None else self.surface.numbers[meshes.is_drawn]
        uv = self.surface.uv
        numbers = numbers[np.isfinite(uv).reshape(-1, 6).all(axis=1)[numbers]]
        with run.timings.timed("upload"):
            self._in_uv = high_in_uv.upload_for_hits(uv, numbers), len(numbers)
        self._counts: dict[tuple[int, int], np.ndarray] = {}

    def of_part(self, meshes: Meshes, _is_drawn: np.ndarray | None, run: Run) -> "FlatAndRays":
        # All of the high meshes are drawn that the bake draws; which of it is a texel's own is seen there.
        return FlatAndRays(replace(meshes, whole=self._whole), self.ray_cast.of(meshes), run)

    @property
    def share_of_rays(self) -> float:
        """The share of the low mesh's texels for which rays were cast, of the first sample of each."""
        cast, covered = sum(self._counts.values(), np.zeros(2, int))
        return cast / max(1, covered)

    def _draw_some(self, rays: target.Target, band: Band, _some: Active) -> None:
        self.ray_cast.draw(rays, band.uv_to_clip)  # texels look at those around them

    def _left(self, rays: target.Target, band: Band, some: Active | None = None) -> target.Target:
        size = band.width, band.height
        hits = target.get("flat hits", *size, "RGBA32UI")
        clear = self.ray_cast.ray_scene.tables.cutouts
        high_in_uv.draw_hits(hits, *self._in_uv, band.uv_to_clip, clear, has_clear=False)
        normals, points = target.get("flat normals", *size, "RGBA32F"), target.get("rays left", *size, "RGBA32F")
        tables = self.ray_cast.ray_scene.tables
        cast.look_up(normals, hits, rays, tables, np.eye(3))
        owners = self.ray_cast.low.owners

        def draw_left(rows: range | None) -> None:
            high_in_uv.draw_left(points, rays, hits, normals, tables=tables, owners=owners, rows=rows, some=some)
            points.finish()

        if some:
            draw_left(None)
        else:
            costs = costs_of_rows(self.covered(band), band.width, high_in_uv.LEFT.cost)
            for _ in self.pace.slices("rays left", costs, band.height, draw_left):
                pass
            self._count(points, rays, band)
        left = target.Target.of(*size, "RGBA32F", points.texture)
        left.textures = [points.texture, rays.textures[1]]
        return left

    def _count(self, points: target.Target, rays: target.Target, band: Band) -> None:
        """Note the texels that have rays, and those of the low mesh, for the first sample of a band of the map."""
        key = band.tile, band.start
        if key in self._counts or band.size != self.settings.size:
            return
        rows = slice(band.halo, band.height - band.halo)
        self._counts[key] = np.array([np.count_nonzero(drawn.texels()[rows, :, 3]) for drawn in (points, rays)])

    def _join(
        self,
        hits: target.Target,
        rays: target.Target,
        left: target.Target,
        rows: range | None,
        some: Active | None = None,
    ) -> None:
        flat = target.get("flat hits", hits.width, hits.height, "RGBA32UI")
        high_in_uv.join_hits(hits, rays, left, flat, rows=rows, some=some)


def world_to_space(low: Mesh, map_settings: MapSettings) -> np.ndarray:
    """The matrix (3, 3) from world normals to the space in which sources draw normals."""
    matrix = low.to_world[:3, :3]
    return np.eye(3) if map_settings.space == Space.WORLD else matrix.T / np.abs(matrix).max()


class CoveredRows:
    """How many texels of each SLICE_ROWS rows some meshes cover, for the band that was asked for last."""

    def __init__(self, meshes: Sequence[Mesh]):
        self._meshes = meshes
        self._band: Band | None = None
        self._found = np.empty(0)

    def of(self, band: Band) -> np.ndarray:
        """As Source.covered has it."""
        band = replace(band, offset=(0.0, 0.0))
        if band != self._band:
            size = band.width, band.height
            self._band, self._found = band, uv_layout.covered_rows(self._meshes, band.uv_to_clip, size, SLICE_ROWS)
        return self._found


MOST_RANGES = 256
"""The most ranges of triangles that are drawn one after the other: with more, drawing them takes longer than what they save."""


class NearTriangles:
    """The triangles of `mesh` near the texels that were asked for last."""

    def __init__(self, mesh: Mesh):
        self.mesh = mesh
        self._some: Active | None = None
        self._parts: list[tuple[int, int]] = []

    def parts(self, band: Band, some: Active | None) -> list[tuple[int, int]] | None:
        """As target.draw takes them, for a batch with the triangles of the mesh in their order."""
        if some is None:
            return None
        if some is not self._some:
            self._some, self._parts = some, uv_layout.runs(_near(self.mesh, band, some), MOST_RANGES)
        return self._parts


def _near(mesh: Mesh, band: Band, some: Active) -> np.ndarray:
    """Which triangles (T,) bool may cover a sample of these texels."""
    size = band.width, band.height
    return uv_layout.touching(mesh, replace(band, offset=(0.0, 0.0)).uv_to_clip, size, some.blocks, samples.GROUP_SIDE)


def _role(name: str, slot: int) -> str:
    """The role of a target for samples in this slot, which stay beside those in other slots."""
    return f"{name} {slot}" if slot else name
