# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the maps whose rays start at the hits: ambient occlusion and bent normals, thickness, curvature."""

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar

import gpu
import numpy as np

from ...core.map_types import BY_NAME, Family, Kind
from ...core.progress import Progress, Task
from ...core.settings import Run
from ...mesh.triangle_mesh import Mesh
from ...passes import target
from ...passes.bake import preview_picture
from ...passes.hemisphere import curvature, lattice, openness, thickness
from ..bands import Band
from ..high_surface import HighSurface
from . import ray_reach
from .family import MapFamily, Sample
from .normal_space import NormalSpace


class RayMaps(MapFamily):
    """Draws the maps of one family with these names. Its rays go into one texture of sums."""

    family: ClassVar[Family]
    title: ClassVar[str]

    def __init__(self, names: Sequence[str], surface: HighSurface, run: Run):
        self.names, self.surface, self.run = names, surface, run
        settings = run.settings
        # Each sample casts as many, so that texels of which only some samples hit keep their mean.
        self.rays = settings.sampling.samples * math.ceil(settings.tracing.rays / settings.sampling.samples)
        self.lattice = lattice.of(self.rays)
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
        rays = lattice.rays_of_sample(self.lattice, sample.number, count)
        done = 0
        for rows, some, is_first in lattice.slices(self.run.pace, band.height, rays, self.title):
            with self.run.timings.timed("draw"):
                self._cast(sums, sample.hits.texture, some, rows, is_first=is_first and sample.number == 0)
                sums.finish()
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
        into = target.get("mean", sums.width, sums.height, "RGBA32F")
        self._values(self.names[0], into, sums, sample.normals.texture, rays)
        size = self.run.settings.sampling.width, self.run.settings.sampling.height
        is_first = self._picture is None  # the picture may still show the normal map
        self._picture = preview_picture.draw(into.texture, size, np.eye(3), clear=is_first, is_value=True)

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
        into = target.get("mean", band.width, band.height, "RGBA32F")
        self._values(name, into, self._sums(band), known, rays)
        return into.texture

    @abstractmethod
    def _cast(
        self, sums: target.Target, hits: gpu.types.GPUTexture, rays: range, rows: range, *, is_first: bool
    ) -> None:
        """Add rays to the sums in these rows."""

    @abstractmethod
    def _values(
        self, name: str, into: target.Target, sums: target.Target, known: gpu.types.GPUTexture, rays: float
    ) -> None:
        """Write the values of a map."""


class OpennessMaps(RayMaps):
    """Ambient occlusion and bent normals."""

    family = Family.OPENNESS
    title = "Casting rays for occlusion"

    def __init__(
        self,
        names: Sequence[str],
        surface: HighSurface,
        run: Run,
        *,
        others: Sequence[Mesh],
        to_space: np.ndarray,
        space: NormalSpace,
    ):
        super().__init__(names, surface, run)
        self.to_space, self.space = to_space, space
        self.occluders = ray_reach.occluders(surface, others, run.settings.tracing, run.timings)

    def _cast(self, sums, hits, rays, rows, *, is_first):
        tables = self.surface.tables
        openness.add(sums, hits, tables, self.occluders, lattice=self.lattice, rays=rays, rows=rows, is_first=is_first)

    def _values(self, name, into, sums, known, rays):
        if BY_NAME[name].kind is Kind.NORMAL:
            openness.bent_normals(into, sums, known, rays, self.to_space, is_unit=True)
        else:
            openness.ambient_occlusion(into, sums, known, rays)

    def _draw(self, name, band, known, rays):
        drawn = super()._draw(name, band, known, rays)
        return self.space.of_texels(drawn, band, "bent") if BY_NAME[name].kind is Kind.NORMAL else drawn


class ThicknessMaps(RayMaps):
    """Thickness."""

    family = Family.THICKNESS
    title = "Casting rays for thickness"

    def _cast(self, sums, hits, rays, rows, *, is_first):
        space = self.surface.local_space
        farthest = ray_reach.thickness_distance(self.run.settings.tracing, space) / space.size
        thickness.add(
            sums,
            hits,
            self.surface.tables,
            farthest=farthest,
            lattice=self.lattice,
            rays=rays,
            rows=rows,
            is_first=is_first,
        )

    def _values(self, _name, into, sums, known, rays):
        thickness.values(into, sums, known, rays)


class CurvatureMaps(RayMaps):
    """Curvature, and its two halves."""

    family = Family.CURVATURE
    title = "Casting rays for curvature"
    VALUES = (curvature.values, curvature.convexity, curvature.cavity)
    """By the index of the map."""

    def _cast(self, sums, hits, rays, rows, *, is_first):
        space = self.surface.local_space
        radius = ray_reach.curvature_radius(self.run.settings.tracing, space) / space.size
        curvature.add(
            sums,
            hits,
            self.surface.tables,
            radius=radius,
            lattice=self.lattice,
            rays=rays,
            rows=rows,
            is_first=is_first,
        )

    def _values(self, name, into, sums, known, rays):
        self.VALUES[BY_NAME[name].index](into, sums, known, rays)
