# SPDX-License-Identifier: GPL-3.0-or-later
"""Which modifiers give an object another surface than its base mesh, so that it can be its own high object."""

from collections.abc import Iterator

import bpy

from ..core.errors import shorten_list

ADDING = {
    "BEVEL",
    "BOOLEAN",
    "DISPLACE",
    "MULTIRES",
    "OCEAN",
    "REMESH",
    "SUBSURF",
    "WAVE",
}
"""Types of modifiers that leave the base mesh in its place and give it a finer or another surface. The rest move it as a
whole, copy it, cut its faces, or change only its normals, UVs and groups: onto its own base each of those bakes flat."""

PASSING_ON = {
    "GeometryNodeCaptureAttribute",
    "GeometryNodeJoinGeometry",
    "GeometryNodeMenuSwitch",
    "GeometryNodeRemoveAttribute",
    "GeometryNodeRenameAttribute",
    "GeometryNodeReplaceMaterial",
    "GeometryNodeSetID",
    "GeometryNodeSetMaterial",
    "GeometryNodeSetMaterialIndex",
    "GeometryNodeSetMeshNormal",
    "GeometryNodeSetShadeSmooth",
    "GeometryNodeSplitEdges",
    "GeometryNodeStoreNamedAttribute",
    "GeometryNodeSwitch",
    "GeometryNodeTriangulate",
    "GeometryNodeViewer",
    "GeometryNodeWarning",
    "NodeGroupInput",
    "NodeReroute",
}
"""Geometry nodes that hand on the surface which they get. Shade Auto Smooth is made of nothing else."""


def is_added(obj: bpy.types.Object) -> bool:
    """Whether a modifier of `obj`, switched on for the viewport or for rendering, may give it detail.

    Cheap enough to be asked at every redraw: what the modifiers really do is not looked at.
    """
    return any(_adds(modifier) for modifier in obj.modifiers if modifier.show_viewport or modifier.show_render)


def without(obj: bpy.types.Object) -> str:
    """The modifiers of `obj` in a clause of a sentence that says that they add no detail."""
    return f"whose modifiers ({shorten_list(modifier.name for modifier in obj.modifiers)}) add no detail"


def _adds(modifier: bpy.types.Modifier) -> bool:
    if modifier.type == "NODES":
        return modifier.node_group is not None and any(map(_makes, _nodes(modifier.node_group, set())))
    return modifier.type in ADDING


def _makes(node: bpy.types.Node) -> bool:
    return node.bl_idname not in PASSING_ON and any(socket.type == "GEOMETRY" for socket in node.outputs)


def _nodes(tree: bpy.types.NodeTree, seen: set[bpy.types.NodeTree]) -> Iterator[bpy.types.Node]:
    """The nodes of `tree` and of the groups in it, but for the groups themselves."""
    seen.add(tree)
    for node in tree.nodes:
        if node.bl_idname != "GeometryNodeGroup":
            yield node
        elif node.node_tree is not None and node.node_tree not in seen:
            yield from _nodes(node.node_tree, seen)
