# SPDX-License-Identifier: GPL-3.0-or-later
"""What the high meshes' materials show at the hits: colors, numbers, widened roughness, and normals of their own maps."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import gpu
import numpy as np

from ..core.declarations import bases
from ..core.declarations.choices import Space
from ..core.map_types import BY_NAME, Family, MapType
from ..core.material_feeds import (
    AttributeFeed,
    BumpFeed,
    Constant,
    ExactFeed,
    Feed,
    HighMaterial,
    ImageFeed,
    NormalMapFeed,
)
from ..core.progress import Progress, Task, part
from ..core.settings import Run, Settings
from ..mesh.inputs import Evaluate, HitsOfFeed, LoadImage, Meshes
from ..mesh.triangles import transformed, unit
from ..passes import cast, data_texture, low_in_uv, mesh_upload, samples, surface_tables, surface_values, target
from ..passes.surface_tables import MaterialTable
from ..passes.surface_values import ImageAtHits
from .bands import Band
from .converted_map import DecodedOnLow
from .high_meshes import HighSurface
from .map_families import FamilyInputs, MapFamily, Mean, Sample

OneFeed = TypeVar("OneFeed")


def _evaluating(done: float) -> Progress:
    """The step of what Cycles evaluates."""
    return Progress("Cycles evaluates the materials", done)


@dataclass(frozen=True)
class ImageUse:
    """One use of an image, on the materials that have `number` in `materials`.

    Attributes:
        draw: Draws it at the hits of a sample.
    """

    feed: ImageFeed
    materials: MaterialTable
    number: int
    draw: Callable[[Sample, ImageAtHits], None]

    def is_in(self, sample: Sample) -> bool:
        """Whether hits of a sample may show the image."""
        return sample.blocks is None or len(sample.blocks.serving(self.materials, self.number)) > 0


def draw_images(
    uses: Iterable[ImageUse], drawn: Sequence[Sample], surface: HighSurface, load_image: LoadImage, run: Run
) -> Task[None]:
    """Load each image that samples show, and draw all its uses. load_image: as Meshes has it."""
    images: dict[tuple[str, int], list[ImageUse]] = {}
    for use in uses:
        if any(map(use.is_in, drawn)):
            for tile in use.feed.tiles or (0,):
                images.setdefault((use.feed.image, tile), []).append(use)
    for done, ((key, tile), of_image) in enumerate(images.items()):
        yield Progress("Reading the images of the high meshes", done / len(images))
        with run.timings.timed("textures"):
            image = surface_tables.upload_image(load_image(key, tile))
        with run.timings.timed("draw"):
            for use in of_image:
                for sample in drawn:
                    at_hits = ImageAtHits(
                        sample.hits,
                        image,
                        use.feed,
                        use.number,
                        surface.tables,
                        surface.uvs(use.feed.uv_layer),
                        use.materials,
                        tile or None,
                        run.settings.sampling.samples,
                        sample.blocks,
                    )
                    use.draw(sample, at_hits)
            drawn[-1].hits.finish()  # before the image is freed
        del image, at_hits  # before the next one is loaded


@dataclass(frozen=True)
class ExactUse:
    """A feed that Cycles evaluates, on the materials that have `number` in `materials`."""

    feed: ExactFeed
    materials: MaterialTable
    number: int


def evaluate_exact(
    uses: Sequence[ExactUse], sample: Sample, surface: HighSurface, evaluate: Evaluate
) -> list[tuple[ExactUse, np.ndarray, np.ndarray]]:
    """What Cycles evaluates at the hits of a sample: for each use on each mesh its texels, places (N,) in their rows one after
    the other, and the values there (N, 3) float32. evaluate: as Meshes has it."""
    triangles, weights = cast.read_hits(sample.hits)
    numbers = np.where(triangles < 0, 0, surface.material_numbers[np.maximum(triangles, 0)])
    spacing = _spacing(sample, surface) if any(use.feed.has_bumps for use in uses) else None
    wanted: list[HitsOfFeed] = []
    shown: list[tuple[ExactUse, np.ndarray]] = []
    for use in uses:
        places = np.flatnonzero((use.materials.feeds[numbers] == use.number).ravel() & (triangles >= 0).ravel())
        if not len(places):
            continue
        for some, hits in surface.hits_of(use.feed, triangles.reshape(-1)[places], weights.reshape(-1, 2)[places]):
            shown.append((use, places[some]))
            if use.feed.has_bumps and spacing is not None:
                hits = _spaced(hits, places[some], sample.band, spacing)  # noqa: PLW2901 - the same, with more
            wanted.append(hits)
    values = evaluate(wanted) if wanted else []
    return [(use, places, surface_tables.finite(found)) for (use, places), found in zip(shown, values, strict=True)]


SEAM = 4.0
"""Two texels of which one is so many times as far as the other are on different parts of the surface."""
AT_UVS = 0.1
"""Texels: a hit whose UVs are no farther from its texel was drawn there."""


def _spacing(sample: Sample, surface: HighSurface) -> np.ndarray:
    """How far the hits of the texels beside each are (N,) float32, in world space: the mean along both axes. 0 where none is
    known."""
    drawn = target.Target(sample.hits.width, sample.hits.height, ("RGBA32F", "RGBA32F"))
    cast.points(drawn, sample.hits, surface.tables, surface.labels)
    points = drawn.texels()
    places, along = np.where(points[..., 3:] > 0.0, points[..., :3], np.nan), []
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(places, axis=axis), axis=-1)
        before, after = (np.insert(step, end, np.nan, axis=axis) for end in (0, step.shape[axis]))
        nearer, farther = np.fmin(before, after), np.fmax(before, after)
        along.append(np.where(farther < SEAM * nearer, (nearer + farther) / 2.0, nearer))
    mean = np.where(np.isnan(along), along[::-1], along).mean(axis=0)
    return (np.nan_to_num(mean) * surface.local_space.size).astype(np.float32).ravel()


def _spaced(hits: HitsOfFeed, texels: np.ndarray, band: Band, spacing: np.ndarray) -> HitsOfFeed:
    """Hits in some texels (N,) of a band with their `spacing`, of all texels; exactly, where the mesh was drawn at its UVs."""
    mesh, spacing = hits.mesh, spacing[texels]
    if mesh.uv is None:
        return replace(hits, spacing=spacing)
    size, (scale, offset) = (band.width, band.height), np.reshape(band.uv_to_clip, (2, 2))
    corners = mesh.triangles[hits.triangles]
    pixels = ((mesh.uv[corners].astype(np.float64) * scale + offset) * 0.5 + 0.5) * size
    shown = np.einsum("nc,nck->nk", hits.weights, pixels)
    away = np.abs(shown - np.stack([texels % band.width, texels // band.width], axis=1) - 0.5).max(axis=1)
    points = transformed(mesh.positions[mesh.vertices[corners]], mesh.to_world)
    (across, up), edges = np.moveaxis(pixels[:, 1:] - pixels[:, :1], 1, 0), points[:, 1:] - points[:, :1]
    area = across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_x = (edges[:, 0] * up[:, 1:] - edges[:, 1] * across[:, 1:]) / area[:, None]
        along_y = (edges[:, 1] * across[:, :1] - edges[:, 0] * up[:, :1]) / area[:, None]
    exact = (np.linalg.norm(along_x, axis=1) + np.linalg.norm(along_y, axis=1)) / 2.0
    is_exact = (away < AT_UVS) & np.isfinite(exact)
    return replace(hits, spacing=np.where(is_exact, exact, spacing).astype(np.float32))


@dataclass(frozen=True)
class _Map:
    """One map.

    Attributes:
        feeds: The number of each image and attribute that feeds it, from 1.
        table: Of all materials.
    """

    mean: Mean
    table: MaterialTable
    feeds: dict[Feed, int]


class MaterialMaps(MapFamily):
    """Inputs of materials, and attributes."""

    family = Family.MATERIAL
    effort = 0.5

    def __init__(self, names: Sequence[str], inputs: FamilyInputs):
        meshes, surface, run = inputs.meshes, inputs.surface, inputs.run
        self.surface, self.run, self.load_image = surface, run, meshes.load_image
        self.maps = [_map_of(BY_NAME[name], meshes.materials, run.settings) for name in names]
        self.has_images = any(isinstance(feed, ImageFeed) for one in self.maps for feed in one.feeds)
        self.evaluate = meshes.evaluate
        self.exact = {one.mean.name: _exact_uses(one.feeds, one.table) for one in self.maps}

    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        surface = self.surface
        with self.run.timings.timed("draw"):
            for sample in drawn:
                for one in self.maps:
                    sums = one.mean.sums(sample.band)
                    surface_values.add_constants(
                        sums,
                        sample.hits,
                        sample.normals.texture,
                        labels=surface.labels,
                        materials=one.table,
                        is_first=sample.number == 0,
                    )
                    for feed, number in one.feeds.items():
                        if isinstance(feed, AttributeFeed):
                            values = surface.attribute(feed.name)
                            surface_values.add_attribute(
                                sums,
                                sample.hits,
                                values,
                                feed,
                                number,
                                labels=surface.labels,
                                materials=one.table,
                            )
        uses = (
            ImageUse(feed, one.table, number, partial(_add_image, one.mean))
            for one in self.maps
            for feed, number in one.feeds.items()
            if isinstance(feed, ImageFeed)
        )
        yield from draw_images(uses, drawn, surface, self.load_image, self.run)
        for done, sample in enumerate(drawn if any(self.exact.values()) else ()):
            yield _evaluating(done / len(drawn))
            with self.run.timings.timed("textures"):
                self._add_exact(sample)

    def _add_exact(self, sample: Sample) -> None:
        """Add what Cycles evaluates at the hits of a sample."""
        uses = [use for of_map in self.exact.values() for use in of_map]
        evaluated = evaluate_exact(uses, sample, self.surface, self.evaluate)
        for one in self.maps:
            texels = np.zeros((sample.hits.height, sample.hits.width, 4), np.float32)
            for use, places, values in evaluated:
                if use.materials is one.table:
                    texels.reshape(-1, 4)[places] = np.pad(values, ((0, 0), (0, 1)), constant_values=1.0)
            if texels.any():
                sums = one.mean.sums(sample.band)
                samples.add(sums, data_texture.image(texels), range(sums.height), is_first=False)
                sums.finish()  # before the texture is freed

    def finished(self, band: Band, _known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        for one in self.maps:
            with self.run.timings.timed("draw"):
                drawn = one.mean.texture(band)
            yield one.mean.name, drawn


def _exact_uses(feeds: Mapping[Any, int], table: MaterialTable) -> list[ExactUse]:
    return [ExactUse(feed, table, number) for feed, number in feeds.items() if isinstance(feed, ExactFeed)]


def _add_image(mean: Mean, sample: Sample, at_hits: ImageAtHits) -> None:
    surface_values.add_image(mean.sums(sample.band), at_hits)


def _feed_of(map_type: MapType, material: HighMaterial, attribute: str) -> Feed | None:
    """What feeds a map on a material; None if the material does not tell. attribute: the one of the settings."""
    return material.feeds.get(map_type.socket) if map_type.socket else AttributeFeed(attribute)


def _map_of(map_type: MapType, materials: Sequence[HighMaterial], settings: Settings) -> _Map:
    numbers = np.full(len(materials) + 1, surface_tables.UNKNOWN)  # no triangle has the number 0
    colors = np.zeros((len(numbers), 3), np.float32)
    feeds: dict[Feed, int] = {}
    for label, material in enumerate(materials, start=1):
        feed = _feed_of(map_type, material, settings.map.attribute)
        if isinstance(feed, Constant):
            numbers[label], colors[label] = surface_tables.CONSTANT, feed.color[:3]
        elif feed is not None:
            numbers[label] = feeds.setdefault(feed, len(feeds) + 1)
    return _Map(Mean(map_type.name), surface_tables.upload_materials(numbers, colors), feeds)


class SlopeMaps(MapFamily):
    """Widened roughness."""

    family = Family.SLOPES

    def __init__(self, names: Sequence[str], inputs: FamilyInputs):
        meshes, run, space = inputs.meshes, inputs.run, inputs.space
        self.roughness = MaterialMaps(names, inputs)
        self.effort, self.has_images = self.roughness.effort + 0.2, self.roughness.has_images
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
        if self.space.mesh is not None:
            samples.add(self._normals(band), normals, range(band.height), is_first=is_first)
        directions = None
        if self.low is not None:
            low_points = target.get("low points", band.width, band.height, "RGBA32F", "RGBA32F")
            low_in_uv.draw_points(low_points, self.low, band.uv_to_clip)
            directions = low_points.textures[1]
        samples.add_slopes(self._sums(band), normals, directions, is_first=is_first)

    def finished(self, band: Band, known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        if self.space.mesh is not None:
            known = self._normals(band).texture
        into = target.get("widened roughness", band.width, band.height, "RGBA32F")
        for name, roughness in self.roughness.finished(band, known):
            with self.run.timings.timed("draw"):
                samples.widen_roughness(into, self._sums(band), known, roughness)
            yield name, into.texture

    def _sums(self, band: Band) -> target.Target:
        return target.get("sums of slopes", band.width, band.height, "RGBA32F", "RGBA32F")

    def _normals(self, band: Band) -> target.Target:
        """The sums of the normals, each by the tangents at its sample: programs show the bends of the low mesh in a texel."""
        return target.get("sums of turned normals", band.width, band.height, "RGBA32F")


class OwnNormals:
    """The normal and bump maps of the high meshes, and other normals of their materials.

    to_space: the matrix (3, 3) from world normals to the space of the source's normals.
    """

    has_images = True

    def __init__(self, meshes: Meshes, surface: HighSurface, to_space: np.ndarray, run: Run):
        self.surface, self.to_space, self.run, self.load_image = surface, to_space, run, meshes.load_image
        self.normal_maps, self.normal_table = _numbered([_normal_map(material) for material in meshes.materials])
        self.bumps, self.bump_table = _numbered([_bump(material) for material in meshes.materials])
        exact = [each.detail if isinstance(each.detail, ExactFeed) else None for each in meshes.materials]
        self.exact, self.evaluate = _exact_uses(*_numbered(exact)), meshes.evaluate
        basis = meshes.basis if any(feed.basis != bases.CYCLES.name for feed in self.normal_maps) else None
        self.low = DecodedOnLow(basis, run.settings.map) if basis is not None else None

    def apply(self, drawn: Sequence[Sample]) -> Task[None]:
        """Change the normals of these samples in place. Bump maps lie on the normal maps."""
        for feeds, table, turn in (
            (self.normal_maps, self.normal_table, self._apply_normal_map),
            (self.bumps, self.bump_table, self._apply_bump),
        ):
            uses = [ImageUse(feed.image, table, number, partial(turn, feed)) for feed, number in feeds.items()]
            yield from draw_images(uses, drawn, self.surface, self.load_image, self.run)
        for done, sample in enumerate(drawn if self.exact else ()):
            yield _evaluating(done / len(drawn))
            with self.run.timings.timed("textures"):
                self._replace(sample)

    def _replace(self, sample: Sample) -> None:
        """Put what Cycles evaluates in the place of normals."""
        texels = sample.normals.texels()
        flat = texels.reshape(-1, 4)
        for _, places, values in evaluate_exact(self.exact, sample, self.surface, self.evaluate):
            found = (2.0 * values - 1.0) @ self.to_space.T
            length = np.linalg.norm(found, axis=1)
            is_known = (length > 0.0) & (flat[places, 3] > 0.0)
            flat[places[is_known], :3] = found[is_known] / length[is_known, None]
        target.fill(sample.normals, target.COPY, source=data_texture.image(texels))
        sample.normals.finish()  # before the texture is freed

    def _apply_normal_map(self, feed: NormalMapFeed, sample: Sample, at_hits: ImageAtHits) -> None:
        if feed.basis != bases.CYCLES.name and self.low is not None:
            self._decode(self.low, feed, sample, at_hits)
            return
        tangents = self.surface.tangents(feed.uv_layer)
        surface_values.apply_normal_map(sample.normals, at_hits, feed, tangents, self.to_space)

    def _decode(self, low: DecodedOnLow, feed: NormalMapFeed, sample: Sample, at_hits: ImageAtHits) -> None:
        """Put normals of a map in the place of others, as the low mesh shows them by the basis of the bake."""
        shown = target.Target(sample.hits.width, sample.hits.height, ("RGBA32F",))
        target.clear(shown)
        surface_values.add_image(shown, at_hits)
        stored = shown.texels()
        mapped = 2.0 * stored[..., :3] - 1.0
        mapped *= (feed.strength, -feed.strength if feed.is_green_down else feed.strength, 1.0)
        mapped[..., 2] = 1.0 + (mapped[..., 2] - 1.0) * min(feed.strength, 1.0)
        stored[..., :3] = unit(mapped) * 0.5 + 0.5
        found, texels = low.texels(stored, sample.band), sample.normals.texels()
        is_known = (stored[..., 3] > 0.0) & (found[..., 3] > 0.0) & (texels[..., 3] > 0.0)
        texels[is_known, :3] = found[is_known, :3]
        target.fill(sample.normals, target.COPY, source=data_texture.image(texels))
        sample.normals.finish()  # before the texture is freed

    def _apply_bump(self, feed: BumpFeed, sample: Sample, at_hits: ImageAtHits) -> None:
        surface_values.apply_bump(sample.normals, at_hits, feed, self.to_space, self.surface.local_space.size)


def _normal_map(material: HighMaterial) -> NormalMapFeed | None:
    detail = material.detail.below if isinstance(material.detail, BumpFeed) else material.detail
    return detail if isinstance(detail, NormalMapFeed) else None


def _bump(material: HighMaterial) -> BumpFeed | None:
    return material.detail if isinstance(material.detail, BumpFeed) else None


def _numbered(feeds: Sequence[OneFeed | None]) -> tuple[dict[OneFeed, int], MaterialTable]:
    """The number of each feed, from 1, and a table of them by the numbers of materials, which count from 1."""
    numbers = np.full(len(feeds) + 1, surface_tables.UNKNOWN)
    numbered: dict[OneFeed, int] = {}
    for label, feed in enumerate(feeds, start=1):
        if feed is not None:
            numbers[label] = numbered.setdefault(feed, len(numbered) + 1)
    return numbered, surface_tables.upload_materials(numbers)
