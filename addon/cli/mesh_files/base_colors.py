# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives meshes that are imported without a material one that shows their images or vertex colors, as programs for scans do."""

from collections.abc import Iterable
from pathlib import Path

import bpy
import numpy as np

from ... import older_blender
from ...core.file_structure import mesh_references
from .ply import Texture

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
        path = mesh_references.find_file(name, [folder]) or mesh_references.expected_path(name, folder)
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
    found = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", found)
    return np.array_equal(found, corners.ravel())


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
