# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the checks of objects, and bakes of several objects, with parents, and onto their own base mesh."""

import bmesh
import bpy
import mathutils
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.scene import object_checks
from addon.scene.object_checks import object_by_name
from tests.support import angles, maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

UNIT = 1e-6
"""The error of single precision."""
SCULPT_P99 = 0.05
"""Degrees. Multires stores displacements in tangent space, in single precision: its normals differ a little from the mesh's."""


def applied(obj):
    """A copy of an object with its modifiers applied, and the UVs that they give."""
    mesh = bpy.data.meshes.new_from_object(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    return scenes.link(bpy.data.objects.new("applied", mesh))


def base(obj):
    """A copy of an object without modifiers."""
    return scenes.link(bpy.data.objects.new("base", obj.data.copy()))


def problem(low, *highs):
    bpy.context.view_layer.update()  # as before a panel is drawn
    return object_checks.problem(bpy.context, low, highs)


# Names and reasons


def test_an_object_is_found_by_its_name():
    cube = zoo.cube("Cube")
    assert object_by_name("Cube") == cube


@pytest.mark.parametrize(("typo", "hint"), [("Kube", "did you mean 'Cube'?"), ("xyz", "it has '")])
def test_an_unknown_name_gets_a_hint(typo, hint):
    zoo.cube("Cube")
    zoo.plane("Plane")
    with pytest.raises(BakeError) as refused:
        object_by_name(typo)
    assert repr(typo) in str(refused.value)
    assert hint in str(refused.value)


def test_a_valid_pair_has_no_problem():
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    assert problem(low, high) == ""


def test_no_low_object():
    assert problem(None).startswith("No low object: select")


def test_modifiers_may_add_faces_and_uvs():
    """Evaluating them to find out would be too slow for every redraw."""
    low, empty = zoo.plane("lo"), scenes.link(bpy.data.objects.new("empty", bpy.data.meshes.new("empty")))
    assert problem(low, empty).startswith("'empty' has no faces")
    empty.modifiers.new("Nodes", "NODES")
    assert problem(low, empty) == ""
    assert problem(empty, low) == ""
    empty.modifiers["Nodes"].node_group = bpy.data.node_groups.new("Cube", "GeometryNodeTree")
    empty.modifiers["Nodes"].node_group.nodes.new("GeometryNodeMeshCube")
    assert problem(empty, empty).startswith("'empty' has no faces")


def test_the_outdated_mesh_of_an_object_in_edit_mode_is_not_checked():
    low = scenes.link(bpy.data.objects.new("lo", bpy.data.meshes.new("lo")))
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.primitive_plane_add()
    assert len(low.data.polygons) == 0
    assert problem(low, zoo.terrain("hi")) == ""


@pytest.mark.parametrize("scale", [(1e-12, 1e-12, 1e-12), (1e12, 1e12, 1e12), (1e-3, 1, 1e3), (-1, 1, 1)])
def test_odd_scales_are_no_problem(scale):
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    high.scale = scale
    assert problem(low, high) == ""


# Bakes


def test_several_high_objects_fill_one_map():
    low = zoo.two_islands("lo")
    parts = []
    for side, slope in ((0, 1.0), (1, -2.0)):
        points = np.array([(x, y, slope * x) for x in (0, 1) for y in (0, 1)])
        corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (0.375, 1) + (0.625 * side, 0)
        parts.append(zoo.build(f"part {side}", points, [(0, 2, 3, 1)], [corner]))
    texels = maps.bake(low, *parts, space="OBJECT", size=(64, 64))
    for texel, slope in ((texels[32, 10], 1.0), (texels[32, 53], -2.0)):
        expected = np.array([-slope, 0, 1]) / np.hypot(slope, 1)
        np.testing.assert_allclose(texel, [*(expected * 0.5 + 0.5), 1], rtol=0, atol=UNIT)
    assert texels[32, 32, 3] == 0
    right = maps.bake(low, parts[1], space="OBJECT", size=(64, 64))
    assert right[32, 10, 3] == 0


def test_transforms_of_parents_are_used():
    """Compares the normal of a plane in the low object's space with one from the parents' matrices."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    lean = mathutils.Matrix.LocRotScale((1, 2, 3), mathutils.Euler((0.3, 1.1, -0.7)), (1, -2, 0.5))
    turn = mathutils.Matrix.LocRotScale((-4, 0, 1), mathutils.Euler((1.0, -0.2, 0.4)), (3, 1, 1))
    for obj, matrix in ((low, lean), (high, turn)):
        obj.parent = scenes.link(bpy.data.objects.new("parent", None))
        obj.parent.matrix_basis = matrix
    texels = maps.bake(low, high, space="OBJECT", size=(16, 16))
    in_world = np.linalg.inv(np.array(turn))[:3, :3].T @ (0, 0, 1)
    expected = np.array(lean)[:3, :3].T @ in_world  # the inverse of the low object's own inverse transpose
    expected /= np.linalg.norm(expected)
    np.testing.assert_allclose(texels[8, 8, :3] * 2 - 1, expected, rtol=0, atol=4 * UNIT)


def test_subdivision_onto_its_own_base():
    cube = zoo.cube("cube", smooth=True)
    modifier = cube.modifiers.new("Rounded", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 3
    texels = maps.bake(cube, cube)
    assert not np.array_equal(texels, maps.bake(cube, cube, modifiers="VIEWPORT"))
    # The same with the modifier applied, and the UVs of the base mesh.
    modifier.levels, modifier.uv_smooth = 3, "NONE"
    np.testing.assert_array_equal(texels, maps.bake(base(cube), applied(cube)))


def test_displacement_onto_its_own_base():
    plane = zoo.plane("plane", 16)
    plane.vertex_groups.new(name="right").add([v.index for v in plane.data.vertices if v.co.x > 0], 1.0, "REPLACE")
    lift = plane.modifiers.new("Lift", "DISPLACE")
    lift.vertex_group, lift.strength, lift.mid_level = "right", 0.25, 0.0  # a step twice as high as wide
    texels = maps.bake(plane, plane, size=(32, 32))
    np.testing.assert_array_equal(texels, maps.bake(base(plane), applied(plane), size=(32, 32)))
    np.testing.assert_allclose(texels[16, 2, :3], [0.5, 0.5, 1], rtol=0, atol=UNIT)
    assert texels[16, 16, 0] < 0.3  # the step goes up to the right, so its normals lean to the left


def test_multires_onto_its_own_base():
    """A sculpt with the viewport at its base level."""
    sculpt = zoo.plane("sculpt", 4)
    modifier = sculpt.modifiers.new("Multires", "MULTIRES")
    bpy.context.view_layer.objects.active = sculpt
    sculpt.select_set(True)
    for _ in range(3):
        bpy.ops.object.multires_subdivide(modifier="Multires", mode="SIMPLE")
    bumpy = applied(sculpt)
    points = np.empty((len(bumpy.data.vertices), 3), np.float32)
    bumpy.data.vertices.foreach_get("co", points.ravel())
    points[:, 2] = 0.05 * np.sin(4 * points[:, 0]) * np.cos(3 * points[:, 1])
    bumpy.data.vertices.foreach_set("co", points.ravel())
    bumpy.data.update()
    bumpy.select_set(True)
    assert bpy.ops.object.multires_reshape(modifier="Multires") == {"FINISHED"}
    modifier.levels, modifier.sculpt_levels, modifier.render_levels = 0, 1, 3
    expected = maps.bake(sculpt, bumpy, space="OBJECT")
    assert np.ptp(expected[..., 0]) > 0.1
    error = angles.degrees(angles.decode(maps.bake(sculpt, sculpt, space="OBJECT")), angles.decode(expected))
    assert np.percentile(error, 99) < SCULPT_P99


def test_the_uv_layer_of_the_same_name_is_used():
    """And not the active layer of the high mesh."""
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=1.0)
    other = high.data.uv_layers.new(name="Other")
    other.uv.foreach_set("vector", np.full(8, 0.5, np.float32))
    high.data.uv_layers.active = other
    assert maps.bake(low, high, size=(16, 16))[..., 3].all()
    low.data.uv_layers[0].name = "Nowhere else"
    with pytest.raises(BakeError):  # now the active layer is used, which has no area
        maps.bake(low, high, size=(16, 16))


@pytest.mark.parametrize("name", ["{low}", "a{low}b", "{x}", "{"])
def test_a_low_object_may_have_any_name(name):
    low, high = zoo.plane(name), zoo.plane("high")
    report = bake_pair(bpy.context, low, [high], Settings(method="FLATTEN", width=16, height=16, mask=True))
    assert report.image == f"{name}_normal"
    assert sorted(image.name for image in bpy.data.images) == [f"{name}_missed", f"{name}_normal"]


# Swapped objects


def test_swapped_objects_give_a_warning():
    fine, coarse = zoo.terrain("fine"), zoo.plane("coarse")
    settings = Settings(method="FLATTEN", width=16, height=16)
    expected = "'fine' has more faces than 'coarse'. Are they swapped?"
    assert expected in bake_pair(bpy.context, fine, [coarse], settings).warnings
    assert expected not in bake_pair(bpy.context, coarse, [fine], settings).warnings


def test_triangles_count_where_objects_seem_swapped():
    """A low mesh of triangles may have more faces than a high one of quads or of n-gons, and fewer triangles."""
    low, quads, ngon = zoo.terrain("low", 6), zoo.terrain("quads", 6), zoo.plane("ngon")
    for obj, change in ((low, bmesh.ops.triangulate), (ngon, None)):
        mesh = bmesh.new()
        mesh.from_mesh(obj.data)
        change(mesh, faces=mesh.faces) if change else bmesh.ops.create_circle(mesh, segments=200, cap_ends=True)
        mesh.to_mesh(obj.data)
        mesh.free()
    assert len(low.data.polygons) > len(quads.data.polygons) > len(ngon.data.polygons)
    assert not object_checks.seem_swapped(low, [quads])
    assert not object_checks.seem_swapped(low, [ngon])
    assert object_checks.seem_swapped(ngon, [quads])
