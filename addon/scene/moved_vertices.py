# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a mesh again of which only vertices have moved: Blender computes the normals of a small mesh around them.

Computing the normals of a whole mesh is most of the time of reading it. Those of a vertex follow from the faces around it, in
their order, so a mesh with only these faces has the same ones, to the bit.
"""

from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np

from ..mesh.triangle_mesh import FaceCorners, Mesh, changed_rows, changed_share
from . import mesh_reader

MOST = 0.25
"""Share of the vertices. If more have moved, reading the whole mesh takes as long."""


def read(
    data: bpy.types.Mesh, uv_layer: str, known: Mesh, to_world: np.ndarray, *, with_faces: bool = False
) -> Mesh | None:
    """What mesh_reader.surface returns for `data`, if it differs from `known` at most in the positions of few vertices, and in
    the normals and triangles that follow from them; otherwise None. Arrays that are the same are those of `known`, but labels
    and layers are left out: they follow from materials, which may have changed."""
    if not known.normals_domain or known.not_finite or mesh_reader.normals_domain(data) != known.normals_domain:
        return None
    if (len(data.vertices), len(data.loops)) != (len(known.positions), len(known.vertices)):
        return None
    positions = mesh_reader.points(data)
    if changed_share(positions, known.positions) > 2.0 * MOST:
        return None
    moved = changed_rows(positions, known.positions)
    if len(moved) > MOST * len(positions) or (known.uv is not None) != bool(uv_layer):
        return None
    if uv_layer and not _holds(data.uv_layers[uv_layer].uv, known.uv, lambda: mesh_reader.uvs(data, uv_layer)):
        return None
    corners = data.attributes[".corner_vert"].data
    if not _holds(corners, known.vertices, lambda: mesh_reader.corner_vertices(data)):
        return None
    known = _with_triangles(data, known)
    if known is None:
        return None
    faces = mesh_reader.triangle_faces(data) if with_faces else None
    known = replace(known, to_world=to_world, faces=faces, labels=None, layers={})
    if not len(moved):
        return known
    corners, around = _normals_around(positions, known.face_corners, moved, known.normals_domain)
    if not (np.isfinite(around).all() and np.isfinite(positions[moved]).all()):
        return None
    normals = known.normals.copy()
    normals[corners] = around
    return replace(known, positions=positions, normals=normals)


def _with_triangles(data: bpy.types.Mesh, known: Mesh) -> Mesh | None:
    """`known` with the triangles of `data`, which has the same corners, and with its face_corners. None for other faces."""
    data.calc_loop_triangles()
    if len(data.loop_triangles) != len(known.triangles):
        return None
    is_same = _holds(data.loop_triangles, known.triangles, lambda: mesh_reader.triangles(data))
    if is_same and known.face_corners is not None:
        return known
    faces = mesh_reader.triangle_faces(data)
    # Blender takes three times as long to list the faces themselves.
    starts = np.zeros(len(data.polygons) + 1, np.int32)
    np.cumsum(np.bincount(faces, minlength=len(data.polygons)) + 2, out=starts[1:])
    found = FaceCorners(starts, known.vertices)
    if is_same:
        return replace(known, face_corners=found)
    triangles = mesh_reader.triangles(data)
    other = changed_rows(triangles, known.triangles)
    if not _are_in(known.triangles[other], faces[other], starts):
        return None
    return replace(known, triangles=triangles, face_corners=known.face_corners or found)


def _are_in(triangles: np.ndarray, faces: np.ndarray, starts: np.ndarray) -> bool:
    """Whether the corners of each of `triangles` (T, 3) belong to the face in `faces` (T,): then they divide these faces."""
    first, end = starts[faces], starts[faces + 1]
    return all(((corner >= first) & (corner < end)).all() for corner in triangles.T)


def _holds(collection: bpy.types.bpy_prop_collection, known: np.ndarray, read: Callable[[], np.ndarray]) -> bool:
    """Whether a collection of Blender has the values `known`, to the bit. read: reads it.

    Compares Blender's memory itself if the elements lie one after the other: copying it takes longer.
    """
    memory = mesh_reader.memory_of(collection, known.size // max(1, len(collection)))
    if memory is not None:
        return np.array_equal(memory.reshape(-1), known.reshape(-1).view(np.int32))
    return np.array_equal(read(), known)


def _normals_around(
    positions: np.ndarray, faces: FaceCorners, moved: np.ndarray, domain: str
) -> tuple[np.ndarray, np.ndarray]:
    """The corners (N,) whose normals depend on the `moved` vertices, and their normals (N, 3) float32."""
    touched = faces.faces_of(faces.corners_at(moved, len(positions)))
    corners = faces.corners_of(touched)
    if domain == "FACE":
        normals = _normals_of(positions, faces.vertices[corners], faces.sizes(touched), "polygon_normals")
        return corners, np.repeat(normals, faces.sizes(touched), axis=0)
    corners = faces.corners_at(np.unique(faces.vertices[corners]), len(positions))
    around = faces.faces_of(corners)
    used, numbers = np.unique(faces.vertices[faces.corners_of(around)], return_inverse=True)
    normals = _normals_of(positions[used], numbers.astype(np.int32), faces.sizes(around), "vertex_normals")
    return corners, normals[np.searchsorted(used, faces.vertices[corners])]


def _normals_of(positions: np.ndarray, vertices: np.ndarray, sizes: np.ndarray, kind: str) -> np.ndarray:
    """The "vertex_normals" or "polygon_normals" (N, 3) float32 of faces with these sizes and vertices by corner."""
    # Outside of bpy.data: a new mesh in the open file would make Blender look at the whole scene again.
    with bpy.data.temp_data() as temporary:
        data = temporary.meshes.new("Imprint vertices")
        data.vertices.add(len(positions))
        data.attributes["position"].data.foreach_set("vector", positions.reshape(-1))
        data.loops.add(len(vertices))
        data.loops.foreach_set("vertex_index", vertices)
        data.polygons.add(len(sizes))
        data.polygons.foreach_set("loop_start", (np.cumsum(sizes) - sizes).astype(np.int32))
        found = getattr(data, kind)
        normals = np.empty((len(found), 3), np.float32)
        found.foreach_get("vector", normals.reshape(-1))
    return normals
