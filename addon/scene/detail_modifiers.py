# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds out whether modifiers add detail to an object's base mesh, so that the object can be its own high object."""

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
"""Modifier types that keep the base mesh in place and add detail to its surface.

Other types move or copy the mesh, cut its faces, or change only normals, UVs and groups. Baked onto the base mesh, they give a
flat map."""

PASS_THROUGH = {
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
"""Geometry nodes that do not change the surface. Shade Auto Smooth uses only these."""


def is_added(obj: bpy.types.Object) -> bool:
    """Whether a modifier of `obj`, enabled for the viewport or for rendering, may add detail.

    Fast enough for every redraw: it only reads types, and evaluates nothing.
    """
    return any(_adds(modifier) for modifier in obj.modifiers if modifier.show_viewport or modifier.show_render)


def without(obj: bpy.types.Object) -> str:
    """A clause for messages: the modifiers of `obj` add no detail."""
    return f"whose modifiers ({shorten_list(modifier.name for modifier in obj.modifiers)}) add no detail"


def _adds(modifier: bpy.types.Modifier) -> bool:
    if modifier.type == "NODES":
        return modifier.node_group is not None and any(map(_changes_surface, _nodes(modifier.node_group, set())))
    return modifier.type in ADDING


def _changes_surface(node: bpy.types.Node) -> bool:
    return node.bl_idname not in PASS_THROUGH and any(socket.type == "GEOMETRY" for socket in node.outputs)


def _nodes(tree: bpy.types.NodeTree, seen: set[bpy.types.NodeTree]) -> Iterator[bpy.types.Node]:
    """The nodes of `tree` and of the groups in it, without the group nodes themselves."""
    seen.add(tree)
    for node in tree.nodes:
        if node.bl_idname != "GeometryNodeGroup":
            yield node
        elif node.node_tree is not None and node.node_tree not in seen:
            yield from _nodes(node.node_tree, seen)
