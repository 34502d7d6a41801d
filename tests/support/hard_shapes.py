# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with hard edges, unwrapped: a cube, a gear and a crate."""

import bmesh
import bpy
import numpy as np

from tests.support import scenes, zoo

TEETH = 12
BORE = 48
"""The sides of a gear's bore, which is shaded smooth."""


def unwrapped(obj) -> bpy.types.Object:
    """`obj` with the islands of Smart UV Project."""
    if not obj.data.uv_layers:
        obj.data.uv_layers.new(name=zoo.LAYER)
    scenes.select(obj)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=1.0, island_margin=0.02)
    bpy.ops.object.mode_set(mode="OBJECT")
    return obj


def cube(name="cube") -> bpy.types.Object:
    """The cube -1..1."""
    return unwrapped(zoo.cube(name))


def gear(name="gear") -> bpy.types.Object:
    """A gear of radius 1, with convex and concave edges, and a smooth bore."""
    angles = (np.arange(TEETH)[:, None] + np.array([-0.28, -0.18, 0.18, 0.28])).reshape(-1) * 2 * np.pi / TEETH
    radii = np.tile([0.75, 1.0, 1.0, 0.75], TEETH)
    around = np.arange(BORE) * 2 * np.pi / BORE
    rings = [(radii, angles), (np.full(BORE, 0.35), around)]
    points, faces, smooth = [], [], []
    for z in (-0.2, 0.2):
        for radius, angle in rings:
            points.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)], axis=1))
    rim, total = len(angles), len(angles) + BORE
    for count, first, turn in ((rim, 0, 1), (BORE, rim, -1)):
        number = first + np.arange(count)
        following = first + (np.arange(count) + 1) % count
        sides = np.stack([number, following, following + total, number + total], axis=1)[:, ::turn]
        faces += sides.tolist()
        smooth += [turn < 0] * count
    # Both have as many points, so that quads fill the space between them.
    number, following = np.arange(rim), (np.arange(rim) + 1) % rim
    top = np.stack([number, following, following + rim, number + rim], axis=1)
    faces += (top[:, ::-1]).tolist() + (top + total).tolist()
    smooth += [False] * (2 * rim)
    obj = zoo.build(name, np.concatenate(points), faces)
    obj.data.polygons.foreach_set("use_smooth", smooth)
    edges = obj.data.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    faces_of = {}
    for polygon in obj.data.polygons:
        for key in polygon.edge_keys:
            faces_of.setdefault(key, []).append(polygon.use_smooth)
    edges.data.foreach_set("value", [not all(faces_of[edge.key]) for edge in obj.data.edges])
    return unwrapped(obj)


def crate(name="crate") -> bpy.types.Object:
    """A box with a sunken panel in each side."""
    obj = zoo.cube(name)
    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    bmesh.ops.inset_individual(mesh, faces=mesh.faces[:], thickness=0.35)
    for face in sorted(mesh.faces, key=lambda face: -face.calc_area())[:6]:
        normal = face.normal.copy()
        moved = bmesh.ops.extrude_discrete_faces(mesh, faces=[face])["faces"]
        bmesh.ops.translate(mesh, verts=moved[0].verts, vec=-0.1 * normal)
    mesh.to_mesh(obj.data)
    mesh.free()
    return unwrapped(obj)
