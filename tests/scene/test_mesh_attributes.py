# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of attributes, UV layers and tangents by face corner. test_high_materials.py compares values with Cycles."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.scene.mesh_elements import attribute_by_corner, tangents_by_corner, uv_by_corner
from addon.scene.textures import srgb_to_linear

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
