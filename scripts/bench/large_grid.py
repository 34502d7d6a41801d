# SPDX-License-Identifier: GPL-3.0-or-later
"""Generates grids of any size in numpy and Blender's arrays. Needs nothing of Imprint, so any version can bake them."""

import bpy
import numpy as np


def build(name: str, across: int, up: int, height: float, waves: int = 4) -> bpy.types.Object:
    """A square from -1 to 1 of across x up quads, with waves of this height and UVs that fill 0..1, linked to the scene."""
    mesh = bpy.data.meshes.new(name)
    quads, points = across * up, (across + 1) * (up + 1)
    mesh.vertices.add(points)
    mesh.loops.add(4 * quads)
    mesh.polygons.add(quads)
    u, v = np.linspace(0.0, 1.0, across + 1, dtype=np.float32), np.linspace(0.0, 1.0, up + 1, dtype=np.float32)
    co = np.empty((up + 1, across + 1, 3), np.float32)
    co[..., 0], co[..., 1] = 2.0 * u - 1.0, 2.0 * v[:, None] - 1.0
    turn = np.float32(2.0 * np.pi * waves)
    np.multiply(np.float32(height) * np.sin(turn * v)[:, None], np.sin(turn * u), out=co[..., 2])
    mesh.attributes["position"].data.foreach_set("vector", co.reshape(-1))
    del co
    first = np.arange(across, dtype=np.int32) + (across + 1) * np.arange(up, dtype=np.int32)[:, None]
    corners = np.stack([first, first + 1, first + across + 2, first + across + 1], axis=-1)
    del first
    mesh.loops.foreach_set("vertex_index", corners.reshape(-1))
    mesh.polygons.foreach_set("loop_start", np.arange(0, 4 * quads, 4, dtype=np.int32))
    uv = np.stack(np.broadcast_arrays(u, v[:, None]), axis=-1).reshape(-1, 2)[corners.reshape(-1)]
    del corners
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uv.reshape(-1))
    del uv
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj
