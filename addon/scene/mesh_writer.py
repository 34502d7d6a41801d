# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes arrays into Blender's meshes."""

import bpy
import numpy as np


def fill(mesh: bpy.types.Mesh, points: np.ndarray, corners: np.ndarray, starts: np.ndarray | None = None) -> None:
    """Give an empty mesh vertices and faces. It has no edges until `mesh.update(calc_edges=True)`.

    Args:
        mesh: without vertices.
        points: (V, 3) float.
        corners: (T, 3) int, the vertices of triangles; with `starts` those of the corners of all faces, (C,).
        starts: (F,) int, the first corner of each face.
    """
    count = corners.size
    if starts is None:
        starts = np.arange(0, count, 3)
    mesh.vertices.add(len(points))
    mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(points, np.float32).reshape(-1))
    mesh.loops.add(count)
    # The attribute takes a fortieth of the time of loops.foreach_set: 0.5 s less for 3 million corners.
    corner_vertices = mesh.attributes[".corner_vert"].data
    corner_vertices.foreach_set("value", np.ascontiguousarray(corners, np.int32).reshape(-1))
    mesh.polygons.add(len(starts))
    mesh.polygons.foreach_set("loop_start", np.ascontiguousarray(starts, np.int32))
