# SPDX-License-Identifier: GPL-3.0-or-later
"""Which UV maps, attributes and tangents the materials of a high mesh read."""

from collections.abc import Iterable, Iterator

import bpy
import numpy as np

from ...core.map_types import BY_NAME
from ...core.material_feeds import AttributeFeed, BumpFeed, DetailFeed, Feed, HighMaterial, ImageFeed
from ...core.settings import MapSettings
from ...mesh.triangle_mesh import ATTRIBUTE, TANGENTS, UV_LAYER
from .. import mesh_elements

READERS = {
    UV_LAYER: mesh_elements.uv_by_corner,
    ATTRIBUTE: mesh_elements.attribute_by_corner,
    TANGENTS: mesh_elements.tangents_by_corner,
}
"""What reads each kind of Mesh.layers; None where the mesh lacks it."""


def read_layers(
    data: bpy.types.Mesh, materials: Iterable[HighMaterial], settings: MapSettings
) -> dict[tuple[str, str], np.ndarray]:
    """Those of `data` that its materials need for the maps of the settings, as Mesh.layers has them."""
    found = {key: READERS[key[0]](data, key[1]) for key in _needed(materials, settings)}
    return {key: values for key, values in found.items() if values is not None}


def _needed(materials: Iterable[HighMaterial], settings: MapSettings) -> dict[tuple[str, str], None]:
    """The keys of the layers, each once, in order."""
    wanted = [BY_NAME[name] for name in settings.drawn_maps if BY_NAME[name].family.shows_materials]
    needed: dict[tuple[str, str], None] = {}
    if any(not map_type.socket for map_type in wanted):
        needed[ATTRIBUTE, settings.attribute] = None
    for material in materials:
        for map_type in wanted:
            needed |= dict.fromkeys(_of_feed(material.feeds.get(map_type.socket)))
        if settings.detail_maps and material.detail is not None:
            needed |= dict.fromkeys(_of_detail(material.detail))
    return needed


def _of_feed(feed: Feed | None) -> Iterator[tuple[str, str]]:
    if isinstance(feed, ImageFeed):
        yield UV_LAYER, feed.uv_layer
    elif isinstance(feed, AttributeFeed):
        yield ATTRIBUTE, feed.name


def _of_detail(detail: DetailFeed) -> Iterator[tuple[str, str]]:
    yield from _of_feed(detail.image)
    if isinstance(detail, BumpFeed):
        if detail.below is not None:
            yield from _of_detail(detail.below)
    else:
        yield TANGENTS, detail.uv_layer
