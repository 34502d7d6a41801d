# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake of some low objects keeps of a map that others share: who these are, and whether their texels can stay.

The texels of a low object, with its margin, stay to the bit while another one is baked into the same image or file. Where they
could not, the bake is refused before it starts.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import bpy

from ..core import udim
from ..core.declarations.choices import Space, Storage
from ..core.errors import BakeError
from ..core.map_types import BY_NAME, Kind
from ..core.settings import Settings
from ..mesh import uv_layout
from ..mesh.triangle_mesh import Mesh
from ..output import datablocks, map_names, shared_maps, value_encoding
from ..output.shared_maps import Part
from ..scene import evaluation, object_checks, reading
from .job import Job, users_of_image


@dataclass(frozen=True)
class Kept:
    """The parts of each map that are not baked, by the map's name, and their low meshes with UVs.

    Attributes:
        tiles: Of each map, in which their texels were found.
    """

    parts: dict[str, list[Part]] = field(default_factory=dict)
    tiles: dict[str, list[int]] = field(default_factory=dict)
    lows: list[Mesh] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.lows)


def kept(context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, *, is_shared: bool = False) -> Kept:
    """What the bake of these jobs into the same maps keeps. Raises BakeError if it would lose texels of others.

    settings: with names filled in. is_shared: whether the low objects share the maps on purpose, also those without a record,
    of earlier versions.
    """
    search, parts, tiles = _Search(context, jobs, settings), {}, {}
    for name, of_map in map_names.settings_by_map(settings).items():
        others = list(search.others(of_map, is_shared=is_shared))
        shared_maps.check_room(map_names.output_for(of_map), len(set(search.lows)) + len(others))
        if others:
            parts[name] = others
            tiles[name] = _check(name, of_map, others, [search.found[part] for part in others], search)
    lows = {id(search.found[part]): search.found[part] for others in parts.values() for part in others}
    return Kept(parts, tiles, list(lows.values()))


def check_alone(context: bpy.types.Context, job: Job, settings: Settings, what: str) -> None:
    """Raise BakeError if others are in the maps of a job that writes all of them. what: that job, in a sentence."""
    search = _Search(context, [job], settings)
    for of_map in map_names.settings_by_map(settings).values():
        others = list(search.others(of_map, is_shared=False))
        if others:
            raise BakeError(
                f"{_place(of_map)} also has the map of {shared_maps.listed(others)}, which {what} would replace: choose "
                "another name."
            )


def part_of(low: Mesh, uv_layer: str, *, is_own_base: bool) -> Part:
    """The part of a low mesh that is baked."""
    return Part.of(low.name, uv_layer, low.uv, is_own_base=is_own_base)


class _Search:
    """Looks for the low objects of parts in the open file. found: their meshes."""

    def __init__(self, context: bpy.types.Context, jobs: Sequence[Job], settings: Settings):
        self.context, self.jobs, self.settings = context, jobs, settings
        self.lows = [job.low for job in jobs]
        self.found: dict[Part, Mesh] = {}
        self._own: list[tuple[Part, Mesh]] | None = None
        self._known: dict[tuple[int, str, bool], tuple[Part, Mesh]] = {}

    def others(self, of_map: Settings, *, is_shared: bool) -> Iterator[Part]:
        """The parts of a map that are not baked, as they are in this file. Raises BakeError for one that is not in it."""
        name = of_map.storing.image
        in_image, in_files = shared_maps.parts_of_image(name), shared_maps.parts_of_files(of_map)
        users = list(users_of_image(name))
        for part in shared_maps.joined(in_files, in_image):
            if part.name in {low.name for low in self.lows}:
                continue
            obj = _object(part.name) or self._of_layout(part, users)
            if obj is not None:
                if obj not in self.lows:
                    yield self._kept(obj, of_map, part.uv_layer, part.is_own_base)
            elif part in in_files and part.layout not in {own.layout for own, _ in self.baked()}:
                raise BakeError(
                    f"{_place(of_map)} also has the map of {shared_maps.listed([part])}, which is not in this file, and "
                    "would lose it: choose another name for the map, or delete that file first."
                )
        if is_shared and not in_image and not in_files:
            yield from (self._kept(obj, of_map) for obj in users if obj not in self.lows)

    def baked(self) -> list[tuple[Part, Mesh]]:
        """The low objects that are baked."""
        if self._own is None:
            self._own = [self._part(job.low, self.settings.map.uv_layer, job.low in job.highs) for job in self.jobs]
        return self._own

    def _of_layout(self, part: Part, users: Sequence[bpy.types.Object]) -> bpy.types.Object | None:
        """The user of an image that has the UVs of a part: it was renamed."""
        for obj in users:
            with suppress(BakeError):  # without UVs, it is another one
                if self._read(obj, part.uv_layer, part.is_own_base)[0].layout == part.layout:
                    return obj
        return None

    def _kept(self, obj: bpy.types.Object, of_map: Settings, uv_layer: str = "", is_own_base: bool = False) -> Part:
        """The part of an object that is not baked, whose mesh is noted. Raises BakeError if it has no UVs any more."""
        try:
            part, mesh = self._read(obj, uv_layer, is_own_base)
        except BakeError as error:
            raise BakeError(
                f"{_place(of_map)} also has the map of {obj.name!r}, whose texels cannot be told "
                f"({str(error).removesuffix('.')}): mend or delete that object, or choose another name for the map."
            ) from error
        self.found[part] = mesh
        return part

    def _read(self, obj: bpy.types.Object, uv_layer: str, is_own_base: bool) -> tuple[Part, Mesh]:
        """An object as a part with that UV map, or with another one if it has that no more."""
        key = obj.session_uid, uv_layer, is_own_base
        if key not in self._known:
            try:
                self._known[key] = self._part(obj, uv_layer, is_own_base)
            except BakeError:
                self._known[key] = self._part(obj, "", False)
        return self._known[key]

    def _part(self, obj: bpy.types.Object, uv_layer: str, is_own_base: bool) -> tuple[Part, Mesh]:
        settings = self.settings.mapped(uv_layer=uv_layer, space=Space.OBJECT, texture_sets=False)
        meshes = evaluation.evaluate(
            self.context,
            [obj],
            lambda depsgraph: reading.read_low(depsgraph, obj, None, settings, is_own_base=is_own_base),
            modifiers=settings.map.modifiers,
        )
        return part_of(meshes.low, meshes.uv_layer, is_own_base=is_own_base), meshes.low


def _object(name: str) -> bpy.types.Object | None:
    obj = bpy.data.objects.get(name) if name else None
    return obj if obj is not None and obj.type == "MESH" and not object_checks.is_deleted(obj) else None


def _place(of_map: Settings) -> str:
    output = map_names.output_for(of_map)
    return f"The file {output!r}" if output else f"The image {of_map.storing.image!r}"


def _check(name: str, of_map: Settings, parts: Sequence[Part], lows: Sequence[Mesh], search: _Search) -> list[int]:
    """The tiles in which texels of `parts` are stored. Raises BakeError if they cannot stay in a map."""
    whose = shared_maps.listed(parts)
    reason = _problem(name, of_map)
    if reason:
        raise BakeError(f"{_place(of_map)} also has the map of {whose}, which would change: {reason}")
    tiles = _tiles(of_map, lows)
    _check_place(of_map, parts, tiles, search)
    wanted = shared_maps.wanted(of_map)
    stored = {tile: one for tile in tiles if (one := shared_maps.stored(of_map, tile)) is not None}
    for one in stored.values():
        if one.format != wanted:
            raise BakeError(
                f"{one.where} also has the map of {whose}, as {one.format}, and this bake would make it {wanted}: bake "
                "all of them together, or with the same settings as before."
            )
    return list(stored)


def _tiles(of_map: Settings, lows: Iterable[Mesh]) -> list[int]:
    return sorted({tile for low in lows for tile in uv_layout.tiles(low)}) if of_map.sampling.udim else [udim.FIRST]


def _check_place(of_map: Settings, parts: Sequence[Part], tiles: Sequence[int], search: _Search) -> None:
    """Raise BakeError if the image has texels of `parts` that this bake would replace, and not find to keep them. tiles: of the
    parts. Other tiles than those that are baked stay, or are copied to the new place."""
    image = datablocks.get(of_map.storing.image)
    if image is not None and shared_maps.parts_of_files(of_map):  # the others are only in the files
        in_image = shared_maps.parts_of_image(image.name)
        parts = [part for part in parts if any(part.is_same(known) for known in in_image)]
    if image is None or not parts:
        return
    where, whose = _place(of_map), shared_maps.listed(parts)
    lost = [tile for tile in tiles if shared_maps.is_elsewhere(of_map, tile)]
    if lost and not shared_maps.is_other_kind(of_map):
        lost = set(lost).intersection(_tiles(of_map, (low for _, low in search.baked())))
    if lost and of_map.storing.storage == Storage.FILE:
        raise BakeError(
            f"The map of {whose} in the image {image.name!r} is not in {_lower(where)}: bake all of them together."
        )
    if lost:
        raise BakeError(f"{where} has the map of {whose} in another way than this bake: bake all of them together.")
    if of_map.storing.storage == Storage.FILE and image.is_dirty:
        raise BakeError(f"The image {image.name!r} has unsaved changes, also on {whose}: save it first.")


def _lower(where: str) -> str:
    return where[0].lower() + where[1:]


def _problem(name: str, of_map: Settings) -> str:
    """Why texels of a map do not stay true beside new ones, and what to do, in a clause; empty if they do."""
    if len(map_names.levels_of(of_map, name)):
        return "its mip levels mix all objects. Bake all of them together, or without mip files."
    packing = of_map.map.packing
    own = packing.maps if packing is not None and name == packing.map_type.name else [name]
    types = [BY_NAME[each] for each in own if each in BY_NAME]
    if any(each.kind is Kind.LABEL for each in types):
        return "its colors are numbered over all objects. Bake all of them together."
    is_fixed = of_map.storing.value_range is not None
    if any(value_encoding.needs_range(each, of_map.storing) and (each.is_color or not is_fixed) for each in types):
        return (
            "its values are scaled by the largest of all objects. Bake all of them together, into a file of floats, or with a "
            "fixed range."
        )
    return ""
