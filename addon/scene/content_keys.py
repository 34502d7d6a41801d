# SPDX-License-Identifier: GPL-3.0-or-later
"""Short keys of what images and nodes show, whatever they are called: two that are equal look the same in a map."""

import ctypes
import zlib
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar

import bpy
import numpy as np

from ..core import foreach
from ..core.contents import Contents, short
from . import dependencies, textures

NEXT = (5, 4, 0)
"""The first version of Blender whose memory was not looked at."""
GONE = "gone"
"""The key of a file that cannot be read."""
_LAYOUT = set(bpy.types.Node.bl_rna.properties.keys())
"""Properties that all nodes have: where they lie, how they are drawn."""
_SHOWN = {
    *("show_texture", "is_evaluate_clipped", "tone", "black_level", "white_level", "use_clip", "clip_min_x"),
    *("clip_min_y", "clip_max_x", "clip_max_y", "rna_type", "select", "handle_type", "name", "active_item"),
}
"""Properties of what nodes have, as curves, that only an editor shows, or that others say as well."""

files = Contents()
"""The files that keys have read, of which each is read once in a session while it stays as it is."""


def of_file(path: str) -> str:
    """The key of the files at a path."""
    content = files.of(path)
    return content.sha256[:16] if content.sha256 else GONE


def of_packed(file: bpy.types.PackedFile) -> str:
    """The key of a packed file."""
    return f"{file.size:x}:{zlib.crc32(_memory_of(file) or file.data):08x}"


class _Packed(ctypes.Structure):
    """The start of Blender's PackedFile: it has been so since version 2.5."""

    _fields_: ClassVar = [("size", ctypes.c_int), ("seek", ctypes.c_int), ("data", ctypes.c_void_p)]


def _memory_of(file: bpy.types.PackedFile) -> ctypes.Array | None:
    """Blender's own memory of a packed file: its property `data` is a copy, which takes half a second for 64 MiB. None where it
    is not known how Blender stores it."""
    packed = _Packed.from_address(file.as_pointer())
    if bpy.app.version >= NEXT or packed.size != file.size or not packed.data:
        return None
    return (ctypes.c_char * packed.size).from_address(packed.data)


def of_array(values: np.ndarray) -> str:
    """The key of the content of an array, without its shape."""
    return f"{zlib.crc32(np.ascontiguousarray(values)):08x}"


def of_pixels(image: bpy.types.Image) -> str:
    """The key of the pixels of an image. Reads all of them."""
    return f"{tuple(image.size)}:{of_array(foreach.pixels(image))}"


def of_stored(image: bpy.types.Image) -> list[str]:
    """The keys of what an image is made from: packed files, files, or its pixels where neither has them."""
    if image.source == "GENERATED" or (image.is_dirty and image.source == "FILE"):
        return [of_pixels(image)]
    packed = [of_packed(each.packed_file) for each in image.packed_files if each.packed_file]
    if packed or not image.filepath:
        return packed
    return [of_file(dependencies.absolute(image.filepath, image))]


def of_image(image: bpy.types.Image | None) -> str:
    """The key of an image as materials show it."""
    if image is None:
        return ""
    space = image.colorspace_settings
    tiles = [tile.number for tile in image.tiles] if image.source == "TILED" else []
    shown = [of_stored(image), tiles, space.name, space.is_data, image.alpha_mode]
    return short([*shown, textures.is_converting()])


def settings_of(node: bpy.types.Node) -> list[Any]:
    """What a node is set to, beside the values of its sockets, as plain data. Datablocks count by what they show."""
    return _plain_struct(node, _LAYOUT)


def _plain_struct(struct: bpy.types.bpy_struct, left_out: Iterable[str] = ()) -> list[Any]:
    return [
        [prop.identifier, plain_value(getattr(struct, prop.identifier))]
        for prop in struct.bl_rna.properties
        if prop.identifier not in _SHOWN and prop.identifier not in left_out and not prop.identifier.startswith("bl_")
    ]


def plain_value(value: Any) -> Any:
    """The value of a property as plain data. Datablocks count by what they show."""
    match value:
        case None | bool() | int() | float() | str():
            return value
        case bpy.types.Image():
            return of_image(value)
        case bpy.types.Object():
            return np.array(value.matrix_world, np.float32).tolist()
        case bpy.types.ID():
            return value.name
        case bpy.types.bpy_prop_collection():
            return [plain_value(each) for each in value]
        case bpy.types.bpy_struct():
            return _plain_struct(value)
        case set():
            return sorted(value)
    return list(_floats(value))


def _floats(values: Iterable[Any]) -> Iterator[Any]:
    """Vectors, colors and arrays, also of several dimensions."""
    for value in values:
        yield list(_floats(value)) if hasattr(value, "__iter__") and not isinstance(value, str) else value
