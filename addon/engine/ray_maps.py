# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the maps whose rays start at the hits: ambient occlusion and bent normals, thickness, curvature."""

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

import gpu
import numpy as np

from ..core.declarations.choices import DistanceUnit, Fade, Occluders
from ..core.declarations.map_settings import CURVATURE_SHARE, THICKNESS_SHARE
from ..core.map_types import BY_NAME, Family, Kind
from ..core.progress import Progress, Task, Timings
from ..core.settings import Settings, TracingSettings
from ..mesh.local_space import LocalSpace
from ..mesh.triangle_mesh import Mesh
from ..passes import hemisphere, target, viewport
from ..passes.shader import Program
from . import tree_cache
from .bands import Band
from .high_meshes import HighSurface
from .map_families import FamilyInputs, MapFamily, Sample, value_of


class RayMaps(MapFamily):
    """Maps by rays from the hits, which go into one texture of sums."""

    title: ClassVar[str]
    program: ClassVar[Program]
    """That casts the rays."""
    values: ClassVar[tuple[hemisphere.Value, ...]]
    """By the index of the map."""

    def __init__(self, names: Sequence[str], inputs: FamilyInputs):
        self.names, self.surface, self.run = names, inputs.surface, inputs.run
        settings = inputs.run.settings
        # Each sample casts as many, so that texels of which only some samples hit keep their mean.
        self.rays = settings.sampling.samples * math.ceil(settings.tracing.rays / settings.sampling.samples)
        self.lattice = hemisphere.lattice_of(self.rays)
        self.effort = 0.7 * self.rays / settings.sampling.samples
        self._picture: gpu.types.GPUTexture | None = None

    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        if self.run.pace.has_listener and drawn[0].number == 0:
            target.clear(self._sums(drawn[0].band))  # the picture shows rows that are not drawn yet
            self._picture = None
        for number, sample in enumerate(drawn):
            for share in self._of_sample(sample):
                if self.run.pace.has_listener:
                    yield Progress(self.title, (number + share) / len(drawn), self._picture)

    def _of_sample(self, sample: Sample) -> Iterator[float]:
        """Cast the rays of one sample, in slices. Yields the finished share."""
        band, count = sample.band, self.run.settings.sampling.samples
        sums = self._sums(band)
        rays = hemisphere.rays_of_sample(self.lattice, sample.number, count)
        tables, done = self.surface.tables, 0

        def cast(rows: range, some: range, is_first: bool) -> None:
            with self.run.timings.timed("draw"):
                is_start = is_first and sample.number == 0
                first_row = band.start - band.halo
                shared = sample.hits.texture, tables, self.lattice
                self._cast(sums, hemisphere.Rays(*shared, some, rows, is_start, first_row))

        size = band.width, band.height
        for rows, some, is_first in hemisphere.slices(
            self.run.pace, self.program, size, sample.covered, rays, draw=cast
        ):
            done += len(some) * len(rows)
            # All rows of the picture have as many rays, or none yet.
            if is_first and sample.number == 0:
                if self.run.pace.takes_picture():
                    self._show(sums, sample, len(some))
            elif rows.stop == band.height:
                self._show(sums, sample, self.rays * sample.number / count + done / band.height)
            yield done / (len(rays) * band.height)

    def _show(self, sums: target.Target, sample: Sample, rays: float) -> None:
        """Draw the picture of the rays so far."""
        if not (self.run.pace.has_listener and self.run.pace.has_picture and sample.band.is_whole):
            return
        into = value_of(sample.band)
        self._values(self.names[0], into, sums, sample.normals.texture, rays)
        size = self.run.settings.sampling.width, self.run.settings.sampling.height
        is_first = self._picture is None  # the picture may still show the normal map
        self._picture = viewport.draw_preview(into.texture, size, np.eye(3), clear=is_first, is_value=True)

    def finished(self, band: Band, known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        # Where several samples are summed, each has cast its share of the rays.
        rays = self.rays / self.run.settings.sampling.samples
        for name in self.names:
            with self.run.timings.timed("draw"):
                drawn = self._draw(name, band, known, rays)
            yield name, drawn

    def _sums(self, band: Band) -> target.Target:
        return target.get(f"sums of {self.title}", band.width, band.height, "RGBA32F")

    def _draw(self, name: str, band: Band, known: gpu.types.GPUTexture, rays: float) -> gpu.types.GPUTexture:
        into = value_of(band)
        self._values(name, into, self._sums(band), known, rays)
        return into.texture

    @abstractmethod
    def _cast(self, sums: target.Target, rays: hemisphere.Rays) -> None:
        """Add rays to the sums."""

    def _values(
        self, name: str, into: target.Target, sums: target.Target, known: gpu.types.GPUTexture, rays: float
    ) -> None:
        """Write the values of a map."""
        hemisphere.mean(into, sums, known, rays, self.values[BY_NAME[name].index])


class OpennessMaps(RayMaps):
    """Ambient occlusion and bent normals."""

    family = Family.OPENNESS
    title = "Casting rays for occlusion"
    program = hemisphere.ADD_OPENNESS
    values = (hemisphere.OCCLUSION,)

    def __init__(self, names: Sequence[str], inputs: FamilyInputs):
        super().__init__(names, inputs)
        self.to_space, self.space = inputs.to_space, inputs.space
        meshes, run = inputs.meshes, inputs.run
        found = occluders(self.surface, meshes.others, run.settings.tracing, run.timings)
        self.occluders = replace(found, from_inside=meshes.is_own_base)

    def _cast(self, sums: target.Target, rays: hemisphere.Rays) -> None:
        hemisphere.add_openness(sums, rays, self.occluders)

    def _values(self, name, into, sums, known, rays):
        if BY_NAME[name].kind is Kind.NORMAL:
            hemisphere.bent_normals(into, sums, known, rays, self.to_space, is_unit=True)
        else:
            super()._values(name, into, sums, known, rays)

    def _draw(self, name, band, known, rays):
        drawn = super()._draw(name, band, known, rays)
        return self.space.of_texels(drawn, band, "bent") if BY_NAME[name].kind is Kind.NORMAL else drawn


class ThicknessMaps(RayMaps):
    """Thickness."""

    family = Family.THICKNESS
    title = "Casting rays for thickness"
    program = hemisphere.ADD_THICKNESS
    values = (hemisphere.THICKNESS,)

    def _cast(self, sums: target.Target, rays: hemisphere.Rays) -> None:
        space = self.surface.local_space
        hemisphere.add_thickness(sums, rays, thickness_distance(self.run.settings.tracing, space) / space.size)


class CurvatureMaps(RayMaps):
    """Curvature, and its two halves."""

    family = Family.CURVATURE
    title = "Casting rays for curvature"
    program = hemisphere.ADD_CURVATURE
    values = (hemisphere.CURVATURE, hemisphere.CONVEXITY, hemisphere.CAVITY)

    def _cast(self, sums: target.Target, rays: hemisphere.Rays) -> None:
        space = self.surface.local_space
        hemisphere.add_curvature(sums, rays, curvature_radius(self.run.settings.tracing, space) / space.size)


WITH_MEANING = Family.THICKNESS, Family.CURVATURE
"""The families of maps that `meanings` explains."""


def in_scene(distance: float, tracing: TracingSettings, space: LocalSpace) -> float:
    """A distance of the settings in scene units. space: of the high meshes; its size is half of their diagonal."""
    return distance * 2.0 * space.size if tracing.distance_unit == DistanceUnit.DIAGONAL else distance


def thickness_distance(tracing: TracingSettings, space: LocalSpace) -> float:
    """In scene units."""
    share = tracing.thickness_distance
    return THICKNESS_SHARE * 2.0 * space.size if share is None else in_scene(share, tracing, space)


def curvature_radius(tracing: TracingSettings, space: LocalSpace) -> float:
    """In scene units."""
    share = tracing.curvature_radius
    return CURVATURE_SHARE * 2.0 * space.size if share is None else in_scene(share, tracing, space)


def meanings(settings: Settings, space: LocalSpace) -> dict[str, dict[str, float]]:
    """What the values of maps mean, by name: (value - midlevel) * scale is a length or a curvature in scene units.

    The scales of curvature are those of hemisphere.mean_curvature_scale: positive is convex.
    """
    to_curvature = hemisphere.mean_curvature_scale(curvature_radius(settings.tracing, space))
    by_family = {
        Family.THICKNESS: [(0.0, thickness_distance(settings.tracing, space))],
        Family.CURVATURE: [(0.5, to_curvature), (0.0, 0.5 * to_curvature), (0.0, -0.5 * to_curvature)],
    }
    encodings = {}
    for name in settings.map.drawn_maps:
        if BY_NAME[name].family in by_family:
            midlevel, scale = by_family[BY_NAME[name].family][BY_NAME[name].index]
            encodings[name] = {"midlevel": midlevel, "scale": scale}
    return encodings


def occluders(
    surface: HighSurface, others: Sequence[Mesh], tracing: TracingSettings, timings: Timings
) -> hemisphere.Occluders:
    """What blocks the rays of ambient occlusion. others: meshes of other objects that block them."""
    space = surface.local_space
    tables, scale, offset = None, 1.0, (0.0, 0.0, 0.0)
    highs = [high for high in surface.highs if not high.is_floater]
    is_other = len(highs) < len(surface.highs)
    if tracing.occluders != Occluders.OWN and others:
        # In the same order for all low objects, which then share a tree.
        highs, is_other = sorted([*highs, *others], key=lambda high: high.name), True
    if not highs:  # all of them float
        return hemisphere.Occluders(farthest=0.0)
    if is_other:
        ray_scene = tree_cache.trees.ray_scene_of(highs, timings, repeat=surface.ray_scene.repeat)
        tables, all_space = ray_scene.tables, ray_scene.local_space
        scale = space.size / all_space.size
        offset = tuple(((space.origin - all_space.origin) / all_space.size).tolist())
    farthest = None if tracing.ao_distance is None else in_scene(tracing.ao_distance, tracing, space)
    fade, repeat = tracing.ao_fade, surface.ray_scene.repeat
    if farthest is None and repeat is not None and len(repeat.moves):
        # From every place, as much of the tiles around counts.
        farthest, fade = repeat.reach, Fade.NONE
    return hemisphere.Occluders(
        tables,
        scale,
        offset,
        farthest=None if farthest is None else farthest / space.size,
        fade=fade,
        two_sided=tracing.two_sided,
        bias=math.radians(tracing.bias_angle),
        floor=min(_lowest(high, space) for high in highs) if tracing.floor else None,
    )


def _lowest(mesh: Mesh, space: LocalSpace) -> float:
    """The lowest z of the vertices that triangles of `mesh` use."""
    return float(space.points(mesh)[mesh.vertices[mesh.triangles.reshape(-1)], 2].min())
