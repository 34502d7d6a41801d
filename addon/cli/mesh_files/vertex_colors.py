# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives meshes with vertex colors and without a material one that shows the colors, as programs for scans do."""

from collections.abc import Iterable

import bpy


def show(objects: Iterable[bpy.types.Object]) -> None:
    """Give each object that has an active color attribute and no material one with this attribute as its base color."""
    for obj in objects:
        active = obj.data.color_attributes.active_color
        if active is not None and not any(slot.material for slot in obj.material_slots):
            obj.data.materials.append(_material(active.name))


def _material(attribute: str) -> bpy.types.Material:
    material = bpy.data.materials.new(attribute)
    tree = material.node_tree
    color = tree.nodes.new("ShaderNodeVertexColor")
    color.layer_name = attribute
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    return material
