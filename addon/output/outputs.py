# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores the maps of one bake: images, files and materials, all or none."""

from collections.abc import Sequence
from contextlib import ExitStack

import bpy
import numpy as np

from ..core import texel_state
from ..core.errors import shorten_list
from ..core.map_types import BY_NAME, MASK, NORMAL, Kind, Labeled
from ..core.report import Report
from ..core.settings import Settings
from ..core.texel_state import Map
from . import datablocks, image_writer, materials, value_encoding
from .output_clashes import settings_by_map


class Outputs:
    """Stores maps at commit(). Before that, nothing in the file or on disk changes. Use it in a `with` block."""

    def __init__(self, settings: Settings):
        self.settings = settings
        self._writers = {
            name: image_writer.Writer("", own, is_normal=BY_NAME[name].kind is Kind.NORMAL)
            for name, own in settings_by_map(settings).items()
        }
        self._kept: dict[str, dict[int, np.ndarray]] = {name: {} for name in settings.maps}

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, *_) -> None:
        with ExitStack() as all_of_them:
            for writer in self._writers.values():
                all_of_them.callback(writer.discard)

    def add(self, tile: int, maps: dict[str, Map]) -> None:
        """Add one UDIM tile of all maps, by name. An empty tile is left out: a triangle may touch a tile and cover no texel."""
        texels, state = maps[NORMAL.name]
        if not state.any():
            return
        self._writers[NORMAL.name].add(tile, texels)
        if MASK.name in self._writers:
            self._writers[MASK.name].add(tile, image_writer.black_and_white(state == texel_state.MISSED))
        for name, kept in self._kept.items():
            kept[tile] = maps[name][0]  # encoded when the range of all tiles is known

    def commit(
        self, lows: Sequence[bpy.types.Object], reports: Sequence[Report], materials_seen: Sequence[str]
    ) -> None:
        """Store all images or none, and add the normal map to the materials of `lows`. Raises BakeError.

        materials_seen: the names of the materials by number, from 1.
        """
        settings = self.settings
        maps = {name: self._encode(name, tiles, reports, materials_seen) for name, tiles in self._kept.items()}
        stored = dict(zip(self._writers, image_writer.commit_all(list(self._writers.values())), strict=True))
        sign(stored[NORMAL.name], reports)
        for low, report in zip(lows, reports, strict=True):
            report.image = stored[NORMAL.name].name
            report.output = [path for writer in self._writers.values() for path in writer.paths]
            report.tiles = [tile for tile in report.tiles if tile in self._writers[NORMAL.name].tiles]
            report.loss = self._writers[NORMAL.name].loss
            report.maps = {name.lower(): {"image": stored[name].name} | how for name, how in maps.items()}
            if settings.material:
                report.warnings += hook_up(low, stored[NORMAL.name], report, settings)

    def _encode(
        self, name: str, tiles: dict[int, np.ndarray], reports: Sequence[Report], materials_seen: Sequence[str]
    ) -> dict:
        map_type = BY_NAME[name]
        labels = {Labeled.OBJECTS: dict.fromkeys(_highs(reports)), Labeled.MATERIALS: materials_seen}
        names = list(labels.get(map_type.labeled, ()))
        how = value_encoding.encoding(map_type, list(tiles.values()), names, self.settings)
        for tile, texels in tiles.items():
            value_encoding.encode(texels, how)
            self._writers[name].add(tile, texels)
        return how


def _highs(reports: Sequence[Report]) -> list[str]:
    """The names of all that was baked from."""
    return [high for report in reports for high in report.high]


def sign(image: bpy.types.Image, reports: Sequence[Report]) -> None:
    """Note in `image` which high objects its new map came from; the first report warns of one from others that it replaced."""
    highs = list(dict.fromkeys(_highs(reports)))
    before = image_writer.replaced(image.name, highs)
    datablocks.sign(image, highs)
    if before:
        reports[0].warnings.append(
            f"The image {image.name!r} held a map of {before}, which the one of {shorten_list(map(repr, highs))} replaced."
        )


def hook_up(low: bpy.types.Object, image: bpy.types.Image, report: Report, settings: Settings) -> list[str]:
    """Show `image` in the materials of `low`; returns what there is to say about it."""
    return materials.hook_up(
        low,
        image,
        space=settings.space,
        uv_layer=report.uv_layer,
        channels=(settings.red, settings.green, settings.blue),
        single_user=settings.single_user,
    )
