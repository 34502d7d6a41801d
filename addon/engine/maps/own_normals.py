# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the normal and bump maps of the high meshes' own materials into the normals at the hits."""

from collections.abc import Iterator, Sequence

import numpy as np

from ...core.material_feeds import BumpFeed, DetailFeed, HighMaterial, NormalMapFeed
from ...core.progress import Task
from ...core.settings import Run
from ...mesh.inputs import Meshes
from ...passes.surface import image_page, material_table, turned_normals
from ..high_surface import HighSurface
from .family import Sample
from .page_uses import PageUse, draw_pages


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
            yield from draw_pages(uses, drawn, self.load_page, self.run)

    def _normal_map_uses(self) -> Iterator[PageUse]:
        for feed, number in self.normal_maps.items():

            def turn(
                sample: Sample,
                page: image_page.Page,
                tile: int | None,
                feed: NormalMapFeed = feed,
                number: int = number,
            ) -> None:
                turned_normals.apply_normal_map(
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

            yield PageUse(feed.image, self.normal_table, number, turn)

    def _bump_uses(self) -> Iterator[PageUse]:
        for feed, number in self.bumps.items():

            def turn(
                sample: Sample, page: image_page.Page, tile: int | None, feed: BumpFeed = feed, number: int = number
            ) -> None:
                turned_normals.apply_bump(
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

            yield PageUse(feed.image, self.bump_table, number, turn)


def _normal_map(material: HighMaterial) -> NormalMapFeed | None:
    detail = material.detail
    return detail.below if isinstance(detail, BumpFeed) else detail


def _bump(material: HighMaterial) -> BumpFeed | None:
    return material.detail if isinstance(material.detail, BumpFeed) else None


def _numbered(feeds: Sequence[DetailFeed | None]) -> tuple[dict[DetailFeed, int], material_table.MaterialTable]:
    """The number of each feed, from 1, and a table of them by the numbers of materials, which count from 1."""
    numbers = np.full(len(feeds) + 1, material_table.UNKNOWN)
    found: dict[DetailFeed, int] = {}
    for label, feed in enumerate(feeds, start=1):
        if feed is not None:
            numbers[label] = found.setdefault(feed, len(found) + 1)
    return found, material_table.upload(numbers)
