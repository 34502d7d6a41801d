# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of which only vertices have moved are read as whole meshes are, to the bit."""

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.mesh.triangle_mesh import ATTRIBUTE
from addon.scene import mesh_reader
from addon.scene.high_reader import _holds, read_moved
from tests.support import zoo

FIELDS = ("positions", "vertices", "normals", "triangles", "to_world", "uv")


def whole(obj):
    return mesh_reader.surface(obj.data, zoo.LAYER, obj.name, mesh_reader.matrix(obj))


def again(obj, known):
    return read_moved(obj.data, zoo.LAYER, known, mesh_reader.matrix(obj))


def move(obj, seed, share=0.1):
    """Move the vertices of a part of a mesh by random amounts."""
    rng = np.random.default_rng(seed)
    points = mesh_reader.points(obj.data)
    center = points[rng.integers(len(points))]
    near = np.argsort(np.linalg.norm(points - center, axis=1))[: max(1, int(share * len(points)))]
    points[near] += (rng.normal(0, 1, (len(near), 3)) * (0.002, 0.002, 0.02)).astype(np.float32)  # folds no quad
    obj.data.attributes["position"].data.foreach_set("vector", points.ravel())
    obj.data.update()


def mixed(seed):
    """A mesh of triangles, quads and pentagons: a grid of which some edges were dissolved, and some faces cut."""
    obj = zoo.terrain("mixed", n=20)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.select_random(ratio=0.3, seed=seed)
    bpy.ops.mesh.quads_convert_to_tris()
    bpy.ops.mesh.select_random(ratio=0.2, seed=seed + 1)
    bpy.ops.mesh.dissolve_faces()
    bpy.ops.object.mode_set(mode="OBJECT")
    return obj


def equal(a, b):
    return all(np.array_equal(getattr(a, field), getattr(b, field)) for field in FIELDS)


MESHES = {
    "quads": lambda: zoo.terrain("hi", n=24),
    "flat": lambda: zoo.terrain("hi", n=24, smooth=False),
    "sphere": lambda: zoo.build("hi", *_ball()),
    "mixed": lambda: mixed(3),
}


def _ball():
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=16)
    made = bpy.context.object.data
    made.calc_loop_triangles()
    points = mesh_reader.points(made)
    faces = mesh_reader.corner_vertices(made)[mesh_reader.triangles(made)]
    return points, faces, points[faces][..., :2]


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", MESHES)
def test_moved_vertices_are_read_as_the_whole_mesh(name, seed):
    obj = MESHES[name]()
    known = whole(obj)
    for stroke in range(3):
        move(obj, 10 * seed + stroke)
        found = again(obj, known)
        assert found is not None
        assert not np.array_equal(found.normals, known.normals)
        for field in ("vertices", "triangles", "uv"):
            is_kept = getattr(found, field) is getattr(known, field)
            assert is_kept or not np.array_equal(getattr(found, field), getattr(known, field))
        assert equal(found, whole(obj))
        known = found


def test_a_moved_object_keeps_its_arrays():
    obj = zoo.terrain("hi", n=8)
    known = whole(obj)
    obj.location.x = 2.0
    bpy.context.view_layer.update()
    found = again(obj, known)
    assert found.normals is known.normals
    assert equal(found, whole(obj))


def test_labels_and_layers_of_the_earlier_reading_are_not_kept():
    obj = zoo.terrain("hi", n=8)
    known = whole(obj)
    layers = {(ATTRIBUTE, "paint"): np.zeros((len(obj.data.loops), 4), np.float32)}
    known = replace(known, layers=layers, labels=np.zeros((len(known.triangles), 2), np.float32))
    move(obj, 5)
    found = again(obj, known)
    assert (found.layers, found.labels) == ({}, None)


def _change_uv(obj):
    obj.data.uv_layers[0].uv[5].vector.x += 0.01


def _shade_flat(obj):
    obj.data.shade_flat()


def _mark_sharp(obj):
    obj.data.attributes.new("sharp_edge", "BOOLEAN", "EDGE").data[3].value = True


def _set_normals(obj):
    obj.data.normals_split_custom_set_from_vertices([(0.0, 0.6, 0.8)] * len(obj.data.vertices))


def _turn_faces(obj):
    obj.data.flip_normals()


def _make_nan(obj):
    obj.data.vertices[7].co.x = float("nan")


def _add_a_face(obj):
    import bmesh

    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    mesh.faces.new([mesh.verts.new(place) for place in ((5, 0, 0), (6, 0, 0), (5, 1, 0))])
    mesh.to_mesh(obj.data)
    mesh.free()


def _move_all(obj):
    move(obj, 5, share=1.0)


def _move_a_third(obj):
    move(obj, 5, share=0.33)


def _swap_vertices(obj):
    corners = mesh_reader.corner_vertices(obj.data)
    obj.data.loops.foreach_set("vertex_index", np.array([1, 0, *range(2, len(obj.data.vertices))], np.int32)[corners])


@pytest.mark.parametrize(
    "change",
    [
        _change_uv,
        _shade_flat,
        _mark_sharp,
        _set_normals,
        _turn_faces,
        _make_nan,
        _add_a_face,
        _move_all,
        _move_a_third,
        _swap_vertices,
    ],
)
def test_other_changes_are_read_from_the_whole_mesh(change):
    obj = zoo.terrain("hi", n=12)
    known = whole(obj)
    move(obj, 4)
    assert again(obj, known) is not None
    change(obj)
    obj.data.update()
    assert again(obj, known) is None


def test_a_folded_quad_is_divided_along_its_other_diagonal():
    obj = zoo.plane("hi", n=8)
    known = whole(obj)
    folded = obj.data.vertices[obj.data.polygons[20].vertices[1]]
    folded.co.x -= 0.2
    folded.co.y += 0.2
    obj.data.update()
    found = again(obj, known)
    assert not np.array_equal(found.triangles, known.triangles)
    assert equal(found, whole(obj))


def test_faces_that_were_divided_are_read_from_the_whole_mesh():
    """A quad and two triangles have as many corners and triangles as two triangles and a quad."""
    corners = [0, 1, 2, 3, 3, 2, 4, 3, 4, 5]
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 2, 0), (0, 2, 0)]
    found = []
    for starts in ([0, 4, 7], [0, 3, 6]):
        data = bpy.data.meshes.new("hi")
        data.vertices.add(len(points))
        data.attributes["position"].data.foreach_set("vector", np.array(points, np.float32).ravel())
        data.loops.add(len(corners))
        data.loops.foreach_set("vertex_index", corners)
        data.polygons.add(3)
        data.polygons.foreach_set("loop_start", starts)
        data.uv_layers.new(name=zoo.LAYER, do_init=False)  # the same for both: initial ones follow from the faces
        data.update(calc_edges=True)
        data.shade_smooth()
        found.append(bpy.data.objects.new("hi", data))
    known = whole(found[0])
    assert again(found[0], known) is not None
    assert np.array_equal(whole(found[1]).uv, known.uv)
    assert again(found[1], known) is None


def test_a_mesh_with_nan_is_read_whole_when_it_is_mended():
    obj = zoo.terrain("hi", n=12)
    before = obj.data.vertices[7].co.copy()
    _make_nan(obj)
    obj.data.update()
    known = whole(obj)
    obj.data.vertices[7].co = before
    obj.data.update()
    assert again(obj, known) is None


@pytest.mark.parametrize(("then", "now"), [(zoo.LAYER, ""), ("", zoo.LAYER)])
def test_a_mesh_read_with_uvs_is_not_one_without_them(then, now):
    obj = zoo.terrain("hi", n=12)
    known = mesh_reader.surface(obj.data, then, obj.name, mesh_reader.matrix(obj))
    assert read_moved(obj.data, then, known, mesh_reader.matrix(obj)) is not None
    assert read_moved(obj.data, now, known, mesh_reader.matrix(obj)) is None


@pytest.mark.parametrize(("step", "number", "reads"), [(1, 4, 0), (2, 4, 1), (1, 1, 1)])
def test_memory_is_compared_only_where_values_lie_one_after_the_other(step, number, reads):
    """A single value shows no distance to the next one."""
    values = np.arange(8, dtype=np.int32)
    collection = [element(values.ctypes.data + 4 * step * each) for each in range(number)]
    done = []
    known = values[::step][:number].copy()
    assert _holds(collection, known, lambda: done.append(1) or known)
    assert len(done) == reads


@pytest.mark.parametrize(("step", "shift", "is_copied"), [(3, 0, True), (4, 0, False), (3, 1, False)])
def test_triangles_are_copied_from_memory_only_where_it_holds_them(step, shift, is_copied):
    """step: values from one triangle to the next. shift: what Blender says that they are, minus what the memory holds."""
    values = np.arange(64, dtype=np.int32)
    starts = range(0, 5 * step, step)
    source = [element(values.ctypes.data + 4 * start, values[start : start + 3] + shift) for start in starts]
    found = np.full((5, 3), -1, np.int32)
    assert mesh_reader._copy_triangles(source, found) == is_copied
    assert (found == (values[:15].reshape(5, 3) if is_copied else -1)).all()


def element(pointer, loops=()):
    """An element of one of Blender's collections, at an address."""
    return SimpleNamespace(as_pointer=lambda: pointer, loops=loops)


def test_meshes_that_had_other_normals_are_read_whole():
    obj = zoo.terrain("hi", n=12)
    _set_normals(obj)
    obj.data.update()
    known = whole(obj)
    obj.data.attributes.remove(obj.data.attributes["custom_normal"])
    obj.data.update()
    assert again(obj, known) is None
    assert again(obj, whole(obj)) is not None


def test_reading_moved_vertices_leaves_no_mesh_in_the_file():
    obj = zoo.terrain("hi", n=12)
    known = whole(obj)
    before = {*bpy.data.meshes.keys()}
    move(obj, 6)
    assert again(obj, known) is not None
    assert {*bpy.data.meshes.keys()} == before
