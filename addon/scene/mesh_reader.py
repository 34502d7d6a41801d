# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads Blender's meshes into arrays. Which elements belong together is in mesh_elements.

Of large meshes, each array is read from a copy of its own. A copy shares all arrays; Blender doubles an array when it is read,
and keeps the normals and triangles that it computes, until the copy is removed.
"""

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import bpy
import numpy as np

from ..core import foreach
from ..mesh.triangle_mesh import Mesh, finite_rows, keep_corners
from ..mesh.triangles import unit_normals, vertex_normals
from . import mesh_writer, steady_tangents

SHORTEST = 1e-18
"""The length below which a normal has no direction: shaders square it, and the square is no single-precision number."""
ROUNDING = 1e-6
"""How much vertex normals differ at most, as means of normals that are all the same."""
LARGE = 2**25
"""Face corners. Smaller meshes are read without copies: Blender then keeps their normals for the next bake."""

Copied = Callable[[], bpy.types.Mesh]
"""A function that adds a copy of a mesh to bpy.data."""


def copied(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Copied | None:
    """Copies the mesh of `obj` with its modifiers, as `depsgraph` evaluates it. None in modes that change it before that."""
    if obj.mode != "OBJECT":
        return None
    return lambda: bpy.data.meshes.new_from_object(obj.evaluated_get(depsgraph), depsgraph=depsgraph)


@contextmanager
def part_of_copy(data: bpy.types.Mesh, copied: Copied | None) -> Iterator[bpy.types.Mesh]:
    """A mesh to read one array of `data` from: a copy in this block if `data` is LARGE, otherwise `data`."""
    if copied is None or len(data.loops) < LARGE:
        yield data
        return
    copy = copied()
    try:
        yield copy
    finally:
        bpy.data.meshes.remove(copy)


_NUMBER = ".imprint_face"
"""The temporary attribute that `numbered` adds, with a number behind it if the mesh has one of this name; the dot hides it in
Blender's lists."""


@contextmanager
def evaluated(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Iterator[bpy.types.Mesh]:
    """The mesh of `obj` with its modifiers, as `depsgraph` evaluates it. It shares Blender's arrays, without a copy.

    In Sculpt Mode without modifiers, Blender moves the vertices of the object's own mesh and evaluates it later. Then the
    result is a copy of the object's own mesh.
    """
    owner = obj if is_sculpted_in_place(obj) else obj.evaluated_get(depsgraph)
    try:
        data = owner.to_mesh()
        if obj.mode == "SCULPT":
            reset_normals(data)
        yield data
    finally:
        owner.to_mesh_clear()


def is_sculpted_in_place(obj: bpy.types.Object) -> bool:
    """Whether strokes change the mesh of `obj` itself, before it is evaluated."""
    if obj.mode != "SCULPT":
        return False
    is_modified = obj.data.shape_keys is not None or any(modifier.show_viewport for modifier in obj.modifiers)
    return obj.use_dynamic_topology_sculpting or not is_modified


def reset_normals(data: bpy.types.Mesh) -> None:
    """Make Blender compute the normals of `data` again. Strokes and their undo do not update them."""
    if data.vertices:
        first = data.vertices[0]
        first.co = first.co  # Blender does not compare: setting one vertex is enough


def points(data: bpy.types.Mesh) -> np.ndarray:
    """The positions of the vertices, (V, 3) float32."""
    return foreach.vectors(data.attributes["position"].data)


def uvs(data: bpy.types.Mesh, uv_layer: str) -> np.ndarray:
    """The UVs by corner, (C, 2) float32."""
    return foreach.vectors(data.uv_layers[uv_layer].uv, "vector", 2)


def active_uv_layer(data: bpy.types.Mesh) -> str:
    """The name of the active UV layer of a mesh that has some. The first one if none is active: modifiers make such meshes."""
    return (data.uv_layers.active or data.uv_layers[0]).name


def is_rendered(obj: bpy.types.Object, uv_layer: str) -> bool:
    """Whether renders use this UV map of a mesh object where nothing names one."""
    return any(layer.name == uv_layer and layer.active_render for layer in obj.data.uv_layers)


def corner_normals(data: bpy.types.Mesh) -> np.ndarray:
    """The normals of the corners, (C, 3) float32."""
    return foreach.vectors(data.corner_normals)


def corner_vertices(data: bpy.types.Mesh) -> np.ndarray:
    """The vertex of each corner, (C,) int32."""
    return foreach.read(data.attributes[".corner_vert"].data, "value")


def normals_domain(data: bpy.types.Mesh) -> str:
    """As Mesh has it."""
    return "" if "custom_normal" in data.attributes else data.normals_domain


@contextmanager
def base(obj: bpy.types.Object) -> Iterator[bpy.types.Mesh]:
    """The mesh of `obj` without its modifiers."""
    yield obj.data


def surface(
    data: bpy.types.Mesh,
    uv_layer: str,
    name: str,
    to_world: np.ndarray,
    *,
    is_drawn_in_uv: bool = True,
    with_faces: bool = False,
    copied: Copied | None = None,
) -> Mesh:
    """Read positions, corner normals and triangles of `data`, UVs unless `uv_layer` is empty, and faces if `with_faces`.

    Triangles with NaN or infinite values are left out and counted. is_drawn_in_uv: whether this includes values of UVs, for a
    mesh that is drawn in UV space. copied: copies `data`, as the function `copied` returns it.
    """
    part = partial(part_of_copy, data, copied)
    with part() as one:
        normals = foreach.vectors(one.corner_normals)
    with part() as one:
        indices, faces = triangles(one), triangle_faces(one) if with_faces else None
    with part() as one:
        uv = uvs(one, uv_layer) if uv_layer else None
    with part() as one:
        vertices = corner_vertices(one)
    with part() as one:
        positions = points(one)
    domain = normals_domain(data)
    mesh = Mesh(name, positions, vertices, normals, indices, to_world, uv=uv, faces=faces, normals_domain=domain)
    finite = finite_rows(mesh.normals, mesh.uv) if is_drawn_in_uv and uv_layer else finite_rows(mesh.normals)
    positions = finite_rows(mesh.positions)
    if positions is not None:
        mesh.positions[~positions] = 0.0  # no triangle uses them, but NaN would change sums
        by_corner = positions[mesh.vertices]
        finite = by_corner if finite is None else finite & by_corner
    return _with_lengths(keep_corners(mesh, finite), data)


def _with_lengths(mesh: Mesh, data: bpy.types.Mesh) -> Mesh:
    """`mesh`, which was read from `data`, with smooth normals where its own have no length.

    Only free normals can be like that: Blender computes others."""
    own = data.attributes.get("custom_normal")
    if own is None or own.data_type != "FLOAT_VECTOR":
        return mesh
    normals, lacks = _filled(mesh.normals, mesh)
    return replace(mesh, normals=normals, without_normals=int(np.count_nonzero(lacks[mesh.triangles].any(axis=1))))


def _filled(normals: np.ndarray, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Normals by corner (C, 3) float32, where those without a length are smooth ones, and which corners (C,) lacked it. Where
    the faces around cancel out, they are those of the faces, and along z for faces without an area."""
    lacks = np.einsum("ij,ij->i", normals, normals) < SHORTEST**2
    if lacks.any():
        points, corners = mesh.positions.astype(np.float64), mesh.vertices[mesh.triangles]
        filled, of_faces = vertex_normals(points, corners)[mesh.vertices], np.zeros((len(normals), 3))
        of_faces[mesh.triangles] = unit_normals(points, corners, np.float64)[0][:, None]
        for others in (of_faces, np.array([[0.0, 0.0, 1.0]])):
            filled = np.where(filled.any(axis=1, keepdims=True), filled, others)
        normals = np.where(lacks[:, None], filled, normals).astype(np.float32)
    return normals, lacks


def smooth_normals(data: bpy.types.Mesh, mesh: Mesh) -> np.ndarray:
    """The vertex normals of `mesh`, which was read from `data`: (C, 3) float32, by corner. They ignore hard edges."""
    normals = foreach.vectors(data.vertex_normals)[mesh.vertices]
    if not mesh.normals_domain:
        normals = _without_rounding(normals, mesh)
    return _filled(normals, mesh)[0] if mesh.without_normals else normals


def _without_rounding(normals: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Vertex normals by corner (C, 3), of which those are the corners' own that differ from them by rounding alone: of custom
    normals, Blender gives the mean, also of equal ones."""
    own = np.empty_like(mesh.positions)
    own[mesh.vertices] = mesh.normals
    own = own[mesh.vertices]
    is_other = (own != mesh.normals).any(axis=1) | (np.abs(own - normals) > ROUNDING).any(axis=1)
    is_mean = np.zeros(len(mesh.positions), bool)
    is_mean[mesh.vertices[is_other]] = True
    return np.where(is_mean[mesh.vertices][:, None], normals, own)


def with_tangents(
    data: bpy.types.Mesh, uv_layer: str, name: str, to_world: np.ndarray, mesh: Mesh | None = None
) -> Mesh:
    """Read `data` as `surface` does, with MikkTSpace tangents for `uv_layer`, labeled with material slots (T, 1).

    mesh: what `surface` has read of it, with faces; None if it has not.

    Blender's calc_tangents takes only triangles and quads, so a mesh with n-gons is first triangulated as Blender draws it;
    then the corners are those of the triangles.
    """
    if _max_face_size(data) > 4:
        with _triangulated(data, uv_layer) as triangles_only:
            return with_tangents(triangles_only, uv_layer, name, to_world)
    mesh = mesh or surface(data, uv_layer, name, to_world, with_faces=True)
    if mesh.without_normals:
        with _triangulated(data, uv_layer, mesh.normals) as mended:
            mended_mesh = with_tangents(mended, uv_layer, name, to_world)
        return replace(mended_mesh, without_normals=mesh.without_normals)
    indices = face_values(data, "material_index")
    mesh = replace(mesh, labels=indices[mesh.faces][:, None].astype(np.float32))
    data.calc_tangents(uvmap=uv_layer)
    tangents = np.empty((len(data.loops), 4), np.float32)
    tangents[:, :3] = foreach.vectors(data.loops, "tangent", 3)
    tangents[:, 3:] = foreach.vectors(data.loops, "bitangent_sign", 1)
    if len(data.polygons) > steady_tangents.PARALLEL:
        tangents = steady_tangents.steady(
            tangents,
            positions=mesh.positions[mesh.vertices],
            normals=mesh.normals,
            uv=mesh.uv,
            starts=face_values(data, "loop_start"),
            sizes=face_values(data, "loop_total"),
        )
    return keep_corners(replace(mesh, tangents=tangents), finite_rows(tangents))


def matrix(obj: bpy.types.Object) -> np.ndarray:
    """The (4, 4) float64 matrix from `obj`'s space to the world's. That of an evaluated object is up to date."""
    return np.array(obj.matrix_world, dtype=np.float64)


def count_triangles(data: bpy.types.Mesh) -> int:
    """How many triangles the faces have."""
    return len(data.loops) - 2 * len(data.polygons)


def triangles(data: bpy.types.Mesh) -> np.ndarray:
    """The corners of the triangles of `data`, (T, 3) int32, as Blender draws its faces."""
    corners = len(data.loops)
    data.calc_loop_triangles()
    count = len(data.loop_triangles)
    if count * 3 == corners:  # all faces are triangles
        return np.arange(corners, dtype=np.int32).reshape(-1, 3)
    indices = np.empty((count, 3), np.int32)
    if not _copy_triangles(data.loop_triangles, indices):
        data.loop_triangles.foreach_get("loops", indices.reshape(-1))
    return indices


def triangle_faces(data: bpy.types.Mesh) -> np.ndarray:
    """The face of each of the `triangles` of `data`, (T,) int32."""
    return foreach.read(data.loop_triangle_polygons, "value")


def face_values(data: bpy.types.Mesh, attribute: str) -> np.ndarray:
    """Whole numbers of the faces, (F,) int32."""
    return foreach.read(data.polygons, attribute)


def material_slots(data: bpy.types.Mesh, mesh: Mesh, count: int) -> np.ndarray:
    """The material slot of each triangle, (T,) int32, of an object with `count` slots.

    mesh: the result of `surface` for `data`, with faces.
    """
    indices = face_values(data, "material_index")
    # A face whose index is too high shows the last slot.
    return indices.clip(0, count - 1)[mesh.faces]


@contextmanager
def numbered(obj: bpy.types.Object, domain: str = "FACE") -> Iterator[str]:
    """Number the faces of `obj`'s own mesh, or its edges for the domain "EDGE", in an attribute that modifiers copy.

    Gives the attribute's name, by which `numbers` reads it from the evaluated mesh. It is removed at the end of the block.
    """
    data = obj.data
    count = len(data.polygons if domain == "FACE" else data.edges)
    active = data.attributes.active_index
    layer = data.attributes.new(_NUMBER, "INT", domain)
    name = layer.name
    try:
        layer.data.foreach_set("value", np.arange(1, count + 1))
        data.update_tag()
        yield name
    finally:
        data.attributes.remove(data.attributes[name])
        data.attributes.active_index = active
        data.update_tag()


def numbers(data: bpy.types.Mesh, name: str, domain: str = "FACE") -> np.ndarray | None:
    """The original face or edge of each face or edge of the evaluated mesh `data` of a `numbered` object.

    (N,) int32, with -1 for none. name: as `numbered` gives it.

    Returns None if modifiers have removed the attribute.
    """
    layer = data.attributes.get(name)
    if layer is None or layer.domain != domain:
        return None
    return foreach.read(layer.data, "value") - 1


def memory_of(collection: bpy.types.bpy_prop_collection, width: int) -> np.ndarray | None:
    """Blender's own memory of a collection with `width` values of four bytes an element, as (N, width) int32. It is not to be
    written to, or kept: it may go with the next call of Blender.

    Blender says where an element is, not how elements are stored. None unless those from the first to the last fill the
    memory between both, so that nothing beside them is read; also None for a single one, which shows no distance.
    """
    count = len(collection)
    if count < 2:
        return None
    first, last = collection[0].as_pointer(), collection[-1].as_pointer()
    if last - first != 4 * width * (count - 1):
        return None
    return np.frombuffer((ctypes.c_int32 * (count * width)).from_address(first), np.int32).reshape(count, width)


def _copy_triangles(source: bpy.types.bpy_prop_collection, triangles: np.ndarray) -> bool:
    """Copy loop triangles from memory. foreach_get calls a function for each triangle, which is 80 times slower.

    Compares the values of some triangles first; if they differ, copies nothing and returns False.
    """
    memory = memory_of(source, 3)
    if memory is None or any(tuple(memory[i]) != tuple(source[i].loops) for i in (0, len(source) // 2, -1)):
        return False
    np.copyto(triangles, memory)
    return True


def _max_face_size(data: bpy.types.Mesh) -> int:
    if len(data.loops) <= 3 * len(data.polygons):
        return 3
    return int(face_values(data, "loop_total").max())


@contextmanager
def _triangulated(data: bpy.types.Mesh, uv_layer: str, normals: np.ndarray | None = None) -> Iterator[bpy.types.Mesh]:
    """A temporary triangulated copy of `data` with these corner normals (C, 3) or the same ones, and only this UV layer."""
    corners = triangles(data).reshape(-1)
    normals = (corner_normals(data) if normals is None else normals)[corners]
    uv = uvs(data, uv_layer)[corners]
    with of_triangles(points(data), corner_vertices(data)[corners], normals, uv, uv_layer) as copy:
        copy.polygons.foreach_set("material_index", face_values(data, "material_index")[triangle_faces(data)])
        yield copy


@contextmanager
def of_triangles(
    positions: np.ndarray, corners: np.ndarray, normals: np.ndarray, uv: np.ndarray, uv_layer: str
) -> Iterator[bpy.types.Mesh]:
    """A temporary mesh of triangles with a UV layer.

    positions: (V, 3). corners: (C,), the vertices of the corners. normals: of corners (C, 3). uv: (C, 2).
    """
    data = bpy.data.meshes.new("Imprint triangles")
    try:
        mesh_writer.fill(data, positions, corners)
        data.update(calc_edges=True)
        data.uv_layers.new(name=uv_layer).uv.foreach_set("vector", np.ascontiguousarray(uv, np.float32).reshape(-1))
        # Blender uses normals in plain vectors unchanged; normals_split_custom_set would round them.
        values = np.ascontiguousarray(normals, np.float32).reshape(-1)
        data.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER").data.foreach_set("vector", values)
        yield data
    finally:
        bpy.data.meshes.remove(data)
