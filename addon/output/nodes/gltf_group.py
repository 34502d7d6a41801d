# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group from which Blender's glTF exporter takes the ambient occlusion. It changes nothing in renders."""

import bpy
from bpy.types import Node, ShaderNodeTree

from .tree_editing import TreeEditor

NAME = "glTF Material Output"
"""The exporter looks for groups whose names start with this, or with the older name, in any case."""
OLDER_NAME = "glTF Settings"
OCCLUSION = "Occlusion"
SOCKETS = {
    OCCLUSION: 0.0,
    "Thickness": 0.0,
    "Dispersion": 0.0,
    "Iridescence Factor": 0.0,
    "Iridescence Thickness Minimum": 100.0,
}
"""The inputs of the exporter's own group, create_settings_group of io_scene_gltf2/blender/com/material_helpers.py, with
their defaults. The importer relies on all of them."""


def node_of(editor: TreeEditor) -> Node:
    """The node that the exporter reads in a material. Adds it if there is none."""
    for node in editor.nodes_of("ShaderNodeGroup"):
        if node.node_tree and _is_exporters(node.node_tree) and OCCLUSION in node.inputs:
            return node
    node = editor.add("ShaderNodeGroup", "occlusion", NAME, editor.outputs()[0])
    node.node_tree = _group()
    return node


def _is_exporters(group: ShaderNodeTree) -> bool:
    return group.name.lower().startswith((NAME.lower(), OLDER_NAME.lower()))


def _group() -> ShaderNodeTree:
    """The group, made if the file has none with an input for occlusion."""
    found = bpy.data.node_groups.get(NAME)
    if found is not None and OCCLUSION in found.interface.items_tree:
        return found
    group = bpy.data.node_groups.new(NAME, "ShaderNodeTree")
    for name, value in SOCKETS.items():
        group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat").default_value = value
    group.nodes.new("NodeGroupOutput")
    group.nodes.new("NodeGroupInput").location = -200, 0
    return group
