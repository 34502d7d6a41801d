# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes hard edges of a mesh smooth."""

import bpy
import numpy as np

from ...mesh import uv_islands
from ...scene import mesh_reader
from ...scene.elements import mesh_elements


def soften(data: bpy.types.Mesh, soft: np.ndarray, hard: np.ndarray) -> int:
    """Make the edges `soft` (N,) int smooth, and keep the other ones in `hard` (M,) int hard. Returns how many are soft.

    Custom normals stay on all other corners; where edges become smooth, they are the mean of both sides.
    """
    is_sharp = np.zeros(len(data.edges), bool)
    is_sharp[hard] = True
    is_sharp[soft] = False
    custom = _merged(data, is_sharp) if "custom_normal" in data.attributes else None
    data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
    data.edges.foreach_set("use_edge_sharp", is_sharp)
    if custom is not None:
        _store(data, custom)
    return len(soft)


def _store(data: bpy.types.Mesh, normals: np.ndarray) -> None:
    """Replace the custom normals of `data`, in the way they are stored. normals: (C, 3) float32."""
    layer = data.attributes["custom_normal"]
    if (layer.data_type, layer.domain) == ("FLOAT_VECTOR", "CORNER"):
        layer.data.foreach_set("vector", normals.reshape(-1))
        return
    data.attributes.remove(layer)
    data.normals_split_custom_set(normals)


def _merged(data: bpy.types.Mesh, is_sharp: np.ndarray) -> np.ndarray:
    """The corner normals (C, 3) float32 with one normal for all corners of a vertex between which no edge is sharp."""
    corners = len(data.loops)
    vertex, edge = mesh_reader.corner_vertices(data), mesh_elements.corner_edges(data)
    following = mesh_elements.next_corners(data)
    order = np.argsort(edge, kind="stable")
    same = (edge[order][1:] == edge[order][:-1]) & ~is_sharp[edge[order][1:]]
    first, second = order[:-1][same], order[1:][same]
    is_same_way = vertex[first] == vertex[second]
    other, after = np.where(is_same_way, second, following[second]), np.where(is_same_way, following[second], second)
    groups = np.concatenate([np.stack([first, other], axis=1), np.stack([following[first], after], axis=1)])
    root = uv_islands.connected_components(groups, corners) if len(groups) else np.arange(corners)
    normals = np.empty((corners, 3), np.float32)
    data.corner_normals.foreach_get("vector", normals.reshape(-1))
    sums = np.stack([np.bincount(root, axis, corners) for axis in normals.T], axis=1)[root]
    return (sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)).astype(np.float32)
