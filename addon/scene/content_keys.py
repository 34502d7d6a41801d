# SPDX-License-Identifier: GPL-3.0-or-later
"""Short keys of what images and nodes show, whatever they are called: two that are equal look the same in a map."""

import zlib
from collections.abc import Iterable, Iterator
from typing import Any

import bpy
import numpy as np

from ..core import foreach
from ..core.contents import Contents, short
from . import dependencies, textures

GONE = "gone"
"""The key of a file that cannot be read."""
_LAYOUT = {*bpy.types.Node.bl_rna.properties.keys(), *bpy.types.NodeSocket.bl_rna.properties.keys()} - {"mute"}
"""Properties of nodes and sockets that all of them have: where they lie, how they are drawn."""
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


def of_bytes(data: bytes) -> str:
    """The key of a packed file."""
    return f"{len(data):x}:{zlib.crc32(data):08x}"


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
    packed = [of_bytes(each.packed_file.data) for each in image.packed_files if each.packed_file]
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


def of_tree(tree: bpy.types.NodeTree) -> str:
    """The key of a tree of nodes: all that its nodes are set to, and how they are linked."""
    return short(_plain_tree(tree, ()))


def _plain_tree(tree: bpy.types.NodeTree, around: tuple[bpy.types.NodeTree, ...]) -> list[Any]:
    """A tree as plain data. around: the trees that it is in; none is in itself."""
    if tree in around:
        return []
    around = (*around, tree)
    numbers = {node.name: number for number, node in enumerate(tree.nodes)}
    nodes = [
        [
            node.bl_idname,
            _plain_struct(node, around, _LAYOUT),
            [
                [socket.identifier, _plain_value(getattr(socket, "default_value", None), around)]
                for socket in (*node.inputs, *node.outputs)
            ],
        ]
        for node in tree.nodes
    ]
    links = sorted(
        [
            numbers[link.from_node.name],
            link.from_socket.identifier,
            numbers[link.to_node.name],
            link.to_socket.identifier,
            link.is_muted,
        ]
        for link in tree.links
    )
    return [nodes, links]


def _plain_struct(struct: bpy.types.bpy_struct, around: tuple, left_out: Iterable[str] = ()) -> list[Any]:
    return [
        [prop.identifier, _plain_value(getattr(struct, prop.identifier), around)]
        for prop in struct.bl_rna.properties
        if prop.identifier not in _SHOWN and prop.identifier not in left_out and not prop.identifier.startswith("bl_")
    ]


def _plain_value(value: Any, around: tuple) -> Any:
    """The value of a property as plain data. Datablocks count by what they show."""
    match value:
        case None | bool() | int() | float() | str():
            return value
        case bpy.types.Image():
            return of_image(value)
        case bpy.types.NodeTree():
            return _plain_tree(value, around)
        case bpy.types.Object():
            return np.array(value.matrix_world, np.float32).tolist()
        case bpy.types.ID():
            return value.name
        case bpy.types.bpy_prop_collection():
            return [_plain_value(each, around) for each in value]
        case bpy.types.Node() | bpy.types.NodeSocket() | bpy.types.NodeLink():
            return value.name if isinstance(value, bpy.types.Node) else ""
        case bpy.types.bpy_struct():
            return _plain_struct(value, around)
        case set():
            return sorted(value)
    return list(_floats(value))


def _floats(values: Iterable[Any]) -> Iterator[Any]:
    """Vectors, colors and arrays, also of several dimensions."""
    for value in values:
        yield list(_floats(value)) if hasattr(value, "__iter__") and not isinstance(value, str) else value
