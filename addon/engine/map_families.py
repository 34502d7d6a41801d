# SPDX-License-Identifier: GPL-3.0-or-later
"""What draws the maps of one family from the samples of a band: the base of all, their means, and the maps of points."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import gpu
import numpy as np

from ..core.declarations.choices import Space
from ..core.map_types import BY_NAME, GRADIENT, VECTOR_DISPLACEMENT, Family, Kind
from ..core.progress import Task
from ..core.settings import Run
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, low_in_uv, mesh_upload, samples, target
from ..passes.surface_tables import Blocks
from .bands import Band
from .high_meshes import HighSurface
from .normal_space import NormalSpace, VectorSpace


@dataclass(frozen=True)
class Sample:
    """One sample of each texel of a band, whose hits are known.

    Attributes:
        number: From 0, among all samples of the band.
        is_central: Whether it is the one nearest to the texel's center.
        normals, hits, covered: As sources.Source has them.
        blocks: Where in the band its materials are, if images are looked up.
    """

    band: Band
    number: int
    is_central: bool
    normals: target.Target
    hits: target.Target
    covered: np.ndarray
    blocks: Blocks | None = None


@dataclass(frozen=True)
class FamilyInputs:
    """What families make their maps of.

    Attributes:
        meshes: Of the bake.
        surface: The high meshes, on which the hits are.
        space: Of the normals.
        to_space: The matrix (3, 3) from world normals to the space of the source's normals.
    """

    meshes: Meshes
    surface: HighSurface
    space: NormalSpace
    to_space: np.ndarray
    run: Run


class MapFamily(ABC):
    """Draws maps of a bake from the hits of its samples: those of one family with these names."""

    family: ClassVar[Family]
    effort: float
    """The time of a sample, roughly, as a multiple of the time that its hits take."""
    has_images = False
    """Whether it loads images, so that many samples at once take less time than one after another."""

    @abstractmethod
    def __init__(self, names: Sequence[str], inputs: FamilyInputs): ...

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


def value_of(band: Band) -> target.Target:
    """Where one map at a time is drawn: a sample of it, or its mean."""
    return target.get("value", band.width, band.height, "RGBA32F")


class Mean:
    """The mean of the samples of one map. Of labels, which have no mean, the sample nearest to the center of each texel."""

    def __init__(self, name: str):
        self.name, self.is_label = name, BY_NAME[name].kind is Kind.LABEL

    def sums(self, band: Band) -> target.Target:
        """The sums, to which passes may add themselves."""
        return target.get(f"sums of {self.name}", band.width, band.height, "RGBA32F")

    def add(self, sample: Sample, draw: Draw) -> None:
        """Add a sample."""
        if self.is_label and not sample.is_central:
            return
        drawn, is_first = value_of(sample.band), self.is_label or sample.number == 0
        draw(drawn)
        samples.add(self.sums(sample.band), drawn.texture, range(drawn.height), is_first=is_first)

    def texture(self, band: Band) -> gpu.types.GPUTexture:
        """The mean. Valid until the next mean is asked for."""
        into = value_of(band)
        samples.average(into, self.sums(band), is_direction=False)
        return into.texture


class PointMaps(MapFamily):
    """What follows from the points of both surfaces. Of a single sample, each map is drawn when it is asked for."""

    family = Family.POINTS
    effort = 0.2

    def __init__(self, names: Sequence[str], inputs: FamilyInputs):
        meshes, surface, run, low = inputs.meshes, inputs.surface, inputs.run, inputs.meshes.low
        self.names, self.surface, self.timings = names, surface, run.timings
        self.means = [Mean(name) for name in names] if run.settings.sampling.samples > 1 else []
        self._single: Sample | None = None
        basis = meshes.basis if run.settings.map.has_tangent_displacement else None
        self.vectors = None if basis is None else VectorSpace(basis, run.settings)
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
        self.gradient = None
        if GRADIENT.name in names:
            axis = "XYZ".index(run.settings.map.own(GRADIENT)["gradient_axis"])
            of_low = low.to_world if run.settings.map.space == Space.WORLD else np.eye(4)
            start, length = _extent(meshes.whole_low, of_low, axis)
            rows = np.tile(np.append(self.to_space[axis], self.origin[axis] - start) / length, (3, 1))
            self.gradient = rows[:, :3], rows[:, 3]

    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        self._single = drawn[0]
        for sample in drawn if self.means else ():
            with self.timings.timed("draw"):
                draw = self._drawing(sample)
                for mean in self.means:
                    mean.add(sample, partial(draw, mean.name))
        yield from ()

    def _drawing(self, sample: Sample) -> Callable[[str, target.Target], None]:
        """A function that draws a map of a sample, by its name."""
        band = sample.band
        # Its rays were cast, and those of the next sample are drawn anew.
        points = target.get("rays", band.width, band.height, "RGBA32F", "RGBA32F")
        cast.points(points, sample.hits, self.surface.tables, self.surface.labels)
        low_points = target.get("low points", band.width, band.height, "RGBA32F", "RGBA32F")
        low_in_uv.draw_points(low_points, self.low, band.uv_to_clip)

        def draw(name: str, into: target.Target) -> None:
            to_space, origin = (self.gradient if name == GRADIENT.name else None) or (self.to_space, self.origin)
            low_in_uv.draw_point_map(
                into,
                BY_NAME[name],
                sample.normals.texture,
                points,
                low_points,
                to_space=to_space,
                origin=origin,
                scale=self.surface.local_space.size,
            )

        return draw

    def finished(self, band: Band, _known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        for mean in self.means:
            with self.timings.timed("draw"):
                drawn = self._in_space(mean.name, mean.texture(band), band)
            yield mean.name, drawn
        if self.means or self._single is None:
            return
        with self.timings.timed("draw"):
            draw, into = self._drawing(self._single), value_of(band)
        for name in self.names:
            with self.timings.timed("draw"):
                draw(name, into)
                drawn = self._in_space(name, into.texture, band)
            yield name, drawn

    def _in_space(self, name: str, drawn: gpu.types.GPUTexture, band: Band) -> gpu.types.GPUTexture:
        """What was drawn of a map, in tangent space if it is stored so: by the tangents at the centers of texels."""
        if self.vectors is None or name != VECTOR_DISPLACEMENT.name:
            return drawn
        return self.vectors.of_texels(drawn, band, "vectors")


FLAT = 1e-6
"""How small an extent is, as a share of the largest, that rounding makes of none."""


def _extent(low: Mesh, to_space: np.ndarray, axis: int) -> tuple[float, float]:
    """The least coordinate of the vertices that triangles use, along an axis of the space after to_space (4, 4), and how far
    it is to the greatest: infinitely far if all are the same, so that each is 0 of the way."""
    used = low.positions[np.unique(low.vertices[low.triangles])].astype(np.float64)
    points = used @ to_space[:3, :3].T + to_space[:3, 3]
    lengths = np.ptp(points, axis=0)
    is_flat = lengths[axis] <= FLAT * lengths.max()
    return float(points[:, axis].min()), float("inf" if is_flat else lengths[axis])
