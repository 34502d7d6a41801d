# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores the maps of one bake in images, files, attributes and materials: all of them, or none."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import bpy
import numpy as np

from ..core.declarations.choices import Storage, VertexDomain
from ..core.errors import Fix, shorten_list
from ..core.map_types import BY_NAME, MASK, MISSED, NORMAL, Kind, Labeled, Map
from ..core.settings import Settings
from . import datablocks, map_names, map_storage, materials, value_encoding
from .map_names import settings_by_map, stored_maps
from .vertex_attributes import VertexMaps
from .write_queue import WriteQueue

HIDDEN_MISSES = Fix.MISS_MASK.after("Rays of some texels hit nothing, and files without alpha do not show which.")
"""A warning."""


@dataclass(frozen=True)
class Stored:
    """The result of `Outputs.commit`.

    image: the normal map, or the first other map without one. paths: the files of the normal map by tile, then those of each
    other map. tiles: UDIM numbers. mip_files, maps, attributes, loss: as in Report. warnings: sentences.
    """

    image: bpy.types.Image
    paths: list[str]
    mip_files: dict[str, list[str]]
    tiles: list[int]
    maps: dict[str, dict]
    attributes: dict[str, str]
    loss: dict[str, float]
    warnings: list[str]


class Outputs:
    """Stores maps when `commit` is called. Before, no datablock or existing file changes. Use it in a `with` block."""

    def __init__(self, settings: Settings):
        self.settings = settings
        types = stored_maps(settings.map)
        self._queue = WriteQueue()
        self._packed = settings.map.packing.map_type.name if settings.map.packing else ""
        self._writers = {
            name: map_storage.Writer(
                "",
                of_map,
                is_normal=types[name] is NORMAL,
                color_space=value_encoding.color_space(types[name], of_map.storing),
                is_packed=name == self._packed,
                queue=self._queue,
            )
            for name, of_map in settings_by_map(settings).items()
        }
        self._levels = {
            (name, level): map_storage.Writer(
                "",
                map_names.of_level(writer.settings, level),
                is_packed=name == self._packed,
                queue=self._queue,
                has_image=False,
            )
            for name, writer in self._writers.items()
            for level in map_names.levels_of(settings, name)
        }
        """The writers of mip levels, by the name of the map and the number of the level."""
        self._first = map_names.first_map(settings.map)
        self._late: dict[str, dict[tuple[int, int], np.ndarray]] = {
            name: {}
            for name in settings.map.drawn_maps
            if value_encoding.needs_range(BY_NAME[name], self._settings_of(name).storing)
        }
        """The maps that are encoded when the range of all tiles is known, by tile and level. Others do not stay in memory."""
        self._unpacked: dict[tuple[int, int], dict[str, np.ndarray]] = {}
        """The maps to pack, by tile and level, and by name, if they are encoded late."""
        self._vertices: list[VertexMaps] = []
        self._hides_misses = False
        """Whether a file has texels without a hit, and nothing that shows which."""
        self._cut_off: set[str] = set()
        """The maps with values that 16-bit floats do not hold."""
        self._empty = set(settings.map.drawn_maps)
        """The maps of which no texel had a value so far."""

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, *_) -> None:
        self._queue.close()  # first: nothing may be writing to files that are discarded
        with ExitStack() as discards:  # all of them run, even if one raises
            for writer in (*self._writers.values(), *self._levels.values()):
                discards.callback(writer.discard)

    def sample_onto(
        self, low: bpy.types.Object, uv_layer: str, *, is_own_base: bool, slots: Sequence[int] | None = None
    ) -> None:
        """Also store the maps that are added from now on in attributes of `low`, if the settings say so. See VertexMaps."""
        if self.settings.storing.vertex_domain != VertexDomain.NONE:
            self._vertices.append(VertexMaps(low, uv_layer, self.settings, is_own_base=is_own_base, slots=slots))

    def add(self, tile: int, maps: dict[str, Map], levels: Sequence[dict[str, Map]] = ()) -> None:
        """Add one UDIM tile of all maps, by name. Empty tiles are ignored: a triangle may touch a tile and cover no texel.

        levels: those of the maps that have mip levels, from level 1 on, if the settings write them.
        """
        texels, state = maps[NORMAL.name]
        if not state.any():
            return
        for vertices in self._vertices:
            vertices.add(tile, maps)
        if NORMAL.name in self._writers:
            self._writers[NORMAL.name].add(tile, texels)
        if MASK.name in self._writers:
            self._writers[MASK.name].add(tile, map_storage.black_and_white(state == MISSED))
        elif self.settings.storing.storage == Storage.FILE and not self.settings.storing.alpha:
            self._hides_misses |= bool((state == MISSED).any())
        self._empty -= {name for name in self._empty if (maps[name][0][..., 3] > 0.0).any()}
        self._add_others(tile, 0, maps)
        for level, level_maps in enumerate(levels, start=1):
            if NORMAL.name in self._writers:
                self._levels[NORMAL.name, level].add(tile, level_maps[NORMAL.name][0])
            self._add_others(tile, level, level_maps)

    def _add_others(self, tile: int, level: int, maps: dict[str, Map]) -> None:
        """Add one level of the maps beside the normal map."""
        for name in (name for name in self.settings.map.drawn_maps if name in maps):
            if name in self._late:
                self._late[name][tile, level] = maps[name][0]
            else:
                self._encode(name, tile, level, maps[name][0], self._encoding(name, []))
        if self._packed:
            self._unpacked[tile, level] = {name: maps[name][0] for name in self.settings.map.packing.maps}
            if not self._late.keys() & self._unpacked[tile, level].keys():
                self._pack()

    def commit(self, labels: dict[Labeled, Sequence[str]], lows: Sequence[bpy.types.Object]) -> Stored:
        """Store all images and attributes or none. Raises BakeError.

        labels: the names of objects and of materials, whose numbers in the maps start at 1. lows: the low objects, as in the
        calls of `sample_onto`; they become users of the images.
        """
        encodings = {}
        for name in self.settings.map.drawn_maps:
            labeled = BY_NAME[name].labeled
            encodings[name] = self._encoding(name, labels[labeled] if labeled else [])
            for (tile, level), texels in self._late.get(name, {}).items():
                self._encode(name, tile, level, texels, encodings[name])
            if name in self._empty:
                encodings[name] |= {"empty": True}
        maps = {name: encodings[name] for name in self.settings.map.maps}
        if self._packed:
            self._pack()
            maps[self._packed] = {"channels": value_encoding.channels(self.settings.map.packing, encodings)}
        writers = [*self._writers.values(), *self._levels.values()]
        stored = dict(zip(self._writers, map_storage.commit_all(writers), strict=True))
        for low in lows:
            datablocks.note_maps(low, stored.values())
        first = self._writers[self._first]
        warnings = sign(stored[self._first], labels[Labeled.OBJECTS])
        for image in stored.values():  # a bake may replace the files of maps that were baked before
            datablocks.set_source_objects(image, dict.fromkeys(labels[Labeled.OBJECTS]))
        if self._hides_misses:
            warnings.append(HIDDEN_MISSES)
        if self._cut_off:
            titles = shorten_list(BY_NAME[name].title for name in self.settings.map.drawn_maps if name in self._cut_off)
            cause = f"16-bit floats cut off values beyond 65,504 of the {titles}."
            warnings.append(Fix.DEPTH.after(cause))
        attributes = {}
        for vertices, low in zip(self._vertices, lows, strict=False):  # without attributes, there are only low objects
            names, more = vertices.store(low)
            attributes |= names
            warnings += more
        return Stored(
            image=stored[self._first],
            paths=[path for writer in self._writers.values() for path in writer.paths],
            tiles=list(first.tiles),
            mip_files={
                name.lower(): [path for level in levels for path in self._levels[name, level].paths]
                for name in self._writers
                if (levels := map_names.levels_of(self.settings, name))
            },
            maps={name.lower(): {"image": stored[name].name} | how for name, how in maps.items()},
            attributes=attributes,
            loss=first.loss,
            warnings=warnings,
        )

    def _settings_of(self, name: str) -> Settings:
        """The settings of the image that stores a map: its own, or the packed one."""
        return (self._writers.get(name) or self._writers[self._packed]).settings

    def _encoding(self, name: str, labels: Sequence[str]) -> dict:
        """How to decode a map. labels: as in value_encoding.encoding."""
        tiles = list(self._late.get(name, {}).values())
        return value_encoding.encoding(BY_NAME[name], tiles, labels, self._settings_of(name).storing)

    def _encode(self, name: str, tile: int, level: int, texels: np.ndarray, how: dict) -> None:
        """Encode a level of a tile of a map in place, and add it to its writer if it has one of its own."""
        if BY_NAME[name].is_color:
            datablocks.to_rec709(texels)
        if BY_NAME[name].kind is not Kind.NORMAL:
            value_encoding.encode(texels, how)
        settings = self._settings_of(name)
        storing = settings.storing
        is_half = storing.is_float and storing.storage == Storage.FILE and storing.depth == value_encoding.HALF
        if (
            is_half
            and BY_NAME[name].family.shows_materials
            and np.abs(texels[..., :3]).max() > value_encoding.MOST_HALF
        ):
            self._cut_off.add(name)
        if name in self._writers:
            self._writer(name, level).add(tile, texels)

    def _writer(self, name: str, level: int) -> map_storage.Writer:
        return self._levels[name, level] if level else self._writers[name]

    def _pack(self) -> None:
        """Add the encoded maps that wait to the packed image."""
        for (tile, level), maps in self._unpacked.items():
            self._writer(self._packed, level).add(tile, value_encoding.packed(self.settings.map.packing, maps))
        self._unpacked.clear()


def sign(image: bpy.types.Image, highs: Sequence[str]) -> list[str]:
    """Store the names of the high objects in `image`. Returns a warning if its map replaced one of other objects."""
    highs = list(dict.fromkeys(highs))
    before = map_storage.replaced(image.name, highs)
    datablocks.set_source_objects(image, highs)
    if not before:
        return []
    return [f"The map of {shorten_list(map(repr, highs))} replaced a map of {before} in the image {image.name!r}."]


def into_materials(
    low: bpy.types.Object, stored: Stored, uv_layer: str, settings: Settings, *, slots: Sequence[int] | None = None
) -> list[str]:
    """Show the stored maps in the materials of `low`, as far as the settings say. Returns warnings.

    slots: the numbers of the material slots that a texture set belongs to; None for all.
    """
    warnings = []
    if settings.storing.material and settings.map.normal:
        warnings += hook_up(low, stored.image, uv_layer, settings, slots=slots)
    if settings.storing.connect_maps:
        warnings += connect_maps(
            low, stored.maps, uv_layer, space=settings.map.space, single_user=settings.storing.single_user, slots=slots
        )
    return list(dict.fromkeys(warnings))


def hook_up(
    low: bpy.types.Object,
    image: bpy.types.Image,
    uv_layer: str,
    settings: Settings,
    *,
    slots: Sequence[int] | None = None,
) -> list[str]:
    """Show `image` as the normal map in the materials of `low`. Returns warnings. slots: as in `into_materials`."""
    return materials.hook_up(
        low,
        image,
        space=settings.map.space,
        uv_layer=uv_layer,
        channels=settings.map.channels,
        single_user=settings.storing.single_user,
        slots=slots,
    )


def connect_maps(
    low: bpy.types.Object,
    maps: dict[str, dict],
    uv_layer: str,
    *,
    space: str,
    single_user: bool,
    slots: Sequence[int] | None = None,
) -> list[str]:
    """Connect maps other than the normal map, as in Report.maps, in the materials of `low`. Returns warnings.

    Maps whose images are no longer there are left out, with a warning. space, single_user: as in Settings. slots: as in
    `into_materials`.
    """
    images, warnings = materials.images_of_report(maps, space)
    if not images:
        return warnings
    return warnings + materials.connect_maps(low, images, uv_layer=uv_layer, single_user=single_user, slots=slots)
