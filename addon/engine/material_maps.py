# SPDX-License-Identifier: GPL-3.0-or-later
"""What the high meshes' materials show at the hits: colors, numbers, widened roughness, and normals of their own maps."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import gpu
import numpy as np

from ..core.declarations.choices import Space
from ..core.map_types import BY_NAME, WIDENED_ROUGHNESS, MapType
from ..core.material_feeds import (
    AttributeFeed,
    BumpFeed,
    Constant,
    DetailFeed,
    Feed,
    HighMaterial,
    ImageFeed,
    ImagePixels,
    NormalMapFeed,
)
from ..core.progress import Progress, Task, part
from ..core.settings import Run, Settings
from ..mesh.inputs import Meshes
from ..passes import low_in_uv, mesh_upload, samples, surface_tables, surface_values, target
from ..passes.surface_tables import MaterialTable
from .bands import Band
from .high_meshes import HighSurface
from .map_families import MapFamily, Mean, Sample
from .normal_space import NormalSpace


@dataclass(frozen=True)
class ImageUse:
    """One use of an image, on the materials that have `number` in `materials`.

    draw: draws a page at the hits of a sample. It takes the sample, the page, and the UDIM tile that the page is, or None.
    """

    feed: ImageFeed
    materials: MaterialTable
    number: int
    draw: Callable[[Sample, surface_tables.ImageLevels, int | None], None]

    def is_in(self, sample: Sample) -> bool:
        """Whether hits of a sample may show the image."""
        return sample.blocks is None or len(sample.blocks.serving(self.materials, self.number)) > 0


def draw_images(
    uses: Iterable[ImageUse], drawn: Sequence[Sample], load_page: Callable[[str, int], ImagePixels], run: Run
) -> Task[None]:
    """Load each page that samples show, and draw all its uses. load_page: as Meshes has it."""
    pages: dict[tuple[str, int], list[ImageUse]] = {}
    for use in uses:
        if any(map(use.is_in, drawn)):
            for tile in use.feed.tiles or (0,):
                pages.setdefault((use.feed.image, tile), []).append(use)
    for done, ((image, tile), found) in enumerate(pages.items()):
        yield Progress("Reading the images of the high meshes", done / len(pages))
        with run.timings.timed("textures"):
            page = surface_tables.upload_image(load_page(image, tile))
        with run.timings.timed("draw"):
            for use in found:
                for sample in drawn:
                    use.draw(sample, page, tile or None)
            drawn[-1].hits.finish()  # before the page is freed
        del page  # before the next one is loaded


@dataclass(frozen=True)
class _Map:
    """One map. feeds: the number of each image and attribute that feeds it, from 1. table: of all materials."""

    mean: Mean
    table: surface_tables.MaterialTable
    feeds: dict[Feed, int]


class MaterialMaps(MapFamily):
    """Draws the maps of Family.MATERIAL with these names."""

    effort = 0.5

    def __init__(self, names: Sequence[str], meshes: Meshes, surface: HighSurface, run: Run):
        self.surface, self.run, self.load_page = surface, run, meshes.load_page
        self.maps = [_map_of(BY_NAME[name], meshes.materials, run.settings) for name in names]
        self.has_pages = any(isinstance(feed, ImageFeed) for one in self.maps for feed in one.feeds)

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
            self._use(one, feed, number)
            for one in self.maps
            for feed, number in one.feeds.items()
            if isinstance(feed, ImageFeed)
        )
        yield from draw_images(uses, drawn, self.load_page, self.run)

    def _use(self, one: _Map, feed: ImageFeed, number: int) -> ImageUse:
        """How a map shows an image."""

        def draw(sample: Sample, page: surface_tables.ImageLevels, tile: int | None) -> None:
            surface_values.add_image(
                one.mean.sums(sample.band),
                sample.hits,
                page,
                feed,
                number,
                tables=self.surface.tables,
                uvs=self.surface.uvs(feed.uv_layer),
                materials=one.table,
                tile=tile,
                samples=self.run.settings.sampling.samples,
                blocks=sample.blocks,
            )

        return ImageUse(feed, one.table, number, draw)

    def finished(self, band: Band, _known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        for one in self.maps:
            with self.run.timings.timed("draw"):
                drawn = one.mean.texture(band)
            yield one.mean.name, drawn


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
    mean = Mean(map_type.name, settings.sampling.samples, is_summed=True)
    return _Map(mean, surface_tables.upload_materials(numbers, colors), feeds)


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
            low_in_uv.draw_points(low_points, self.low, band.uv_to_clip)
            directions = low_points.textures[1]
        samples.add_slopes(self._sums(band), normals, directions, is_first=is_first)

    def finished(self, band: Band, known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        if self.space.basis is not None:
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
    """The normal and bump maps of the high meshes.

    to_space: the matrix (3, 3) from world normals to the space of the source's normals.
    """

    def __init__(self, meshes: Meshes, surface: HighSurface, to_space: np.ndarray, run: Run):
        self.surface, self.to_space, self.run, self.load_page = surface, to_space, run, meshes.load_page
        self.normal_maps, self.normal_table = _numbered([_normal_map(material) for material in meshes.materials])
        self.bumps, self.bump_table = _numbered([_bump(material) for material in meshes.materials])

    def apply(self, drawn: Sequence[Sample]) -> Task[None]:
        """Change the normals of these samples in place. Bump maps lie on the normal maps."""
        for uses in (self._normal_map_uses(), self._bump_uses()):
            yield from draw_images(uses, drawn, self.load_page, self.run)

    def _normal_map_uses(self) -> Iterator[ImageUse]:
        for feed, number in self.normal_maps.items():

            def turn(
                sample: Sample,
                page: surface_tables.ImageLevels,
                tile: int | None,
                feed: NormalMapFeed = feed,
                number: int = number,
            ) -> None:
                surface_values.apply_normal_map(
                    sample.normals,
                    sample.hits,
                    page,
                    feed,
                    number,
                    tables=self.surface.tables,
                    uvs=self.surface.uvs(feed.image.uv_layer),
                    tangents=self.surface.tangents(feed.uv_layer),
                    materials=self.normal_table,
                    to_space=self.to_space,
                    tile=tile,
                    samples=self.run.settings.sampling.samples,
                    blocks=sample.blocks,
                )

            yield ImageUse(feed.image, self.normal_table, number, turn)

    def _bump_uses(self) -> Iterator[ImageUse]:
        for feed, number in self.bumps.items():

            def turn(
                sample: Sample,
                page: surface_tables.ImageLevels,
                tile: int | None,
                feed: BumpFeed = feed,
                number: int = number,
            ) -> None:
                surface_values.apply_bump(
                    sample.normals,
                    sample.hits,
                    page,
                    feed,
                    number,
                    tables=self.surface.tables,
                    uvs=self.surface.uvs(feed.image.uv_layer),
                    materials=self.bump_table,
                    to_space=self.to_space,
                    unit=self.surface.local_space.size,
                    tile=tile,
                    samples=self.run.settings.sampling.samples,
                    blocks=sample.blocks,
                )

            yield ImageUse(feed.image, self.bump_table, number, turn)


def _normal_map(material: HighMaterial) -> NormalMapFeed | None:
    detail = material.detail
    return detail.below if isinstance(detail, BumpFeed) else detail


def _bump(material: HighMaterial) -> BumpFeed | None:
    return material.detail if isinstance(material.detail, BumpFeed) else None


def _numbered(feeds: Sequence[DetailFeed | None]) -> tuple[dict[DetailFeed, int], surface_tables.MaterialTable]:
    """The number of each feed, from 1, and a table of them by the numbers of materials, which count from 1."""
    numbers = np.full(len(feeds) + 1, surface_tables.UNKNOWN)
    found: dict[DetailFeed, int] = {}
    for label, feed in enumerate(feeds, start=1):
        if feed is not None:
            numbers[label] = found.setdefault(feed, len(found) + 1)
    return found, surface_tables.upload_materials(numbers)
