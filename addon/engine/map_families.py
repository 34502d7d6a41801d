# SPDX-License-Identifier: GPL-3.0-or-later
"""What draws the maps of one family from the samples of a band: the base of all, their means, and the maps of points."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import gpu
import numpy as np

from ..core.declarations.choices import Space
from ..core.map_types import BY_NAME, Kind
from ..core.progress import Task
from ..core.settings import Run
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, low_in_uv, mesh_upload, samples, target
from ..passes.surface_tables import Blocks
from .bands import Band
from .high_meshes import HighSurface


@dataclass(frozen=True)
class Sample:
    """One sample of each texel of a band, whose hits are known.

    number: from 0, among all samples of the band. is_central: whether it is the one nearest to the texel's center. normals,
    hits, covered: as sources.Source has them. blocks: where in the band its materials are, if images are looked up.
    """

    band: Band
    number: int
    is_central: bool
    normals: target.Target
    hits: target.Target
    covered: np.ndarray
    blocks: Blocks | None = None


class MapFamily(ABC):
    """Draws some maps of a bake from the hits of its samples."""

    effort: float
    """The time of a sample, roughly, as a multiple of the time that its hits take."""
    has_images = False
    """Whether it loads images, so that many samples at once take less time than one after another."""

    @abstractmethod
    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        """Add samples of a band. Their hits and normals stay as they are until the task ends."""

    @abstractmethod
    def finished(self, band: Band, known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        """The names and textures (RGBA32F; alpha 1 known, 0 empty, -1 missed) of the maps of a band whose samples were added.

        known: the normals of the only sample, or the sums of those of several. Each texture is valid until the next one is
        asked for.
        """


Draw = Callable[[target.Target], None]
"""Draws one sample of a map into a target (RGBA32F; alpha 1 known, 0 empty, -1 missed)."""


class Mean:
    """The mean of the samples of one map.

    is_summed: whether passes add to `sums` themselves; otherwise a single sample is drawn straight into the texture of the map.
    """

    def __init__(self, name: str, count: int, *, is_summed: bool = False):
        self.name = name
        self.is_summed = is_summed or count > 1

    def sums(self, band: Band) -> target.Target:
        """The sums, or the only sample."""
        return target.get(f"sums of {self.name}" if self.is_summed else self.name, band.width, band.height, "RGBA32F")

    def add(self, sample: Sample, draw: Draw) -> None:
        """Add a sample."""
        band = sample.band
        if not self.is_summed:
            draw(self.sums(band))
            return
        drawn = target.get("sample", band.width, band.height, "RGBA32F")
        draw(drawn)
        samples.add(self.sums(band), drawn.texture, range(band.height), is_first=sample.number == 0)

    def texture(self, band: Band) -> gpu.types.GPUTexture:
        """The mean. Valid until the next mean is asked for."""
        if not self.is_summed:
            return self.sums(band).texture
        into = target.get("mean", band.width, band.height, "RGBA32F")
        samples.average(into, self.sums(band), is_direction=False)
        return into.texture


class Central(Mean):
    """The sample nearest to the center of each texel, for labels, which have no mean."""

    def __init__(self, name: str):
        super().__init__(name, 1)

    def add(self, sample: Sample, draw: Draw) -> None:
        """As Mean has it; samples that are not central are drawn for other maps only."""
        if sample.is_central:
            super().add(sample, draw)


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
        low_in_uv.draw_points(low_points, self.low, band.uv_to_clip)
        for mean in self.means:

            def draw(into: target.Target, name: str = mean.name) -> None:
                low_in_uv.draw_point_map(
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
