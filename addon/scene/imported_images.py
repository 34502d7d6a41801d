# SPDX-License-Identifier: GPL-3.0-or-later
"""The images of imported meshes: where their files are, their tiles, and those that Blender's importers leave out."""

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import bpy
import numpy as np

from .. import older_blender
from ..core import foreach, udim
from ..core.file_formats import OPEN_EXR
from ..core.file_structure import found_files
from ..core.file_structure.obj_files import NamedImage
from ..core.file_structure.ply_files import Texture
from .textures import location

_LINEAR = {*OPEN_EXR.endings, ".hdr"}
"""Endings of images that store linear colors."""


def replace_placeholders(images: Iterable[bpy.types.Image], named: Mapping[str, NamedImage], folder: Path) -> None:
    """Give the images of an .obj their files. named: by the name of the file that each image has now. folder: of the .obj.

    No image is loaded. An image whose file is missing gets the path where it should be.
    """
    for image in images:
        named_image = named.get(os.path.basename(image.filepath))
        if named_image is None:
            continue
        path = named_image.path or found_files.expected_path(named_image.name, folder)
        image.filepath = str(path)
        image.name = path.name
        if not named_image.is_color:
            image.colorspace_settings.is_data = True
        elif path.suffix.lower() in _LINEAR:
            image.colorspace_settings.name = "Linear Rec.709"
        if udim.TOKEN in path.name:
            _make_tiled(image, path)


def find_missing_files(images: Iterable[bpy.types.Image], folder: Path) -> None:
    """Look in `folder`, of the mesh file, for the files of new images that are not where their paths say.

    The importers of some formats load images; their memory is freed.
    """
    for image in images:
        if image.source == "FILE" and not image.packed_file and image.filepath:
            is_there = found_files.is_file(Path(location(image, 0)))
            if not is_there and (elsewhere := found_files.find_file(image.filepath, [folder])):
                image.filepath = str(elsewhere)
        if image.has_data and not image.is_dirty and image.source in {"FILE", "TILED"}:
            image.buffers_free()


def tile_numbered_images(objects: Iterable[bpy.types.Object]) -> None:
    """Tile the images of materials whose UVs lie on several UDIM tiles, and whose files are numbered, as scan_1001.png."""
    for obj in objects:
        for number, slot in enumerate(obj.material_slots):
            for image in _images(slot.material):
                path = Path(bpy.path.abspath(image.filepath)) if image.source == "FILE" and image.filepath else None
                tiled = path and found_files.tiled_path(path)
                if tiled and len(found_files.existing_tiles(tiled)) > 1 and len(_tiles_of(obj.data, number)) > 1:
                    image.filepath = str(tiled)
                    _make_tiled(image, tiled)


def images_of(objects: Iterable[bpy.types.Object]) -> list[bpy.types.Image]:
    """The images that materials of `objects` use, each once."""
    materials = dict.fromkeys(slot.material for obj in objects for slot in obj.material_slots)
    return list(dict.fromkeys(image for material in materials for image in _images(material)))


def _make_tiled(image: bpy.types.Image, path: Path) -> None:
    """Make `image` a tiled one, with all tiles that exist for `path`, which contains <UDIM>."""
    image.source = "TILED"
    numbers = found_files.existing_tiles(path)
    for number in numbers:
        if number not in {tile.number for tile in image.tiles}:
            image.tiles.new(tile_number=number)
    for tile in [tile for tile in image.tiles if numbers and tile.number not in numbers]:
        image.tiles.remove(tile)


def _images(material: bpy.types.Material | None) -> Iterator[bpy.types.Image]:
    """The images of the nodes of a material and its groups."""
    left, seen = [material.node_tree] if material and material.node_tree else [], set()
    while left:
        tree = left.pop()
        if tree in seen:
            continue
        seen.add(tree)
        for node in tree.nodes:
            if node.type == "GROUP" and node.node_tree:
                left.append(node.node_tree)
            elif node.type == "TEX_IMAGE" and node.image:
                yield node.image


def missing_tiles(objects: Iterable[bpy.types.Object]) -> list[str]:
    """The files of tiles on which faces have UVs, and which the tiled images of their materials do not have."""
    paths = []
    for obj in objects:
        for number, slot in enumerate(obj.material_slots):
            tiled = [image for image in _images(slot.material) if image.source == "TILED" and image.filepath]
            used = _tiles_of(obj.data, number) if tiled else []
            numbers = {udim.number(u, v) for u, v in used if 0 <= u < udim.COLUMNS and 0 <= v < udim.ROWS}
            for image in tiled:
                missing = sorted(numbers - {tile.number for tile in image.tiles})
                paths += [udim.fill_all(bpy.path.abspath(image.filepath), tile) for tile in missing]
    return list(dict.fromkeys(paths))


def _tiles_of(data: bpy.types.Mesh, material: int) -> list[tuple[int, int]]:
    """The column and row of each UDIM tile on which the faces of a material have UVs."""
    layer = data.uv_layers.active
    if layer is None:
        return []
    sizes, materials = (foreach.read(data.polygons, name) for name in ("loop_total", "material_index"))
    own = foreach.vectors(layer.uv, width=2)[np.repeat(materials == material, sizes)]
    # Exactly on the border, a corner belongs to both tiles.
    tiles = np.unique(np.floor(own[(own % 1.0 != 0.0).all(axis=1)]), axis=0)
    return [(int(column), int(row)) for column, row in tiles if np.isfinite(column + row)]


UV_LAYER = "UVMap"


def show_texture(obj: bpy.types.Object, texture: Texture, folder: Path) -> None:
    """Show the images of a .ply on its mesh, with its UVs. Does nothing for a mesh without UVs. folder: of the file."""
    data = obj.data
    is_same = texture.corners is not None and _has_corners(data, texture.corners)
    if is_same:
        layer = data.uv_layers.new(name=UV_LAYER)
        layer.uv.foreach_set("vector", texture.uv.ravel())
    if not data.uv_layers:
        return
    for name in texture.names:
        path = found_files.find_file(name, [folder]) or found_files.expected_path(name, folder)
        # An image that is made, not loaded, may be missing.
        image = bpy.data.images.new(path.name, 1, 1)
        image.source, image.filepath = "FILE", str(path)
        data.materials.append(_material(path.stem, "ShaderNodeTexImage", image=image))
    if is_same:
        numbers = np.clip(texture.images, 0, len(texture.names) - 1).astype(np.int32)
        data.polygons.foreach_set("material_index", numbers)


def show_vertex_colors(objects: Iterable[bpy.types.Object]) -> None:
    """Show the active color attribute of each object that has one and no material."""
    for obj in objects:
        active = obj.data.color_attributes.active_color
        if active is not None and not any(slot.material for slot in obj.material_slots):
            obj.data.materials.append(_material(active.name, "ShaderNodeVertexColor", layer_name=active.name))


def _has_corners(data: bpy.types.Mesh, corners: np.ndarray) -> bool:
    """Whether the faces of a mesh are these triangles (T, 3) of points, in this order: the importer may leave some out."""
    if len(data.loops) != corners.size or len(data.polygons) != len(corners):
        return False
    return np.array_equal(foreach.read(data.loops, "vertex_index"), corners.ravel())


def _material(name: str, node_type: str, **values) -> bpy.types.Material:
    """A material whose base color is the output of a node with these values."""
    material = bpy.data.materials.new(name)
    older_blender.switch_on_nodes(material)
    tree = material.node_tree
    node = tree.nodes.new(node_type)
    for key, value in values.items():
        setattr(node, key, value)
    surface = next(each for each in tree.nodes if each.type == "BSDF_PRINCIPLED")
    tree.links.new(node.outputs["Color"], surface.inputs["Base Color"])
    return material
