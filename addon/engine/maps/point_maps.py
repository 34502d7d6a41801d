# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the maps that follow from the points of both surfaces: height, position, displacement, distance, coverage and IDs."""

from collections.abc import Iterator, Sequence

import gpu
import numpy as np

from ...core.declarations.choices import Space
from ...core.map_types import BY_NAME, Kind
from ...core.progress import Task
from ...core.settings import Run
from ...mesh.triangle_mesh import Mesh
from ...passes import mesh_upload, target
from ...passes.bake import cast, gbuffer, other_map_pass
from ..bands import Band
from ..high_surface import HighSurface
from .family import MapFamily, Sample
from .means import Central, Mean


class PointMaps(MapFamily):
    """Draws the maps of Family.POINTS with these names."""

    effort = 0.2

    def __init__(self, names: Sequence[str], low: Mesh, surface: HighSurface, run: Run):
        self.surface, self.timings = surface, run.timings
        self.means = [
            Central(name) if BY_NAME[name].kind is Kind.LABEL else Mean(name, run.settings.sampling.samples)
            for name in names
        ]
        local_space = surface.local_space
        self.low = mesh_upload.upload(
            low.triangles,
            uv=low.uv,
            position=local_space.points(low)[low.vertices],
            direction=low.to_world_normals(low.normals),
        )
        # Positions and vectors are in the space of the normals: the low object's, or the world's.
        from_world = np.eye(4) if run.settings.map.space == Space.WORLD else np.linalg.inv(low.to_world)
        self.to_space = from_world[:3, :3] * local_space.size
        self.origin = from_world[:3, :3] @ local_space.origin + from_world[:3, 3]

    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        for sample in drawn:
            with self.timings.timed("draw"):
                self._add(sample)
        yield from ()

    def _add(self, sample: Sample) -> None:
        band = sample.band
        points = target.get("points", band.width, band.height, "RGBA32F", "RGBA32F")
        cast.points(points, sample.hits, self.surface.tables, self.surface.labels)
        low_points = target.get("low points", band.width, band.height, "RGBA32F", "RGBA32F")
        gbuffer.draw(low_points, self.low, band.uv_to_clip)
        for mean in self.means:

            def draw(into: target.Target, name: str = mean.name) -> None:
                other_map_pass.draw(
                    into,
                    BY_NAME[name],
                    sample.normals.texture,
                    points,
                    low_points,
                    to_space=self.to_space,
                    origin=self.origin,
                    scale=self.surface.local_space.size,
                )

            mean.add(sample, draw)

    def finished(self, band: Band, _known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        for mean in self.means:
            yield mean.name, mean.texture(band)
