# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws what the high meshes' materials and attributes show at the hits. Images are loaded one at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gpu
import numpy as np

from ...core.map_types import BY_NAME, MapType
from ...core.material_feeds import AttributeFeed, Constant, Feed, HighMaterial, ImageFeed
from ...core.progress import Task
from ...core.settings import Run, Settings
from ...mesh.inputs import Meshes
from ...passes.surface import image_look_up, image_page, material_table, plain_values
from ..bands import Band
from ..high_surface import HighSurface
from .family import MapFamily, Sample
from .means import Mean
from .page_uses import PageUse, draw_pages


@dataclass(frozen=True)
class _Map:
    """One map. feeds: the number of each image and attribute that feeds it, from 1. table: from material_table.upload."""

    mean: Mean
    table: material_table.MaterialTable
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
                    plain_values.add_constants(
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
                            plain_values.add_attribute(
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
        yield from draw_pages(uses, drawn, self.load_page, self.run)

    def _use(self, one: _Map, feed: ImageFeed, number: int) -> PageUse:
        """How a map shows an image."""

        def draw(sample: Sample, page: image_page.Page, tile: int | None) -> None:
            image_look_up.add_image(
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

        return PageUse(feed, one.table, number, draw)

    def finished(self, band: Band, _known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        for one in self.maps:
            with self.run.timings.timed("draw"):
                drawn = one.mean.texture(band)
            yield one.mean.name, drawn


def _feed_of(map_type: MapType, material: HighMaterial, attribute: str) -> Feed | None:
    """What feeds a map on a material; None if the material does not tell. attribute: the one of the settings."""
    return material.feeds.get(map_type.socket) if map_type.socket else AttributeFeed(attribute)


def _map_of(map_type: MapType, materials: Sequence[HighMaterial], settings: Settings) -> _Map:
    numbers = np.full(len(materials) + 1, material_table.UNKNOWN)  # no triangle has the number 0
    colors = np.zeros((len(numbers), 3), np.float32)
    feeds: dict[Feed, int] = {}
    for label, material in enumerate(materials, start=1):
        feed = _feed_of(map_type, material, settings.map.attribute)
        if isinstance(feed, Constant):
            numbers[label], colors[label] = material_table.CONSTANT, feed.color[:3]
        elif feed is not None:
            numbers[label] = feeds.setdefault(feed, len(feeds) + 1)
    mean = Mean(map_type.name, settings.sampling.samples, is_summed=True)
    return _Map(mean, material_table.upload(numbers, colors), feeds)
