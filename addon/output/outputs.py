# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores the maps of one bake in images, files and materials: all of them, or none."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import bpy
import numpy as np

from ..core import texel_state
from ..core.errors import shorten_list
from ..core.map_types import BY_NAME, MASK, NORMAL, Kind, Labeled
from ..core.settings import Settings
from ..core.texel_state import Map
from . import datablocks, map_storage, materials, value_encoding
from .output_clashes import settings_by_map


@dataclass(frozen=True)
class Stored:
    """The result of `Outputs.commit`.

    image: the normal map. paths: the files of the normal map by tile, then those of each other map. tiles: UDIM numbers.
    maps, loss: as in Report. warnings: sentences.
    """

    image: bpy.types.Image
    paths: list[str]
    tiles: list[int]
    maps: dict[str, dict]
    loss: dict[str, float]
    warnings: list[str]


class Outputs:
    """Stores maps when `commit` is called. Before, no datablock or existing file changes. Use it in a `with` block."""

    def __init__(self, settings: Settings):
        self.settings = settings
        self._writers = {
            name: map_storage.Writer("", of_map, is_normal=BY_NAME[name].kind is Kind.NORMAL)
            for name, of_map in settings_by_map(settings).items()
        }
        self._tiles: dict[str, dict[int, np.ndarray]] = {name: {} for name in settings.maps}

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, *_) -> None:
        with ExitStack() as discards:  # all of them run, even if one raises
            for writer in self._writers.values():
                discards.callback(writer.discard)

    def add(self, tile: int, maps: dict[str, Map]) -> None:
        """Add one UDIM tile of all maps, by name. Empty tiles are ignored: a triangle may touch a tile and cover no texel."""
        texels, state = maps[NORMAL.name]
        if not state.any():
            return
        self._writers[NORMAL.name].add(tile, texels)
        if MASK.name in self._writers:
            self._writers[MASK.name].add(tile, map_storage.black_and_white(state == texel_state.MISSED))
        for name, tiles in self._tiles.items():
            tiles[tile] = maps[name][0]  # encoded when the range of all tiles is known

    def commit(self, labels: dict[Labeled, Sequence[str]]) -> Stored:
        """Store all images or none. Raises BakeError.

        labels: the names of objects and of materials, whose numbers in the maps start at 1.
        """
        maps = {name: self._encode(name, tiles, labels) for name, tiles in self._tiles.items()}
        stored = dict(zip(self._writers, map_storage.commit_all(list(self._writers.values())), strict=True))
        writer = self._writers[NORMAL.name]
        return Stored(
            image=stored[NORMAL.name],
            paths=[path for writer in self._writers.values() for path in writer.paths],
            tiles=list(writer.tiles),
            maps={name.lower(): {"image": stored[name].name} | how for name, how in maps.items()},
            loss=writer.loss,
            warnings=sign(stored[NORMAL.name], labels[Labeled.OBJECTS]),
        )

    def _encode(self, name: str, tiles: dict[int, np.ndarray], labels: dict[Labeled, Sequence[str]]) -> dict:
        map_type = BY_NAME[name]
        names = labels[map_type.labeled] if map_type.labeled else []
        how = value_encoding.encoding(map_type, list(tiles.values()), names, self.settings)
        for tile, texels in tiles.items():
            value_encoding.encode(texels, how)
            self._writers[name].add(tile, texels)
        return how


def sign(image: bpy.types.Image, highs: Sequence[str]) -> list[str]:
    """Store the names of the high objects in `image`. Returns a warning if its map replaced one of other objects."""
    highs = list(dict.fromkeys(highs))
    before = map_storage.replaced(image.name, highs)
    datablocks.sign(image, highs)
    if not before:
        return []
    return [f"The map of {shorten_list(map(repr, highs))} replaced a map of {before} in the image {image.name!r}."]


def hook_up(low: bpy.types.Object, image: bpy.types.Image, uv_layer: str, settings: Settings) -> list[str]:
    """Show `image` in the materials of `low`. Returns warnings."""
    return materials.hook_up(
        low,
        image,
        space=settings.space,
        uv_layer=uv_layer,
        channels=(settings.red, settings.green, settings.blue),
        single_user=settings.single_user,
    )
