# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of attributes, UV layers and tangents by face corner. test_high_materials.py compares values with Cycles."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.scene import mesh_reader, reading, steady_tangents
from addon.scene.mesh_elements import attribute_by_corner, tangents_by_corner, uv_by_corner
from addon.scene.textures import srgb_to_linear
from tests.support import zoo

CORNERS = [0, 1, 2, 3, 3, 2, 4]
"""The vertices of the corners of `two_faces`."""
FACES = [(0, 1, 2, 3), (3, 2, 4)]


@pytest.fixture
def two_faces():
    data = bpy.data.meshes.new("two")
    data.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0)], [], FACES)
    return data


def add(data, kind, domain, values, name="own"):
    attribute = data.attributes.new(name, kind, domain)
    width, field = {"FLOAT2": (2, "vector"), "FLOAT_VECTOR": (3, "vector"), "FLOAT_COLOR": (4, "color")}.get(
        kind, {"BYTE_COLOR": (4, "color_srgb"), "QUATERNION": (4, "value")}.get(kind, (1, "value"))
    )
    assert len(attribute.data) * width == np.size(values)
    attribute.data.foreach_set(field, np.ravel(values))


def test_domains(two_faces):
    add(two_faces, "FLOAT", "POINT", np.arange(5, dtype="f4"), "point")
    add(two_faces, "FLOAT", "FACE", np.array([10, 20], "f4"), "face")
    add(two_faces, "FLOAT", "CORNER", np.arange(7, dtype="f4"), "corner")
    assert attribute_by_corner(two_faces, "point")[:, 0].tolist() == CORNERS
    assert attribute_by_corner(two_faces, "face")[:, 0].tolist() == [10] * 4 + [20] * 3
    assert attribute_by_corner(two_faces, "corner")[:, 0].tolist() == list(range(7))


def test_a_corner_has_the_mean_of_its_two_edges(two_faces):
    """Each edge has the sum of its vertices, so that the expected values follow from the faces."""
    sums = [float(sum(edge.vertices)) for edge in two_faces.edges]
    add(two_faces, "FLOAT", "EDGE", np.array(sums, "f4"))
    expected = []
    for face in FACES:
        for place, vertex in enumerate(face):
            after, before = face[(place + 1) % len(face)], face[place - 1]
            expected.append((vertex + after + vertex + before) / 2)
    assert attribute_by_corner(two_faces, "own")[:, 0].tolist() == expected


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("FLOAT", [[0.5]], (0.5, 0.5, 0.5, 1)),
        ("INT", [[-7]], (-7, -7, -7, 1)),
        ("INT8", [[5]], (5, 5, 5, 1)),
        ("BOOLEAN", [[True]], (1, 1, 1, 1)),
        ("FLOAT2", [[1, 2]], (1, 2, 0, 1)),
        ("FLOAT_VECTOR", [[1, 2, 3]], (1, 2, 3, 1)),
        ("FLOAT_COLOR", [[0.1, 0.2, 0.3, 0.4]], (0.1, 0.2, 0.3, 0.4)),
        ("QUATERNION", [[0.1, 0.2, 0.3, 0.4]], (0.1, 0.2, 0.3, 0.4)),
        ("BYTE_COLOR", [[0.2, 0.6, 1.0, 0.4]], (*srgb_to_linear(np.array([0.2, 0.6, 1.0])), 0.4)),
    ],
)
def test_types(two_faces, kind, values, expected):
    dtype = {"INT": np.int32, "INT8": np.int32, "BOOLEAN": bool}.get(kind, np.float32)
    add(two_faces, kind, "POINT", np.tile(np.array(values, dtype), (5, 1)))
    found = attribute_by_corner(two_faces, "own")
    assert (found.shape, found.dtype) == ((7, 4), np.float32)
    assert found[3] == pytest.approx(expected, abs=1e-6)


def test_no_name_is_the_rendered_color_attribute(two_faces):
    assert attribute_by_corner(two_faces, "") is None
    for name, value in (("first", 0.25), ("second", 0.75)):
        two_faces.color_attributes.new(name, "FLOAT_COLOR", "POINT").data.foreach_set("color", np.full(20, value, "f4"))
    two_faces.color_attributes.active_color_index = 0
    two_faces.color_attributes.render_color_index = 1
    assert (attribute_by_corner(two_faces, "") == 0.75).all()


def test_what_is_missing_is_none(two_faces):
    assert attribute_by_corner(two_faces, "own") is None
    assert uv_by_corner(two_faces, "") is None
    assert uv_by_corner(two_faces, "own") is None
    assert tangents_by_corner(two_faces, "own") is None
    two_faces.attributes.new("text", "STRING", "POINT")
    assert attribute_by_corner(two_faces, "text") is None
    empty = bpy.data.meshes.new("empty")
    empty.uv_layers.new(name="UVMap")
    assert tangents_by_corner(empty, "UVMap") is None
    assert len(uv_by_corner(empty, "UVMap")) == 0


def test_uv_layers(two_faces):
    for name, factor in (("first", 1), ("second", 2)):
        two_faces.uv_layers.new(name=name).uv.foreach_set("vector", np.arange(14, dtype="f4") * factor)
    two_faces.uv_layers.active = two_faces.uv_layers["first"]
    two_faces.uv_layers["second"].active_render = True
    expected = np.arange(14, dtype="f4").reshape(7, 2)
    assert (uv_by_corner(two_faces, "first") == expected).all()
    assert (uv_by_corner(two_faces, "") == 2 * expected).all()
    add(two_faces, "FLOAT_VECTOR", "POINT", np.arange(15, dtype="f4"), "vectors")
    assert uv_by_corner(two_faces, "vectors")[4].tolist() == [9, 10]
    assert (attribute_by_corner(two_faces, "first")[:, :2] == expected).all()


def test_a_mesh_in_edit_mode(two_faces):
    """Blender keeps its layers elsewhere: they count as missing, and nothing is raised."""
    add(two_faces, "FLOAT", "POINT", np.arange(5, dtype="f4"))
    two_faces.uv_layers.new(name="UVMap")
    obj = bpy.data.objects.new("two", two_faces)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    assert attribute_by_corner(two_faces, "own") is None
    assert uv_by_corner(two_faces, "UVMap") is None
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("corners", [3, 4, 9])
@pytest.mark.parametrize("is_mirrored", [True, False])
def test_tangents_of_faces_with_any_corners(corners, is_mirrored):
    """A flat disk whose UVs are its x and y, turned by 90 degrees: the tangent is along -y, or +y if U is mirrored."""
    data = bpy.data.meshes.new("disk")
    mesh = bmesh.new()
    bmesh.ops.create_circle(mesh, segments=corners, radius=1.0, cap_ends=True)
    bmesh.ops.create_circle(mesh, segments=4, radius=0.5, cap_ends=True)
    mesh.to_mesh(data)
    mesh.free()
    points = np.empty(len(data.vertices) * 3, np.float32)
    data.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)[[loop.vertex_index for loop in data.loops]]
    sign = -1.0 if is_mirrored else 1.0
    uv = np.stack([-points[:, 1] * sign, points[:, 0]], axis=1)
    data.uv_layers.new(name="UVMap").uv.foreach_set("vector", uv.ravel())
    found = tangents_by_corner(data, "")
    assert found.shape == (len(data.loops), 4)
    normal = data.polygons[0].normal.z
    assert np.abs(found[:, :3] - (0.0, -sign, 0.0)).max() < 1e-5
    assert (found[:, 3] == sign * normal).all()


# Steady tangents


SIDE = 120
"""Faces along a side of the grids: more than PARALLEL in all."""
ROUNDED = 2e-5
"""How far MikkTSpace in single precision may be from double precision where faces take 4e-3 of the layout: 6e-8 / 4e-3."""


def grid(quads, side=SIDE):
    """A wavy grid with a share of quads, the others cut into triangles, a mirrored half of its UVs and a seam between both."""
    rng = np.random.default_rng(17)
    rows, columns = np.mgrid[0 : side + 1, 0 : side + 1] / side
    points = np.stack([columns * 2, rows * 2, 0.2 * np.sin(5 * columns) * np.cos(4 * rows)], axis=-1).reshape(-1, 3)
    numbers = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    corners = np.stack([numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]], axis=-1).reshape(-1, 4)
    is_quad = rng.random(len(corners)) < quads
    cut = corners[~is_quad]
    faces = [*corners[is_quad].tolist(), *cut[:, [0, 1, 2]].tolist(), *cut[:, [0, 2, 3]].tolist()]
    data = bpy.data.meshes.new("grid")
    data.from_pydata(points.tolist(), [], faces)
    data.shade_smooth()
    layout = points[mesh_reader.corner_vertices(data)][:, :2] / 2
    layout[:, 0] = np.abs(layout[:, 0] - 0.5)
    layout += rng.normal(0, 1e-3, (len(points), 2))[mesh_reader.corner_vertices(data)]
    data.uv_layers.new(name="UVMap").uv.foreach_set("vector", layout.astype(np.float32).reshape(-1))
    return data


def of_blender(data):
    data.calc_tangents(uvmap="UVMap")
    values = np.empty((len(data.loops), 3), np.float32)
    data.loops.foreach_get("tangent", values.reshape(-1))
    data.free_tangents()
    return values


def read(data):
    return mesh_reader.with_tangents(data, "UVMap", "grid", np.eye(4)).tangents


@pytest.mark.parametrize("quads", [0.0, 0.5, 1.0])
def test_tangents_are_those_of_mikktspace_and_the_same_each_time(quads):
    data = grid(quads)
    assert len(data.polygons) > steady_tangents.PARALLEL
    found = {read(data).tobytes() for _ in range(4)}
    assert len(found) == 1
    found, expected = read(data)[:, :3], of_blender(data)
    assert np.abs(found - expected).max() < ROUNDED
    assert not np.array_equal(found, expected)  # or nothing was added up again


def test_small_meshes_are_steady_in_blender():
    """The reason for PARALLEL."""
    data = grid(1.0, 100)
    assert len(data.polygons) == steady_tangents.PARALLEL
    assert len({of_blender(data).tobytes() for _ in range(6)}) == 1


def test_corners_that_differ_for_another_reason_stay():
    data = grid(0.5)
    before = of_blender(data)
    before[:7] = [0.6, 0.8, 0.0]
    before[9] = np.nan
    mesh = mesh_reader.surface(data, "UVMap", "grid", np.eye(4))
    tangents = np.concatenate([before, np.ones((len(before), 1), np.float32)], axis=1)
    found = steady_tangents.steady(
        tangents,
        positions=mesh.positions[mesh.vertices],
        normals=mesh.normals,
        uv=mesh.uv,
        starts=mesh_reader.face_values(data, "loop_start"),
        sizes=mesh_reader.face_values(data, "loop_total"),
    )
    assert np.array_equal(found[[*range(7), 9]], tangents[[*range(7), 9]], equal_nan=True)
    assert np.array_equal(found[:, 3], tangents[:, 3])


# Vertex weights


NAMES = {"offset_group": "far", "straight_group": "turned"}


def paint(obj, name, by_vertex):
    """Give the group `name` these weights; vertices with None stay outside."""
    group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
    for vertex, weight in enumerate(by_vertex):
        if weight is not None:
            group.add([vertex], weight, "REPLACE")


def read_weights(low, high=None, **settings):
    high = high or zoo.plane("hi")
    bpy.context.view_layer.update()
    return reading.read(bpy.context, low, [high], None, Settings(**{"method": "CAST"} | settings))


def with_nodes(obj, build):
    """Add a Geometry Nodes modifier; build(tree, group_input, group_output) makes the nodes."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for kind in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=kind, socket_type="NodeSocketGeometry")
    build(tree, tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput"))
    obj.modifiers.new("Nodes", "NODES").node_group = tree


def test_each_corner_has_the_weight_of_its_vertex():
    low = zoo.plane("lo", n=2)
    paint(low, "other", [0.1] * 9)
    paint(low, "turned", [0.0, 0.25, 0.5, 1.0] + [None] * 5)
    paint(low, "far", [None] * 5 + [0.0, 0.25, 0.5, 1.0])
    meshes = read_weights(low, **NAMES)
    offset = np.array([1, 1, 1, 1, 1, 0, 0.5, 1, 2], np.float32)  # twice the weight, 1 outside the group
    straight = np.array([-1, -0.5, 0, 1, 0, 0, 0, 0, 0], np.float32)
    assert np.array_equal(meshes.offset, offset[meshes.low.vertices])
    assert np.array_equal(meshes.straight, straight[meshes.low.vertices])
    assert meshes.offset.dtype == meshes.straight.dtype == np.float32


def test_without_names_nothing_is_read():
    low = zoo.plane("lo")
    paint(low, "far", [0.0] * 4)
    meshes = read_weights(low)
    assert meshes.offset is None
    assert meshes.straight is None
    meshes = read_weights(low, offset_group="far")
    assert (meshes.offset == 0.0).all()
    assert meshes.straight is None


def test_a_new_group_changes_nothing():
    low = zoo.plane("lo", n=2)
    bpy.context.view_layer.update()  # before the group is added, which Blender does not take for a change
    low.vertex_groups.new(name="far")
    assert (read_weights(low, offset_group="far").offset == 1.0).all()


def test_flatten_needs_no_group():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    assert read_weights(low, high, method="FLATTEN", **NAMES).offset is None
    with pytest.raises(BakeError, match="'lo' has no vertex group 'far'"):
        read_weights(low, high, method="AUTO", **NAMES)


def test_a_group_with_a_similar_name_is_suggested():
    low = zoo.plane("lo")
    paint(low, "farther", [0.0] * 4)
    with pytest.raises(BakeError, match="did you mean 'farther'"):
        read_weights(low, offset_group="fahrter")


@pytest.mark.parametrize("kind", ["SUBSURF", "MIRROR", "TRIANGULATE", "ARRAY"])
def test_modifiers_carry_the_weights_to_their_vertices(kind):
    """The weight is 0.5 + x / 2, which all of these modifiers keep up to their own moves of the vertices."""
    low = zoo.plane("lo", n=4)
    paint(low, "far", [0.5 + 0.5 * vertex.co.x for vertex in low.data.vertices])
    modifier = low.modifiers.new("Modifier", kind)
    if kind == "SUBSURF":
        modifier.subdivision_type, modifier.levels, modifier.render_levels = "SIMPLE", 1, 2
    meshes = read_weights(low, offset_group="far")
    x = meshes.low.positions[meshes.low.vertices][:, 0]
    if kind == "ARRAY":
        x = np.where(np.arange(len(x)) < len(x) // 2, x, x - 2.0)
    if kind == "MIRROR":  # merged and copied vertices have the weights of their originals
        assert len(x) == 128
        x = np.concatenate([x[:64], -x[64:]])
    if kind == "SUBSURF":
        assert len(x) == 64 * 16  # as set for rendering
    assert np.allclose(meshes.offset, 1.0 + x, atol=1e-6)


def test_modifiers_may_renumber_the_groups():
    low, other = zoo.plane("lo"), zoo.plane("other")
    paint(other, "another", [0.9] * 4)
    paint(low, "far", [0.25] * 4)

    def join(tree, first, last):
        node, info = tree.nodes.new("GeometryNodeJoinGeometry"), tree.nodes.new("GeometryNodeObjectInfo")
        info.inputs["Object"].default_value = other
        tree.links.new(first.outputs[0], node.inputs[0])
        tree.links.new(info.outputs["Geometry"], node.inputs[0])
        tree.links.new(node.outputs[0], last.inputs[0])

    with_nodes(low, join)
    assert sorted(read_weights(low, offset_group="far").offset) == [0.5] * 4 + [1.0] * 4


def test_modifiers_that_remove_the_group_are_named():
    low = zoo.plane("lo")
    paint(low, "far", [1.0] * 4)

    def remove(tree, first, last):
        node = tree.nodes.new("GeometryNodeRemoveAttribute")
        node.inputs["Name"].default_value = "far"
        tree.links.new(first.outputs[0], node.inputs[0])
        tree.links.new(node.outputs[0], last.inputs[0])

    with_nodes(low, remove)
    with pytest.raises(BakeError, match="remove its vertex group 'far'"):
        read_weights(low, offset_group="far")


def test_a_base_mesh_has_its_own_weights():
    low = zoo.plane("lo", n=2)
    paint(low, "far", [0.0] * 3 + [None] * 6)
    low.modifiers.new("Subdivision", "SUBSURF")
    meshes = read_weights(low, low, offset_group="far")
    assert meshes.is_own_base
    assert np.array_equal(meshes.offset, np.where(meshes.low.vertices < 3, 0.0, 1.0))


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT", "WEIGHT_PAINT"])
def test_every_mode_has_the_weights(mode):
    low, high = zoo.plane("lo", n=2), zoo.plane("hi")
    paint(low, "far", [0.0] * 3 + [None] * 6)
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode=mode)
    settings = Settings(method="CAST", offset_group="far")
    for meshes in (
        reading.read(bpy.context, low, [high], None, settings),
        reading.read_again(bpy.context, low, [high], None, settings),
    ):
        assert np.array_equal(meshes.offset, np.where(meshes.low.vertices < 3, 0.0, 1.0))


def test_corners_without_a_normal_get_that_of_their_face_where_faces_cancel_out():
    """A triangle and itself turned over, and one without an area."""
    data = bpy.data.meshes.new("Both")
    data.from_pydata(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (3, 0, 0), (4, 0, 0), (5, 0, 0)], [], [(0, 1, 2), (0, 2, 1), (3, 4, 5)]
    )
    data.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.tile(np.float32([0, 0, 1, 0, 0, 1]), 3))
    data.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    mesh = mesh_reader.with_tangents(data, "UVMap", "both", np.eye(4))
    assert mesh.without_normals == 3
    assert mesh.normals.reshape(3, 3, 3)[:, :, 2].tolist() == [[1, 1, 1], [-1, -1, -1], [1, 1, 1]]
