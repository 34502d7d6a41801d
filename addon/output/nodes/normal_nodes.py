# SPDX-License-Identifier: GPL-3.0-or-later
"""Connects a normal map to the shaders of one material.

Image Texture -> Normal Map -> the Normal input of every shader that reaches the output, below any Bump nodes in between.
Connecting again reuses these nodes.
"""

from dataclasses import dataclass

from bpy.types import Image, Material, Node, NodeSocket

from ... import older_blender
from . import displacement_nodes, tree_editing
from .tree_editing import Coordinates, TreeEditor, title


@dataclass(frozen=True)
class NormalMapSettings:
    """The settings of the nodes. image: the normal map. normal_map: properties of the Normal Map node."""

    image: Image
    normal_map: dict[str, str]


def connect(material: Material, settings: NormalMapSettings, coordinates: Coordinates) -> list[str]:
    """Connect the map to every shader of the material's surface. Returns notes for the report."""
    editor = TreeEditor(material, coordinates)
    done: set[NodeSocket] = set()
    for shader in editor.shaders():
        normal = next((s for s in shader.inputs if s.name == "Normal" and s.type == "VECTOR" and s.enabled), None)
        if normal:
            _feed_normal(editor, settings, shader, normal, done)
        elif shader.bl_idname == "ShaderNodeGroup":
            editor.note(f"the group {title(shader)} has no Normal input, so the map does not reach the shaders in it.")
    if not done:
        editor.note("no shader with a Normal input reaches the output, so the map is not shown.")
    displacement_nodes.fit_normal_maps(editor)
    return editor.notes


def _feed_normal(
    editor: TreeEditor, settings: NormalMapSettings, shader: Node, normal: NodeSocket, done: set[NodeSocket]
) -> None:
    """Connect the map to a shader's Normal input, or to the first Bump node of the chain connected to it."""
    while normal not in done:  # another shader may share the chain
        done.add(normal)
        end, node, kind = editor.trace(normal)
        if kind == "ShaderNodeBump.Normal":
            normal = node.inputs["Normal"]
        elif kind in (None, "ShaderNodeNormalMap.Normal"):
            _feed_normal_map(editor, settings, node or editor.own_node("ShaderNodeNormalMap", "Normal", end))
        else:
            editor.note_unchanged(shader, "Normal", node, kind)


def _feed_normal_map(editor: TreeEditor, settings: NormalMapSettings, normal_map: Node) -> None:
    """Make a Normal Map node show the image, if its Color input is connected to an Image Texture or to nothing."""
    color = older_blender.normal_map_color(editor, normal_map, settings.normal_map)
    end, texture, kind = editor.trace(color)
    if kind not in (None, "ShaderNodeTexImage.Color"):
        editor.note_unchanged(normal_map, "Color", texture, kind)
        return
    if texture and tree_editing.is_foreign(texture.image):
        editor.note(
            f'{title(normal_map)} no longer shows "{texture.image.name}"; its node {title(texture)} was not removed.'
        )
        texture, end = None, color
    texture = texture or editor.own_node("ShaderNodeTexImage", "Color", end)
    tree_editing.change(normal_map, **older_blender.normal_map_values(normal_map, settings.normal_map))
    tree_editing.change(texture, image=settings.image)
    editor.feed_coordinates(texture)
