# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the roughness of the high meshes' materials, widened by how much the normals of the samples in a texel differ."""

from collections.abc import Iterator, Sequence

import gpu

from ...core.declarations.choices import Space
from ...core.map_types import WIDENED_ROUGHNESS
from ...core.progress import Task, part
from ...core.settings import Run
from ...mesh.inputs import Meshes
from ...passes import mesh_upload, target
from ...passes.bake import gbuffer, samples
from ...passes.surface import slope_moments
from ..bands import Band
from ..high_surface import HighSurface
from ..maps.family import MapFamily, Sample
from ..maps.material_maps import MaterialMaps
from ..maps.normal_space import NormalSpace


class SlopeMaps(MapFamily):
    """Draws the map of Family.SLOPES. space: of the normals of the bake."""

    def __init__(self, meshes: Meshes, surface: HighSurface, run: Run, *, space: NormalSpace):
        self.roughness = MaterialMaps([WIDENED_ROUGHNESS.name], meshes, surface, run)
        self.effort, self.has_pages = self.roughness.effort + 0.2, self.roughness.has_pages
        self.space, self.run = space, run
        self.low = None if run.settings.map.space == Space.TANGENT else self._upload(meshes)

    def _upload(self, meshes: Meshes) -> gpu.types.GPUBatch:
        """The low mesh with its normals in the space of the bake, which are the axis of slopes there."""
        low = meshes.low
        normals = low.to_world_normals(low.normals) if self.run.settings.map.space == Space.WORLD else low.normals
        return mesh_upload.upload(low.triangles, uv=low.uv, position=low.positions[low.vertices], direction=normals)

    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        for sample in drawn:
            with self.run.timings.timed("draw"):
                self._add(sample)
        yield from part(self.roughness.add(drawn), 0.2 / self.effort, 1.0)

    def _add(self, sample: Sample) -> None:
        band = sample.band
        is_first = sample.number == 0
        normals = self.space.of_sample(sample.normals.texture, band)
        if self.space.basis is not None:
            samples.add(self._normals(band), normals, range(band.height), is_first=is_first)
        directions = None
        if self.low is not None:
            low_points = target.get("low points", band.width, band.height, "RGBA32F", "RGBA32F")
            gbuffer.draw(low_points, self.low, band.uv_to_clip)
            directions = low_points.textures[1]
        slope_moments.add(self._sums(band), normals, directions, is_first=is_first)

    def finished(self, band: Band, known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        if self.space.basis is not None:
            known = self._normals(band).texture
        into = target.get("widened roughness", band.width, band.height, "RGBA32F")
        for name, roughness in self.roughness.finished(band, known):
            with self.run.timings.timed("draw"):
                slope_moments.widen(into, self._sums(band), known, roughness)
            yield name, into.texture

    def _sums(self, band: Band) -> target.Target:
        return target.get("sums of slopes", band.width, band.height, "RGBA32F", "RGBA32F")

    def _normals(self, band: Band) -> target.Target:
        """The sums of the normals, each by the tangents at its sample: programs show the bends of the low mesh in a texel."""
        return target.get("sums of turned normals", band.width, band.height, "RGBA32F")
