# SPDX-License-Identifier: GPL-3.0-or-later
"""Armatures, vertex groups and shape keys that low meshes get: weights and offsets by closed forms."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Quaternion

from addon.core import asset_limits
from addon.core.asset_limits import Wanted
from addon.core.levels import limits
from addon.core.naming import Suffixes
from addon.core.progress import Pace, Timings, finish
from addon.core.settings import Settings
from addon.export import engine_files
from addon.jobs import asset, lod, part_state
from addon.jobs.job import Job
from addon.jobs.simplify import bent_poses, low_meshes, skin_weights
from addon.jobs.simplify.high_surface import HighSurface
from addon.jobs.simplify.shared_levels import LayoutSource
from addon.jobs.simplify.skins import Skin
from addon.mesh import transfer
from addon.mesh.fitting import surface_samples
from addon.mesh.mirrors import Plane
from addon.mesh.triangles import transformed
from addon.scene import mesh_reader
from addon.ui import object_pairs
from tests.support import glb, quick_assets, scenes, zoo
from tests.support.snapshot import difference, snapshot

SETTINGS = Settings(width=64, height=64, storage="MEMORY", margin=2, basis="MIKKTSPACE")
TURN = Quaternion((1.0, 2.0, -0.5), 0.9)
ODD = Matrix.LocRotScale((3.0, -2.0, 1.0), TURN, (2.0, 0.5, 1.5))


def rod(name, around, along):
    """A square rod of the height 4 on the ground, open at its ends, with outward normals. around: a multiple of 4."""

    def surface(u, v):
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)], float)
        side = 4.0 * u
        x, y = (np.interp(side, np.arange(5), axis) for axis in corners.T)
        return np.stack([x, y, 4.0 * v], axis=1)

    return zoo.sheet(name, surface, around, along)


def armature(name="rig", bones=("root", "tip"), *, is_chain=False):
    """Bones of the length 2 above each other, and a control that deforms nothing. is_chain: each follows the last one."""
    rig = scenes.link(bpy.data.objects.new(name, bpy.data.armatures.new(name)))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for number, bone in enumerate((*bones, "control")):
        made = rig.data.edit_bones.new(bone)
        made.head, made.tail = (0.0, 0.0, 2.0 * number), (0.0, 0.0, 2.0 * number + 2.0)
        made.use_deform = bone != "control"
        made.parent = rig.data.edit_bones[number - 1] if is_chain and number else None
    bpy.ops.object.mode_set(mode="OBJECT")
    return rig


def arm(obj, rig):
    modifier = obj.modifiers.new("Rig", "ARMATURE")
    modifier.object = rig
    return modifier


def bend(rig, bone="tip"):
    rig.pose.bones[bone].rotation_mode = "QUATERNION"
    rig.pose.bones[bone].rotation_quaternion = TURN


def points(obj):
    return mesh_reader.points(obj.data).astype(np.float64)


def in_world(obj):
    matrix = np.array(obj.matrix_world)
    return points(obj) @ matrix[:3, :3].T + matrix[:3, 3]


def evaluated(obj):
    """The vertices of an object as they are shown, in world space."""
    shown = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    matrix = np.array(shown.matrix_world)
    return mesh_reader.points(shown.data).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def weights(obj, name):
    """The weights of all vertices in a group, -1 where they are not in it."""
    number = obj.vertex_groups[name].index
    return np.array([next((g.weight for g in v.groups if g.group == number), -1.0) for v in obj.data.vertices])


def add_key(obj, name, moved, value=0.0):
    """A shape key with the vertices (V, 3) at `moved`."""
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Rest", from_mix=False)
    key = obj.shape_key_add(name=name, from_mix=False)
    key.points.foreach_set("co", moved.astype(np.float32).reshape(-1))
    key.value = value
    return key


def key_points(obj, name):
    key = obj.data.shape_keys.key_blocks[name]
    return np.array([point.co for point in key.points])


def rods(**options):
    """A fine rod with two bones and a coarse one: the tip's weight is 0 up to z = 1, 1 from z = 3, linear between."""
    high, low, rig = rod("High", 16, 16), rod("Low", 4, 4), armature(**options)
    tip = np.clip((points(high)[:, 2] - 1.0) / 2.0, 0.0, 1.0)
    scenes.weigh(high, "root", 1.0 - tip)
    scenes.weigh(high, "tip", tip)
    arm(high, rig)
    return high, low, rig


def carried(highs, lows, modifiers="VIEWPORT"):
    bpy.context.view_layer.update()
    skin = Skin.of(highs, modifiers)
    with skin.at_rest(bpy.context):
        return finish(skin.carry(bpy.context, lows))


@pytest.mark.parametrize("modifiers", ["VIEWPORT", "RENDER"])
def test_a_rod_gets_the_weights_of_its_bones(modifiers):
    high, low, rig = rods()
    bend(rig)
    assert carried([high], [low], modifiers) == []
    z = points(low)[:, 2]
    tip = np.clip((z - 1.0) / 2.0, 0.0, 1.0)
    np.testing.assert_allclose(np.maximum(weights(low, "tip"), 0.0), tip, atol=1e-6)
    np.testing.assert_allclose(np.maximum(weights(low, "root"), 0.0), 1.0 - tip, atol=1e-6)
    assert (weights(low, "tip")[z < 0.9] == -1.0).all()  # and is not in the group
    (modifier,) = low.modifiers
    assert (modifier.type, modifier.object, modifier.name) == ("ARMATURE", rig, "Rig")
    assert rig.data.pose_position == "POSE"
    bpy.context.view_layer.update()
    assert np.abs(evaluated(low) - points(low)).max() > 1.0
    corners = {tuple(np.round(place, 4)) for place in evaluated(high)}
    ends = evaluated(low)[np.isin(z, (0.0, 4.0))]
    assert {tuple(np.round(place, 4)) for place in ends} <= corners


def test_the_copy_of_a_modifier_deforms_alike():
    high, low, rig = rods()
    high.modifiers[0].use_deform_preserve_volume = True
    high.modifiers[0].vertex_group, high.modifiers[0].invert_vertex_group = "root", True
    hidden = high.modifiers.new("Off", "ARMATURE")
    hidden.object, hidden.show_viewport = rig, False
    other = low.modifiers.new("Triangulate", "TRIANGULATE")
    carried([high], [low])
    assert list(low.modifiers)[1] == other and len(low.modifiers) == 2
    made = low.modifiers[0]
    assert made.use_deform_preserve_volume and made.invert_vertex_group and made.vertex_group == "root"


def test_at_most_four_bones_move_a_vertex_and_their_weights_are_one():
    """Six bones and a mask; Blender deforms by weights over their sum."""
    is_bone = np.array([True] * 6 + [False])
    source = np.array([[0.5, 0.4, 0.3, 0.2, 0.1, 0.5, 0.9], [2, 0, 0, 0, 0, 0, 0.3], [0, 0, 0, 0, 0, 0, 0.6]], float)
    before = source.copy()
    weights = skin_weights.normalized(source, is_bone)
    np.testing.assert_allclose(weights[0, :6], source[0, :6] / 2.0)
    np.testing.assert_array_equal(weights[1, :6], [1, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(weights[2, :6], 0.0)
    np.testing.assert_array_equal(weights[:, 6], source[:, 6])
    found = skin_weights.limited(
        np.array([[*weights[0, :6], 1.2], [-0.1, 0, 0.7, 0.3, 0.00005, 0, -0.2], [0.4, 0, 0, 0, 0, 0, 0.5]]), is_bone
    )
    np.testing.assert_allclose(found[0], [0.5 / 1.7, 0.4 / 1.7, 0.3 / 1.7, 0.0, 0.0, 0.5 / 1.7, 1.0])
    np.testing.assert_allclose(found[1], [0.0, 0.0, 0.7, 0.3, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(found[2], [0.0] * 6 + [0.5])  # most of it stays where it is
    np.testing.assert_array_equal(source, before)


def test_values_of_vertices_come_nearest_to_those_of_samples():
    """The parabola x^2 on an edge of the length 1: the best line has the values -1/6 and 5/6 at its ends, not 0 and 1."""
    samples = (np.arange(2000) + 0.5) / 2000.0
    shares = np.stack([1.0 - samples, samples, np.zeros(2000)], axis=1)
    triangle, none = np.array([[0, 1, 2]]), np.zeros(2000, int)
    start = np.array([0.0, 1.0, 7.0])
    missing = np.stack([samples**2 - samples, 0.0 * samples], axis=1)
    moved = transfer.projected(missing, triangle, none, shares, 3)
    np.testing.assert_allclose(start + moved[:, 0], [-1.0 / 6.0, 5.0 / 6.0, 7.0], atol=0.02)
    np.testing.assert_array_equal(moved[:, 1], 0.0)


def test_values_of_vertices_are_those_of_least_squares():
    """Against numpy's dense solver."""
    rng = np.random.default_rng(7)
    triangles = zoo.grid_faces(5, 5)[:, :3]
    nearest, shares = rng.integers(0, len(triangles), 600), rng.dirichlet([1.0, 1.0, 1.0], 600)
    missing = rng.normal(0.0, 1.0, (600, 4))
    rows = np.zeros((600, 36))
    np.put_along_axis(rows, triangles[nearest], shares, axis=1)
    pull = np.sqrt(transfer.PULL * 600 / 36) * np.eye(36)
    best = np.linalg.lstsq(np.vstack([rows, pull]), np.vstack([missing, np.zeros((36, 4))]), rcond=None)[0]
    np.testing.assert_allclose(transfer.projected(missing, triangles, nearest, shares, 36), best, atol=2e-3)


def test_a_low_mesh_lies_on_both_sides_of_what_it_cannot_follow():
    """A key that bows a rod by z^2: the best lines between rings of the distance 1 lie 1/6 below it at each ring."""
    high, low = rod("High", 8, 48), rod("Low", 4, 4)
    bow = points(high)
    bow[:, 0] += bow[:, 2] ** 2
    add_key(high, "bow", bow)
    carried([high], [low])
    offsets = key_points(low, "bow") - points(low)
    np.testing.assert_allclose(offsets[:, 0], points(low)[:, 2] ** 2 - 1.0 / 6.0, atol=0.06)
    np.testing.assert_allclose(offsets[:, 1:], 0.0, atol=1e-6)


@pytest.mark.parametrize(("turn", "place"), [("Y", (5.0, 0.0, 2.0)), ("Z", (0.0, 0.0, 4.2))])
def test_what_the_low_mesh_lacks_lends_no_weights(turn, place):
    """A plate beside a side of the rod that faces the same way, and one over its end that faces another."""
    high, low, _ = rods()
    plate = zoo.plane("Plate", 4)
    plate.matrix_world = Matrix.Translation(place) @ Matrix.Rotation(np.pi / 2.0, 4, turn)
    scenes.weigh(plate, "plate", 1.0)
    carried([high, plate], [low])
    assert (weights(low, "plate") == -1.0).all()


def test_places_on_the_other_side_of_a_gap_are_left_out():
    """Lips: two sheets that face each other, and places that lie beyond the middle between them."""
    lower, upper = zoo.plane("lower", 4), zoo.plane("upper", 4)
    corners = mesh_reader.corner_vertices(lower.data).reshape(-1, 4)
    triangles = np.concatenate([corners[:, :3], corners[:, [0, 2, 3]]])
    count, flat = len(points(lower)), triangles
    walls = [
        turned + side * np.eye(3)[axis]
        for axis in (0, 1)
        for side in (-3.0, 3.0)
        for turned in [np.roll(points(lower), 1 + axis, axis=1)]
    ]
    high = np.concatenate([points(lower), points(upper) + [0.0, 0.0, 0.1], *walls])
    both = np.concatenate(
        [triangles, triangles[:, ::-1] + count, *(flat[:, :: (-1) ** n] + (2 + n) * count for n in range(4))]
    )
    rng = np.random.default_rng(3)
    places = np.append(rng.uniform(-0.9, 0.9, (50, 2)), np.full((50, 1), 0.05), axis=1)
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    for turn in np.eye(3), np.roll(np.eye(3), 1, axis=0), np.roll(np.eye(3), 2, axis=0):
        for sign, height in ((1.0, 0.0), (-1.0, 0.1)):
            beyond = places + [0.0, 0.0, 0.02 * sign]
            found, shares = transfer.nearest_places(high @ turn, both, beyond @ turn, sign * up @ turn)
            on = (shares[..., None] * (high @ turn)[both[found]]).sum(axis=1) @ turn.T
            np.testing.assert_allclose(on[:, :2], places[:, :2], atol=1e-6)
            np.testing.assert_allclose(on[:, 2], height, atol=1e-6)
    found, _ = transfer.nearest_places(high[:count], triangles, places, -up)
    assert len(found) == 50  # none looks that way: the nearest one


def test_shape_keys_that_are_affine_are_exact():
    """Objects are turned and scaled unevenly; one key is relative to another one."""
    high, low = rod("High", 16, 16), rod("Low", 4, 4)
    high.matrix_world = ODD
    own = Matrix.LocRotScale((1.0, 0.0, 2.0), TURN.inverted(), (0.7, 0.9, 1.1))
    low.data.transform(own.inverted() @ ODD)
    low.matrix_world = own
    rng = np.random.default_rng(5)
    first, second = rng.normal(0.0, 1.0, (2, 3, 4))
    at = points(high)
    add_key(high, "one", at + at @ first[:, :3].T + first[:, 3], value=0.3)
    two = add_key(high, "two", points(high) + at @ (first + second)[:, :3].T + (first + second)[:, 3])
    two.relative_key = high.data.shape_keys.key_blocks["one"]
    two.slider_min, two.slider_max, two.mute = -2.0, 3.0, True
    assert carried([high], [low]) == []
    own = np.linalg.inv(np.array(ODD))
    here = in_world(low) @ own[:3, :3].T + own[:3, 3]
    for name, affine in (("one", first), ("two", second)):
        moved = (here @ affine[:, :3].T + affine[:, 3]) @ np.array(ODD)[:3, :3].T
        offsets = (key_points(low, name) - points(low)) @ np.array(low.matrix_world)[:3, :3].T
        np.testing.assert_allclose(offsets, moved, atol=5e-5)
    keys = low.data.shape_keys.key_blocks
    assert [(key.name, round(key.value, 4), key.mute) for key in keys[1:]] == [("one", 0.3, False), ("two", 0.0, True)]
    assert (keys["two"].slider_min, keys["two"].slider_max) == (-2.0, 3.0)
    assert keys[0].name == "Rest" and keys["two"].relative_key == keys[0]
    before = high.data.shape_keys.key_blocks
    assert [key.mute for key in before] == [False, False, True] and not high.show_only_shape_key


def test_keys_follow_the_same_drivers():
    high, low = rod("High", 8, 8), rod("Low", 4, 2)
    key = add_key(high, "one", points(high) * 1.5)
    driver = key.driver_add("value").driver
    driver.type, driver.expression = "SCRIPTED", "0.25"
    carried([high], [low])
    bpy.context.view_layer.update()
    assert low.data.shape_keys.evaluated_get(bpy.context.evaluated_depsgraph_get()).key_blocks[
        "one"
    ].value == pytest.approx(0.25)


def test_weights_of_subdivided_meshes_are_those_that_are_shown():
    high, low, rig = rods()
    high.modifiers.new("Subdivision", "SUBSURF").subdivision_type = "SIMPLE"
    carried([high], [low])
    tip = np.clip((points(low)[:, 2] - 1.0) / 2.0, 0.0, 1.0)
    np.testing.assert_allclose(np.maximum(weights(low, "tip"), 0.0), tip, atol=1e-6)


def test_a_key_of_which_a_modifier_makes_another_mesh_is_left_out():
    high, low = rod("High", 16, 16), rod("Low", 4, 4)
    add_key(high, "flat", points(high) * [1.0, 1.0, 0.0])
    add_key(high, "wide", points(high) * [2.0, 2.0, 1.0])
    weld = high.modifiers.new("Weld", "WELD")
    weld.merge_threshold = 0.01
    (note,) = carried([high], [low])
    assert "makes another mesh of 'flat'" in note
    assert [key.name for key in low.data.shape_keys.key_blocks] == ["Rest", "wide"]


def test_groups_keep_their_names_order_and_locks():
    """A locked group, one without vertices, one of no bone, and sides that mirror each other."""
    high, low = rod("High", 16, 16), rod("Low", 4, 4)
    rig = armature(bones=("hand.L", "hand.R", "unused"))
    x = points(high)[:, 0]
    scenes.weigh(high, "hand.L", (1.0 + x) / 2.0)
    scenes.weigh(high, "hand.R", (1.0 - x) / 2.0).lock_weight = True
    high.vertex_groups.new(name="unused")
    low.vertex_groups.new(name="left by Decimate")
    scenes.weigh(high, "cloth", points(high)[:, 2] / 8.0)
    scenes.weigh(high, "control", 1.0)  # a bone that deforms nothing
    arm(high, rig)
    carried([high], [low])
    assert [(group.name, group.lock_weight) for group in low.vertex_groups] == [
        ("hand.L", False),
        ("hand.R", True),
        ("unused", False),
        ("cloth", False),
        ("control", False),
    ]
    place = points(low)
    np.testing.assert_allclose(np.maximum(weights(low, "hand.L"), 0.0), (1.0 + place[:, 0]) / 2.0, atol=1e-6)
    np.testing.assert_allclose(np.maximum(weights(low, "cloth"), 0.0), place[:, 2] / 8.0, atol=1e-6)
    assert (weights(low, "unused") == -1.0).all()


@pytest.mark.parametrize("kind", ["OBJECT", "BONE", "ARMATURE"])
def test_a_parent_is_kept_and_nothing_moves(kind):
    high, low, rig = rod("High", 8, 8), rod("Low", 4, 4), armature()
    rig.matrix_world = Matrix.LocRotScale((1.0, 2.0, 3.0), TURN, (0.5,) * 3)
    bpy.context.view_layer.update()
    low.matrix_world = high.matrix_world = Matrix.Translation((0.0, 5.0, 0.0))
    scenes.weigh(high, "root", 1.0)
    high.parent, high.parent_type, high.parent_bone = rig, kind, "tip" if kind == "BONE" else ""
    bpy.context.view_layer.update()
    high.matrix_world = Matrix.Translation((0.0, 5.0, 0.0))
    bpy.context.view_layer.update()
    before = in_world(low)
    carried([high], [low])
    assert (
        low.parent == rig
        and (low.parent_type, low.parent_bone)
        == {
            "OBJECT": ("OBJECT", ""),
            "BONE": ("BONE", "tip"),
            "ARMATURE": ("OBJECT", ""),
        }[kind]
    )
    assert [modifier.type for modifier in low.modifiers] == (["ARMATURE"] if kind == "ARMATURE" else [])
    np.testing.assert_allclose(in_world(low), before, atol=1e-5)
    bend(rig, "root" if kind == "ARMATURE" else "tip")
    bpy.context.view_layer.update()
    shown, original = evaluated(low), evaluated(high)
    assert (np.abs(shown - before).max() > 0.1) == (kind != "OBJECT")
    nearest = np.linalg.norm(shown[:, None] - original, axis=2).min(axis=1)
    assert nearest.max() < 1e-4  # each vertex lies on one of the high mesh, in each pose


def uneven_parent(*objects):
    """Objects turned below a parent of uneven scale, which shears them."""
    parent = scenes.link(bpy.data.objects.new("Parent", None))
    parent.matrix_world = Matrix.LocRotScale((0.5, 1.0, 0.0), TURN, (2.0, 0.5, 1.0))
    for obj in objects:
        obj.parent, obj.rotation_mode, obj.rotation_quaternion = parent, "QUATERNION", TURN
    bpy.context.view_layer.update()
    return parent


def test_nothing_moves_below_a_parent_that_shears():
    high, low = rod("High", 8, 8), rod("Low", 4, 4)
    parent = uneven_parent(high)
    low.matrix_world = Matrix.Translation((0.0, 5.0, 0.0))
    bpy.context.view_layer.update()
    before = in_world(low)
    carried([high], [low])
    bpy.context.view_layer.update()
    assert low.parent == parent
    np.testing.assert_allclose(in_world(low), before, atol=1e-5)
    parent.location.x += 3.0
    bpy.context.view_layer.update()
    np.testing.assert_allclose(in_world(low), before + (3.0, 0.0, 0.0), atol=1e-5)


@pytest.mark.parametrize(("limits", "most"), [({"triangles": 200}, 480), ({"triangles": 400, "distance": 0.02}, 100)])
def test_levels_lie_in_a_low_mesh_that_its_parent_shears(monkeypatch, limits, most):
    quick_assets.quicken(monkeypatch)
    high, low = zoo.ball("Ball", 24), zoo.ball("Ball_low", 16)
    uneven_parent(high, low)
    scenes.weigh(low, "group", 1.0)
    reports = made([high], Wanted(levels=1, **limits), low=low)
    level = bpy.data.objects[reports[1].low]
    bpy.context.view_layer.update()
    for sides in (np.min, np.max):
        np.testing.assert_allclose(sides(in_world(level), axis=0), sides(in_world(high), axis=0), atol=0.2)
    assert reports[1].triangles["low"] <= most  # and so it was where it was measured


@pytest.mark.parametrize("is_first", [False, True])
def test_a_part_on_a_bone_belongs_to_that_bone(is_first):
    """A rod with a skin, and a hat whose parent is the upper bone."""
    high, low, rig = rods()
    hat = zoo.plane("Hat")
    hat.parent, hat.parent_type, hat.parent_bone = rig, "BONE", "tip"
    bpy.context.view_layer.update()
    hat.matrix_world = Matrix.Translation((0.0, 0.0, 6.0))
    count = len(points(low))
    both = zoo.build(
        "Both", np.concatenate([points(low), points(hat) + [0, 0, 6]]), [[count, count + 1, count + 2], [0, 1, 6]]
    )
    carried([hat, high] if is_first else [high, hat], [both])
    assert both.modifiers[0].object == rig and both.parent_type == "OBJECT"
    np.testing.assert_allclose(weights(both, "tip")[points(both)[:, 2] > 5.0], 1.0)
    np.testing.assert_allclose(weights(both, "root")[points(both)[:, 2] < 0.5], 1.0)


@pytest.mark.parametrize("mirrored", [(1, 1), (-1, 1), (1, -1)])
def test_sides_of_mirrored_objects_do_not_change_places(mirrored):
    """A slab of the thickness 0.1 whose sides have other weights, and a low one that is folded through itself."""
    side = zoo.plane("side", 4)
    corners = mesh_reader.corner_vertices(side.data).reshape(-1, 4)
    faces = np.concatenate([corners, corners[:, ::-1] + len(points(side))])
    slabs = []
    for name, top, sign in (("High", 0.1, mirrored[0]), ("Low", -0.03, mirrored[1])):
        places = np.concatenate([points(side) + [0, 0, top], points(side)]) * [sign, 1.0, 1.0]
        slabs.append(zoo.build(name, places, faces[:, ::sign]))
        slabs[-1].scale.x = sign
    high, low = slabs
    scenes.weigh(high, "top", np.repeat([1.0, 0.0], len(points(side))))
    carried([high], [low])
    np.testing.assert_allclose(
        np.maximum(weights(low, "top"), 0.0), np.repeat([1.0, 0.0], len(points(side))), atol=1e-6
    )


def test_keys_that_follow_each_other_in_time_are_left_out():
    high, low = rod("High", 8, 8), rod("Low", 4, 4)
    add_key(high, "one", points(high) * 1.5)
    high.data.shape_keys.use_relative = False
    carried([high], [low])
    assert low.data.shape_keys is None


@pytest.mark.parametrize("is_moved", [False, True])
def test_custom_normals_follow_a_pose(is_moved):
    """Plain vectors, as levels that share a map have them. The whole rod turns with one bone."""
    high, low, rig = rod("High", 8, 8), rod("Low", 4, 4), armature()
    scenes.weigh(high, "root", 1.0)
    arm(high, rig)
    before = mesh_reader.corner_normals(low.data) + np.random.default_rng(3).normal(0.0, 0.2, (len(low.data.loops), 3))
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    low.data.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER").data.foreach_set(
        "vector", before.astype(np.float32).reshape(-1)
    )
    carried([high], [low])
    if is_moved:
        bend(rig, "root")
    bpy.context.view_layer.update()
    shown = mesh_reader.corner_normals(low.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)
    turn = np.array(rig.pose.bones["root"].matrix.to_3x3() @ rig.data.bones["root"].matrix_local.to_3x3().inverted())
    np.testing.assert_allclose(shown, before @ turn.T, atol=2e-3)


def test_a_parent_among_the_objects_is_passed():
    high, eye, low = rod("High", 8, 8), zoo.plane("Eye"), rod("Low", 4, 4)
    empty = scenes.link(bpy.data.objects.new("Root", None))
    eye.parent, high.parent = high, empty
    carried([eye, high], [low])
    assert low.parent == empty


def test_two_armatures_are_one_sentence_and_nothing_is_carried():
    high, low, rig = rods()
    other = armature("other")
    arm(low_hat := rod("Hat", 4, 4), other)
    bend(rig)
    (note,) = carried([high, low_hat], [low])
    assert "2 armatures, 'rig', 'other'" in note
    assert not low.vertex_groups and not low.modifiers
    with Skin.of([high, low_hat], "VIEWPORT").at_rest(bpy.context):
        assert rig.data.pose_position == "POSE"


def bumps(high, height=0.1):
    """Offsets along the normals (V, 3)."""
    normals = np.array([normal.vector for normal in high.data.vertex_normals])
    return height * np.sin(9.0 * points(high)[:, :1]) * normals


@pytest.mark.parametrize("is_animated", [False, True])
def test_layers_of_detail_stay_in_the_shape(is_animated):
    """A key with a value that moves vertices along their normals alone, unless something drives it."""
    high, low = zoo.ball("High", 16), zoo.ball("Low", 4)
    add_key(high, "wrinkles", points(high) + bumps(high), value=1.0)
    add_key(high, "wide", points(high) * [2.0, 1.0, 1.0], value=0.5)
    if is_animated:
        high.data.shape_keys.key_blocks["wide"].keyframe_insert("value", frame=1)
    detailed = points(high) + bumps(high) * (not is_animated)
    skin = Skin.of([high], "VIEWPORT")
    with skin.at_rest(bpy.context):
        np.testing.assert_allclose(evaluated(high), detailed, atol=1e-6)
    assert carried([high], []) == []  # a mesh that is kept lacks nothing
    notes = carried([high], [low])
    names = [key.name for key in low.data.shape_keys.key_blocks]
    assert names == (["Rest", "wrinkles", "wide"] if is_animated else ["Rest", "wide"])
    assert [("'wrinkles'" in note and "layers of detail" in note) for note in notes] == [True] * (not is_animated)
    if is_animated:
        assert low.data.shape_keys.animation_data.action == high.data.shape_keys.animation_data.action


def test_rest_ends_with_the_block_also_if_it_fails():
    high, _, rig = rods()
    add_key(high, "wide", points(high) * [3.0, 1.0, 1.0], value=1.0)
    other = rod("Other", 4, 4)
    add_key(other, "tall", points(other) * [1.0, 1.0, 3.0], value=1.0)
    add_key(other, "off", points(other) * 2.0, value=1.0).mute = True
    bend(rig)
    bpy.context.view_layer.update()
    posed, skin = evaluated(high), Skin.of([high], "VIEWPORT")
    with pytest.raises(ZeroDivisionError), skin.at_rest(bpy.context, [other]):
        np.testing.assert_allclose(evaluated(high), points(high), atol=1e-6)
        np.testing.assert_allclose(evaluated(other), points(other), atol=1e-6)
        raise ZeroDivisionError
    np.testing.assert_array_equal(evaluated(high), posed)
    assert [key.mute for key in other.data.shape_keys.key_blocks] == [False, False, True]
    with skin.at_rest(bpy.context):
        bpy.data.objects.remove(rig)
        bpy.data.objects.remove(high)


def test_objects_without_any_of_it_leave_low_meshes_alone():
    high, low = rod("High", 8, 8), rod("Low", 4, 4)
    before = snapshot()
    assert carried([high], [low]) == []
    assert difference(before, snapshot()) == {}


def test_instances_without_a_surface_of_their_own_give_their_parent():
    low, rig = rod("Low", 4, 4), armature()
    shown = bpy.data.collections.new("Shown")
    shown.objects.link(zoo.cube("Inside"))
    empty = scenes.link(bpy.data.objects.new("Instance", None))
    empty.instance_type, empty.instance_collection = "COLLECTION", shown
    empty.parent, empty.parent_type, empty.parent_bone = rig, "BONE", "tip"
    assert carried([empty], [low]) == []
    assert (low.parent, low.parent_type, low.parent_bone) == (rig, "BONE", "tip") and not low.vertex_groups


def test_triangles_that_are_not_finite_give_nothing():
    high, low, _ = rods()
    broken = points(high)
    broken[40] = np.nan
    high.data.vertices.foreach_set("co", broken.astype(np.float32).reshape(-1))
    high.data.update()
    carried([high], [low])
    tip = np.clip((points(low)[:, 2] - 1.0) / 2.0, 0.0, 1.0)
    assert np.abs(np.maximum(weights(low, "tip"), 0.0) - tip).max() < 0.2  # the place beside


@pytest.mark.parametrize("pose", [0, 1])
def test_motions_are_those_of_the_posed_objects(pose):
    """Against Blender's own Armature modifier and shape keys: one key in each pose."""
    high, _, rig = rods(is_chain=True)
    add_key(high, "wide", points(high) * [1.5, 1.0, 1.0])
    add_key(high, "tall", points(high) * [1.0, 1.0, 1.2])
    rig.matrix_world = high.matrix_world = ODD
    bpy.context.view_layer.update()
    skin, origin = Skin.of([high], "VIEWPORT"), np.array([4.0, 1.0, -2.0])
    rest = in_world(high) - origin
    triangles = mesh_reader.corner_vertices(high.data).reshape(-1, 4)[:, :3]
    with skin.at_rest(bpy.context):
        motions = finish(skin.motions(bpy.context, rest, triangles, origin))
    assert motions.shape == (2, len(rest), 3, 4)
    for bone in ("root", "tip"):
        rig.pose.bones[bone].rotation_mode = "XYZ"
        rig.pose.bones[bone].rotation_euler[2 * pose] = bent_poses.ANGLE
    high.data.shape_keys.key_blocks[("wide", "tall")[pose]].value = 1.0
    bpy.context.view_layer.update()
    posed = np.einsum("vij,vj->vi", motions[pose, ..., :3], rest) + motions[pose, ..., 3] + origin
    np.testing.assert_allclose(posed, evaluated(high), atol=2e-4)


@pytest.mark.parametrize("is_override", [False, True])
def test_rigs_of_libraries_are_rigs(is_override, tmp_path):
    """With a constraint of a bone, which the rest pose does not have."""
    high, low, rig = rods()
    bend(rig)
    rig.pose.bones["root"].constraints.new("DAMPED_TRACK").target = high
    bpy.data.libraries.write(str(tmp_path / "rig.blend"), {high, rig}, fake_user=True)
    for obj in (high, rig):
        bpy.data.objects.remove(obj)
    with bpy.data.libraries.load(str(tmp_path / "rig.blend"), link=True) as (_, into):
        into.objects = ["High", "rig"]
    high, rig = map(scenes.link, into.objects)
    if is_override:
        high, rig = (obj.override_create(remap_local_usages=True) for obj in (high, rig))
        high.modifiers[0].object = rig
    bpy.context.view_layer.update()
    posed = evaluated(high)
    assert np.abs(posed - points(high)).max() > 0.5
    with Skin.of([high], "VIEWPORT").at_rest(bpy.context):
        np.testing.assert_allclose(evaluated(high), points(high), atol=1e-6)
    np.testing.assert_array_equal(evaluated(high), posed)
    assert carried([high], [low]) == [] and low.modifiers[0].object == rig
    tip = np.clip((points(low)[:, 2] - 1.0) / 2.0, 0.0, 1.0)
    np.testing.assert_allclose(np.maximum(weights(low, "tip"), 0.0), tip, atol=1e-6)


def test_poses_turn_what_bones_move_and_no_more():
    """Bones and keys that follow each other, and a vertex of which a half stays."""
    rest = np.tile(np.eye(3, 4), (2, 1, 1, 1))
    shift = np.zeros((3, 4))
    shift[0, 3] = 2.0
    one, other = np.ones((2, 3)), np.tile([0.0, 3.0, 0.0], (2, 1))
    weights = np.array([[1.0], [0.5]])
    found = bent_poses.motions(weights, rest + [[shift], [0.0 * shift]], [one, other, one])
    np.testing.assert_allclose(found[0, :, 0, 3], [2.0 + np.sqrt(2.0), 1.0 + np.sqrt(2.0)])
    np.testing.assert_allclose(found[1, :, :, 3], other)
    assert bent_poses.motions(weights, rest, []) is None
    assert len(bent_poses.motions(weights, rest, [one])) == 1  # the other pose is that at rest


@pytest.mark.parametrize("has_skin", [False, True])
def test_low_meshes_of_a_skin_keep_loops_at_joints(has_skin):
    """A rod whose upper half turns with a bone: at rest it is straight, and needs no vertex along its sides."""
    high, rig = rod("High", 16, 16), armature()
    scenes.weigh(high, "root", points(high)[:, 2] <= 2.0)
    scenes.weigh(high, "tip", points(high)[:, 2] > 2.0)
    if has_skin:
        arm(high, rig)
    corners = mesh_reader.corner_vertices(high.data).reshape(-1, 4)
    data = low_meshes.new_mesh(points(high), np.concatenate([corners[:, :3], corners[:, [0, 2, 3]]]))
    places, triangles = low_meshes.arrays(data)
    sources = low_meshes.sources_of(data, surface_samples(places, triangles, 2000), Timings(asset_limits.STAGES))
    surface = HighSurface(places, triangles, np.zeros(3), sources, sources[0].samples, 0.0, 0.0, 0.1, len(triangles))
    skin = Skin.of([high], "VIEWPORT")
    with skin.at_rest(bpy.context):
        surface = finish(asset._posed(bpy.context, skin, surface))
    plain, collapsed = surface.sources
    assert plain.motions is None and (collapsed.motions is not None) == has_skin
    (low,) = finish(collapsed.make(48))
    z = low_meshes.arrays(low.data)[0][:, 2]
    is_at_joint = (z > 1.5) & (z < 2.75)
    assert (np.count_nonzero(is_at_joint) >= 8) == has_skin


def test_halves_move_as_the_whole():
    high = zoo.ball("High", 16)
    data = low_meshes.new_mesh(points(high), mesh_reader.corner_vertices(high.data).reshape(-1, 3))
    places, triangles = low_meshes.arrays(data)
    (_, source) = low_meshes.sources_of(data, surface_samples(places, triangles, 2000), Timings(asset_limits.STAGES))
    motions = np.tile(np.eye(3, 4), (1, len(places), 1, 1))
    motions[0, :, :, 3] = places * 2.0
    half = source.posed(motions).halved(Plane(0, 0.0))
    assert half.bias < source.bias
    np.testing.assert_allclose(half.motions[0, :, :, 3], 2.0 * low_meshes.arrays(half.dense)[0], atol=1e-5)


def made(highs, wanted, low=None, settings=SETTINGS):
    work = asset.work(bpy.context, Job(low or highs[0], highs), wanted, settings, Pace(0.0), suffixes=Suffixes())
    return finish(work)


def character():
    """A closed ball with two bones and a shape key."""
    high, rig = zoo.ball("Head_high", 16), armature()
    high.data.transform(Matrix.Translation((0.0, 0.0, 2.0)))
    tip = np.clip(points(high)[:, 2] - 1.5, 0.0, 1.0)
    scenes.weigh(high, "root", 1.0 - tip)
    scenes.weigh(high, "tip", tip)
    arm(high, rig)
    add_key(high, "smile", points(high) * [1.5, 1.0, 1.0])
    return high, rig


@pytest.mark.usefixtures("gpu_context")
def test_an_asset_of_a_posed_mesh_is_that_of_the_mesh_at_rest(tmp_path, monkeypatch):
    quick_assets.quicken(monkeypatch)
    high, rig = character()
    found = []
    for is_posed in (False, True):
        if is_posed:
            bend(rig)
            high.data.shape_keys.key_blocks["smile"].value = 0.5
            bpy.context.view_layer.update()
        (report,) = made([high], Wanted(triangles=150))
        low = bpy.data.objects[report.low]
        image = bpy.data.images[report.image]
        found.append((points(low), np.array(image.pixels)))
        assert low.vertex_groups.keys() == ["root", "tip"] and low.modifiers[0].object == rig
        assert low.data.shape_keys.key_blocks["smile"].value == 0.5 * is_posed
        assert not [text for text in report.warnings if "pose" in text]
        if not is_posed:
            bpy.data.objects.remove(low)
            bpy.data.images.remove(image)
    assert all(np.array_equal(rest, posed) for rest, posed in zip(*found, strict=True))
    far = np.linalg.norm(evaluated(low)[:, None] - evaluated(high), axis=2).min(axis=1)
    assert far.max() < 0.2 and np.abs(evaluated(low) - in_world(low)).max() > 0.5
    (done,) = engine_files.export_files(bpy.context, [[report]], tmp_path / "head.glb")
    tree, _ = glb.parse(tmp_path / "head.glb")
    assert {tree["nodes"][joint]["name"] for joint in tree["skins"][0]["joints"]} >= {"root", "tip"}
    assert tree["meshes"][0]["extras"]["targetNames"] == ["smile"]


@pytest.mark.slow
@pytest.mark.usefixtures("gpu_context")
def test_levels_have_the_skin_of_a_low_mesh_that_is_there(monkeypatch):
    quick_assets.quicken(monkeypatch)
    high, rig = character()
    low = zoo.ball("Head_low", 8)
    low.data.transform(Matrix.Translation((0.0, 0.0, 2.0)))
    scenes.weigh(low, "tip", 1.0)
    arm(low, rig)
    add_key(low, "frown", points(low) * [1.0, 1.5, 1.0])
    bend(rig)
    make, motions = LayoutSource.make, []
    monkeypatch.setattr(LayoutSource, "make", lambda self, count: motions.append(self.motions) or make(self, count))
    reports = made([high], Wanted(triangles=200, levels=1), low=low)
    assert [each.shape for each in motions] == [(len(bent_poses.AXES), len(points(low)), 3, 4)]
    level = bpy.data.objects[reports[1].low]
    assert level.vertex_groups.keys() == ["tip"] and (weights(level, "tip") == 1.0).all()
    assert level.data.shape_keys.key_blocks.keys() == ["Rest", "frown"]
    assert weights(low, "tip").min() == 1.0 and len(low.modifiers) == 1
    assert reports[0].appearance["mean"] < 10.0  # both were at rest


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("steps", [2, 5])
def test_an_asset_that_is_stopped_leaves_pose_and_keys(steps):
    high, rig = character()
    bend(rig)
    high.data.shape_keys.key_blocks["smile"].value = 0.5
    before = snapshot()
    work = asset.work(bpy.context, Job(high, [high]), Wanted(triangles=100), SETTINGS, Pace(0.0), suffixes=Suffixes())
    for _ in range(steps):
        next(work)
    assert rig.data.pose_position == "REST"
    work.close()
    assert rig.data.pose_position == "POSE" and not high.data.shape_keys.key_blocks["smile"].mute
    assert difference(before, snapshot()) == {}


@pytest.mark.usefixtures("gpu_context")
def test_levels_of_detail_have_skin_and_keys_and_stay_in_their_place():
    original, rig = rod("Rod", 12, 12), armature()
    tip = points(original)[:, 2] / 4.0
    scenes.weigh(original, "root", 1.0 - tip)
    scenes.weigh(original, "tip", tip)
    arm(original, rig)
    add_key(original, "wide", points(original) * [2.0, 1.0, 1.0], value=1.0)
    bend(rig)
    report = finish(lod.work(bpy.context, original, limits("", "", "50%"), SETTINGS, Pace()))
    level = bpy.data.objects[report.levels[0].name]
    assert np.abs(points(level)[:, 0]).max() < 1.01  # at rest, without the key
    places = points(level)
    np.testing.assert_allclose(np.maximum(weights(level, "tip"), 0.0), places[:, 2] / 4.0, atol=2e-4)
    np.testing.assert_allclose(key_points(level, "wide"), places * [2.0, 1.0, 1.0], atol=1e-5)
    assert level.data.shape_keys.key_blocks["wide"].value == 1.0 and level.modifiers[0].object == rig
    lod.put_beside(bpy.context, report)
    assert level.matrix_world == original.matrix_world


@pytest.mark.slow
@pytest.mark.usefixtures("registered", "gpu_context")
def test_a_bake_of_an_asset_at_rest_would_be_the_same(monkeypatch):
    """Armatures move points by rounding, also at rest: the bake of the asset has seen the same."""
    quick_assets.quicken(monkeypatch)
    high, _ = character()
    (report,) = made([high], Wanted(triangles=150))
    low = bpy.data.objects[report.low]
    object_pairs.remember([report])
    then = part_state.kept(low)
    settings = SETTINGS.stored(connect_maps=True).traced(method="CAST")
    now = finish(part_state.look(bpy.context, Job(low, [high]), settings, then=then))
    assert part_state.changes(then, now) == []


@pytest.mark.parametrize("is_turned", [False, True])
def test_poses_move_levels_in_their_own_space(is_turned):
    dice = np.random.default_rng(3)
    to_world, origin, points = np.eye(4), dice.normal(size=3), dice.normal(size=(5, 3))
    to_world[:3] = dice.normal(size=(3, 4)) if is_turned else np.eye(3, 4)
    motions = dice.normal(size=(2, 5, 3, 4))
    source = LayoutSource(SimpleNamespace(to_world=to_world), None, 0.0)

    def moved(by, places):
        return np.einsum("pvij,vj->pvi", by[..., :3], places) + by[..., 3]

    in_world = transformed(points, to_world) - origin
    own = moved(source.posed(motions, origin).motions, points)
    assert transformed(own, to_world) - origin == pytest.approx(moved(motions, in_world))
