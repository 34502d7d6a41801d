# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a mesh again of which only vertices have moved: Blender computes the normals of a small mesh around them.

Computing the normals of a whole mesh is most of the time of reading it. Those of a vertex follow from the faces around it, in
their order, so a mesh with only these faces has the same ones, to the bit.
"""

from dataclasses import replace

import bpy
import numpy as np

from ...mesh.triangle_mesh import Mesh, changed_rows
from .. import mesh_reader

MOST = 0.25
"""Share of the vertices. If more have moved, reading the whole mesh takes as long."""


def read(
    data: bpy.types.Mesh, uv_layer: str, known: Mesh, to_world: np.ndarray, *, with_faces: bool = False
) -> Mesh | None:
    """What mesh_reader.surface returns for `data`, if it differs from `known` at most in the positions of few vertices, and in
    the normals and triangles that follow from them; otherwise None. Arrays that are the same are those of `known`."""
    if not known.normals_domain or known.not_finite or mesh_reader.normals_domain(data) != known.normals_domain:
        return None
    if (len(data.vertices), len(data.loops)) != (len(known.positions), len(known.vertices)):
        return None
    positions = mesh_reader.points(data)
    moved = changed_rows(positions, known.positions)
    if len(moved) > MOST * len(positions):
        return None
    if (known.uv is not None) != bool(uv_layer) or (uv_layer and not _same(mesh_reader.uvs(data, uv_layer), known.uv)):
        return None
    triangles, starts = mesh_reader.triangles(data), known.starts
    if len(triangles) != len(known.triangles) or not _same(mesh_reader.corner_vertices(data), known.vertices):
        return None
    if _same(triangles, known.triangles):
        triangles = known.triangles
    else:
        starts, other = _face_starts(data), changed_rows(triangles, known.triangles)
        if not _are_in(known.triangles[other], mesh_reader.triangle_faces(data)[other], starts):
            return None
    starts = _face_starts(data) if starts is None else starts
    faces = mesh_reader.triangle_faces(data) if with_faces else None
    known = replace(known, triangles=triangles, to_world=to_world, starts=starts, faces=faces, labels=None)
    if not len(moved):
        return known
    corners, around = _normals_around(positions, known.vertices, starts, moved, known.normals_domain)
    if not (np.isfinite(around).all() and np.isfinite(positions[moved]).all()):
        return None
    normals = known.normals.copy()
    normals[corners] = around
    return replace(known, positions=positions, normals=normals)


def _face_starts(data: bpy.types.Mesh) -> np.ndarray:
    """The first corner of each face, and at the end the number of corners, (F + 1,) int32."""
    # Blender takes three times as long to list the faces themselves.
    sizes = np.bincount(mesh_reader.triangle_faces(data), minlength=len(data.polygons)) + 2
    starts = np.zeros(len(sizes) + 1, np.int32)
    np.cumsum(sizes, out=starts[1:])
    return starts


def _are_in(triangles: np.ndarray, faces: np.ndarray, starts: np.ndarray) -> bool:
    """Whether the corners of each of `triangles` (T, 3) belong to the face in `faces` (T,): then they divide these faces."""
    first, end = starts[faces], starts[faces + 1]
    return all(((corner >= first) & (corner < end)).all() for corner in triangles.T)


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two arrays are equal to the bit."""
    return np.array_equal(a.view(np.int32), b.view(np.int32))


def _normals_around(
    positions: np.ndarray, vertices: np.ndarray, starts: np.ndarray, moved: np.ndarray, domain: str
) -> tuple[np.ndarray, np.ndarray]:
    """The corners (N,) whose normals depend on the `moved` vertices, and their normals (N, 3) float32."""
    is_moved = np.zeros(len(positions), bool)
    is_moved[moved] = True
    touched = _faces_at(starts, np.flatnonzero(is_moved.take(vertices)))
    corners = _corners_of(starts, touched)
    if domain == "FACE":
        normals = _normals_of(positions, vertices[corners], _sizes(starts, touched), "polygon_normals")
        return corners, np.repeat(normals, _sizes(starts, touched), axis=0)
    depends = np.zeros(len(positions), bool)
    depends[vertices[corners]] = True
    corners = np.flatnonzero(depends.take(vertices))
    around = _faces_at(starts, corners)
    used, numbers = np.unique(vertices[_corners_of(starts, around)], return_inverse=True)
    normals = _normals_of(positions[used], numbers.astype(np.int32), _sizes(starts, around), "vertex_normals")
    return corners, normals[np.searchsorted(used, vertices[corners])]


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


def _faces_at(starts: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The faces of these corners, each once, in their order."""
    return np.unique(np.searchsorted(starts, corners, side="right") - 1)


def _corners_of(starts: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The corners of these faces, face after face."""
    sizes = _sizes(starts, faces)
    before = np.cumsum(sizes) - sizes
    return np.arange(sizes.sum()) + np.repeat(starts[faces] - before, sizes)


def _sizes(starts: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The number of corners of each of these faces."""
    return starts[faces + 1] - starts[faces]
