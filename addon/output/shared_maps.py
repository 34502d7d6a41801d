# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps that several low objects share: which of them are in an image or a file, and its texels as they are stored.

An image has the record of its parts in a custom property, a file in its metadata, so that a bake of some of them knows whose
texels it has to keep, also in another scene.
"""

import functools
import json
import os
import tempfile
import uuid
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import bpy
import numpy as np

from ..core import file_formats, foreach, udim
from ..core.declarations.choices import Storage
from ..core.errors import BakeError, shorten_list
from ..core.settings import Settings
from . import datablocks, image_file, journal
from .image_file import Format
from .map_names import output_for
from .value_encoding import HALF

RECORD = "imprint_low"
"""The custom property of images with the record of their parts."""
HOME = "imprint_home"
"""The custom property of an image with a record, and of a scene, that tells the .blend in which the image was baked: an image
that was appended has that of another one."""
PNG_START = b"\x89PNG"
LONGEST_IN_TARGA = 320
"""Bytes of a record in a Targa file, whose comment has four lines of 80 letters. Of a longer one, only checksums are kept."""
NUMBERS_OF_SAMPLES = [2**power for power in range(7)]
"""Those that a record can have: files hold anything."""
MOST_IN_TARGA = 29
"""Parts whose checksums have room there: each takes up to 10 digits and a comma, and the list two brackets."""


@journal.plain
@dataclass(frozen=True)
class Part:
    """A low object in a map, or its faces with one material.

    Attributes:
        uv_layer: Of its UVs there.
        is_own_base: Whether these are of its mesh without modifiers.
        layout: A checksum of the UVs, by which it is known if it was renamed. Names are empty where only that was kept.
        name: Of the low object.
        material: The name of that of its faces; empty for all of them.
        samples: Of a texel, which decide the texels at its borders; 0 for those of the bake that asks.
    """

    name: str
    uv_layer: str
    is_own_base: bool
    layout: int
    material: str = ""
    samples: int = 0

    @classmethod
    def of(
        cls, name: str, uv_layer: str, uv: np.ndarray, *, is_own_base: bool, material: str = "", samples: int = 0
    ) -> "Part":
        """The part of a low mesh with the UVs (C, 2) float32, of the corners of its faces."""
        return cls(name, uv_layer, is_own_base, checksum(uv), material, samples)

    def is_same(self, other: "Part") -> bool:
        """Whether both are of one low object."""
        is_named = bool(self.name) and (self.name, self.material) == (other.name, other.material)
        return is_named or self.layout == other.layout


def checksum(uv: np.ndarray) -> int:
    """A checksum of UVs (C, 2) that stays where their last bits change, as with each evaluation of Blender's Bevel modifier."""
    within = np.clip(np.nan_to_num(uv.astype(np.float64)), -FARTHEST, FARTHEST)
    return zlib.crc32(np.floor(within * STEPS + 0.37).astype(np.int64))


STEPS = 173.3
"""Steps of UVs that count as the same layout, for a tile: no usual UV lies at the end of one."""
FARTHEST = 2.0**40
"""The farthest UV that is told apart."""


def former_checksum(uv: np.ndarray) -> int:
    """As `checksum`, of all bits, in maps of version 0.3 and earlier."""
    return zlib.crc32(np.ascontiguousarray(uv))


def joined(parts: Sequence[Part], more: Iterable[Part]) -> list[Part]:
    """The parts of a record, and those of another one that are not in it."""
    return [*parts, *(part for part in more if not any(part.is_same(known) for known in parts))]


def listed(parts: Sequence[Part]) -> str:
    """The low objects of parts in a sentence."""
    return shorten_list(repr(part.name) if part.name else "an object of another scene" for part in parts)


def to_text(parts: Sequence[Part], path: str | Path = "") -> str:
    """The record of parts in ASCII; empty for none. path: the file that it is for, in which it must have room."""
    items = [astuple(part)[: 6 if part.samples else 5 if part.material else 4] for part in parts]
    text = json.dumps(items, separators=(",", ":")) if parts else ""
    is_targa = bool(path) and file_formats.of(path) is file_formats.TARGA
    if is_targa and len(text) > LONGEST_IN_TARGA:
        return json.dumps([part.layout for part in parts], separators=(",", ":"))
    return text


def check_room(path: str | Path, count: int) -> None:
    """Raise BakeError if the file at `path` has no room for a record of that many parts."""
    if path and count > MOST_IN_TARGA and file_formats.of(path) is file_formats.TARGA:
        raise BakeError(
            f"{str(path)!r} would be shared by {count} low objects, and a Targa file has room to note {MOST_IN_TARGA}: choose "
            "another format, or bake fewer objects into one image."
        )


def _from_text(text: str) -> list[Part]:
    """The parts of a record; none if it is not one: files hold anything."""
    try:
        items = json.loads(text) if text else []
    except (ValueError, RecursionError):
        return []
    return [part for item in (items if isinstance(items, list) else []) if (part := _part(item)) is not None]


def _part(item: object) -> Part | None:
    match item:
        case [str(name), str(uv_layer), bool(is_own_base), int(layout)]:
            return Part(name, uv_layer, is_own_base, layout)
        case [str(name), str(uv_layer), bool(is_own_base), int(layout), str(material)]:
            return Part(name, uv_layer, is_own_base, layout, material)
        case [str(name), str(uv_layer), bool(is_own_base), int(layout), str(material), int(samples)] if (
            samples in NUMBERS_OF_SAMPLES
        ):
            return Part(name, uv_layer, is_own_base, layout, material, samples)
        case int(layout):
            return Part("", "", False, layout)
    return None


@journal.recorded
def note(image: bpy.types.Image, parts: Sequence[Part]) -> None:
    """Store the parts of a map in its image."""
    if parts:
        image[RECORD], image[HOME] = to_text(parts), _home()
    elif RECORD in image:
        del image[RECORD]


def _home() -> str:
    """What tells this .blend, and copies of it, from others: kept in its scenes, for a file has no properties."""
    scenes = bpy.data.scenes
    home = next((one[HOME] for one in scenes if one.get(HOME)), "") or uuid.uuid4().hex[:12]
    for scene in scenes:
        if scene.is_editable and not scene.get(HOME):
            scene[HOME] = home
    return home


def is_at_home(image: bpy.types.Image) -> bool:
    """Whether the record of an image was made in this .blend, so that low objects in it that are gone were deleted here."""
    return bool(image.get(HOME)) and any(scene.get(HOME) == image[HOME] for scene in bpy.data.scenes)


def parts_of_image(name: str) -> list[Part]:
    """The parts of the map in an image; none if it has no record, or does not exist."""
    image = datablocks.get(name)
    return _from_text(str(image.get(RECORD, ""))) if image is not None else []


def parts_of_files(settings: Settings) -> list[Part]:
    """The parts of the map in the files that a bake of these settings would replace."""
    path = bpy.path.abspath(output_for(settings))
    if not path:
        return []
    paths = udim.files(path).values() if udim.TOKEN in path else [path] if os.path.isfile(path) else []
    return functools.reduce(joined, (_from_text(image_file.note_of(each)) for each in paths), [])


@dataclass(frozen=True)
class Stored:
    """The texels of one tile of a map, where a bake would put its own.

    Attributes:
        where: In a sentence.
        read: Reads them, (height, width, 4) float32.
    """

    where: str
    format: Format
    read: Callable[[], np.ndarray]


def stored(settings: Settings, tile: int) -> Stored | None:
    """What is stored of a tile where a bake of these settings puts its map; None if nothing is. Raises BakeError for a file
    that is no image."""
    storing, image = settings.storing, datablocks.get(settings.storing.image)
    if storing.storage == Storage.FILE:
        path = _path(settings, tile)
        return _in_file(path) if path.is_file() else None
    if image is None:
        return None
    where = f"The image {image.name!r}"
    if settings.sampling.udim:
        content = dict(datablocks.tile_contents(image)).get(tile) if image.source == "TILED" else None
        return None if content is None else _in_tile(content, where)
    if not image.size[0]:
        return None
    # What is written here shows in its pixels: in which depth it was packed does not matter.
    return Stored(
        where, Format(tuple(image.size), wanted(settings).depth, image.is_float), functools.partial(_pixels, image.name)
    )


def is_elsewhere(settings: Settings, tile: int) -> bool:
    """Whether the image of these settings, which exists, has a tile in another place than where a bake would look for it."""
    image = datablocks.get(settings.storing.image)
    if is_other_kind(settings):
        return True
    if settings.storing.storage != Storage.FILE:
        return not settings.sampling.udim and not image.size[0]  # its file is gone
    path = _path(settings, tile)
    if settings.sampling.udim:
        content = dict(datablocks.tile_contents(image)).get(tile)
        return content is not None and not _is_in_file(content, path)
    # A packed image has the source FILE as well, and may still have the path of a file.
    packed = image.packed_file
    content = Path(bpy.path.abspath(image.filepath)) if packed is None else packed.data
    return image.source != "FILE" or not _is_in_file(content, path)


def is_other_kind(settings: Settings) -> bool:
    """Whether the image of these settings, which exists, has tiles and a bake would make one picture of it, or the reverse."""
    return (datablocks.get(settings.storing.image).source == "TILED") != settings.sampling.udim


def _path(settings: Settings, tile: int) -> Path:
    return Path(bpy.path.abspath(udim.fill(output_for(settings), tile)))


def _is_in_file(content: bytes | Path, path: Path) -> bool:
    """Whether the file at `path` is there and is `content`: that file, or packed bytes equal to its own."""
    if not path.is_file():
        return False
    if isinstance(content, Path):
        return content.is_file() and content.samefile(path)
    return len(content) == path.stat().st_size and content == path.read_bytes()


def wanted(settings: Settings) -> Format:
    """How a bake of these settings stores a map."""
    storing = settings.storing
    if storing.storage == Storage.FILE:
        depth = HALF if storing.is_half else storing.depth
        return Format(settings.sampling.size, depth, storing.is_float, storing.has_alpha)
    return Format(settings.sampling.size, 32 if storing.is_float else 8, storing.is_float)


def _in_file(path: Path) -> Stored:
    return Stored(f"The file {str(path)!r}", image_file.format_of(path), functools.partial(image_file.read, path))


def _in_tile(content: bytes | Path, where: str) -> Stored:
    """What a packed tile, or a file, holds."""
    if isinstance(content, Path):
        return _in_file(content)
    is_float = not content.startswith(PNG_START)
    with tempfile.TemporaryDirectory(prefix="imprint-") as folder:
        path = Path(folder, f"tile{file_formats.PACKED[is_float].endings[0]}")
        path.write_bytes(content)
        stored = _in_file(path)
        texels = stored.read()
    return Stored(where, stored.format, lambda: texels)


def _pixels(name: str) -> np.ndarray:
    return foreach.pixels(datablocks.get(name))
