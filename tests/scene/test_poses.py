# SPDX-License-Identifier: GPL-3.0-or-later
"""Deformers that one object of a bake has and the other has not are named, if they move it, and are left out on request.

The truth is the map of the same objects after the deformers were taken away by hand.
"""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.jobs import Job, pair_checks
from addon.scene import poses, render_view
from addon.ui.findings import findings
from tests.support import maps, panel_layout, scenes, zoo
from tests.support.panel import select, use
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SETTINGS = scenes.settings(method="CAST", size=16)


def pair(height=0.05):
    """A low plane that bends well and a wavy high one."""
    return zoo.plane("hero_low", 4), zoo.terrain("hero_high", 8, height=height)


def said(low, *highs):
    bpy.context.view_layer.update()
    return poses.notes(bpy.context, low, highs, for_render=True)


def rig(angle=0.4, name="rig"):
    """An armature object with a bone along Y that is turned by an angle in radians."""
    obj = scenes.link(bpy.data.objects.new(name, bpy.data.armatures.new(name)))
    select(obj)
    bpy.ops.object.mode_set(mode="EDIT")
    bone = obj.data.edit_bones.new("head")
    bone.head, bone.tail = (0, 0, 0), (0, 1, 0)
    bpy.ops.object.mode_set(mode="OBJECT")
    turn(obj, angle)
    return obj


def turn(obj, angle):
    obj.pose.bones["head"].rotation_mode = "XYZ"
    obj.pose.bones["head"].rotation_euler = (0.0, angle, angle)


def by_modifier(obj, armature):
    scenes.weigh(obj, "head", 1.0)
    obj.modifiers.new("Armature", "ARMATURE").object = armature


def pose(obj):
    by_modifier(obj, rig())


def parent_to_armature(obj):
    scenes.weigh(obj, "head", 1.0)
    obj.parent, obj.parent_type = rig(), "ARMATURE"


def parent_to_bone(obj):
    armature = rig(0.0)
    bpy.context.view_layer.update()
    obj.parent, obj.parent_type, obj.parent_bone = armature, "BONE", "head"
    bpy.context.view_layer.update()
    matrix = armature.matrix_world @ armature.pose.bones["head"].matrix
    obj.matrix_parent_inverse = (matrix @ matrix.Translation((0, 1, 0))).inverted()
    turn(armature, 0.4)


def constrain_to_bone(obj):
    armature = rig()
    constraint = obj.constraints.new("COPY_TRANSFORMS")
    constraint.target, constraint.subtarget = armature, "head"


def parent_of_parent(obj):
    obj.parent = scenes.link(bpy.data.objects.new("Empty", None))
    parent_to_bone(obj.parent)


def shape_key(obj, value=1.0, far=0.4):
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="smile")
    points = np.empty((len(key.data), 3), np.float32)
    key.data.foreach_get("co", points.ravel())
    points[:, 0] += far * (points[:, 1] > 0)
    key.data.foreach_set("co", points.ravel())
    key.value = value


def lattice(obj, is_moved=True):
    cage = scenes.link(bpy.data.objects.new("cage", bpy.data.lattices.new("cage")))
    cage.scale = (3, 3, 3)
    for point in cage.data.points:
        point.co_deform.x += 0.2 * is_moved * (point.co.y > 0)
    obj.modifiers.new("Lattice", "LATTICE").object = cage


def hook(obj):
    empty = scenes.link(bpy.data.objects.new("Empty", None))
    modifier = obj.modifiers.new("Hook", "HOOK")
    modifier.object = empty
    modifier.vertex_indices_set(range(len(obj.data.vertices) // 2))
    empty.location.x = 0.5


def curve(obj):
    data = bpy.data.curves.new("path", "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new("POLY")
    spline.points.add(3)
    for number, point in enumerate(spline.points):
        point.co = (number - 2.0, 0.3 * number**2, 0.0, 1.0)
    obj.modifiers.new("Curve", "CURVE").object = scenes.link(bpy.data.objects.new("path", data))


def bend(obj, angle=0.8):
    modifier = obj.modifiers.new("Bend", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.angle, modifier.deform_axis = "BEND", angle, "Z"


def cast(obj):
    modifier = obj.modifiers.new("Cast", "CAST")
    modifier.factor = 0.5


def warp(obj):
    modifier = obj.modifiers.new("Warp", "WARP")
    modifier.object_from = scenes.link(bpy.data.objects.new("from", None))
    modifier.object_to = scenes.link(bpy.data.objects.new("to", None))
    modifier.object_to.location.x, modifier.falloff_radius = 0.6, 4.0


def nodes(obj, offset=(0.5, 0.0, 0.0)):
    tree = bpy.data.node_groups.new("move", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    first, last = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    move = tree.nodes.new("GeometryNodeSetPosition")
    move.inputs["Offset"].default_value = offset
    tree.links.new(first.outputs[0], move.inputs["Geometry"])
    tree.links.new(move.outputs[0], last.inputs[0])
    obj.modifiers.new("Nodes", "NODES").node_group = tree


MOVING = [
    pose,
    parent_to_armature,
    parent_to_bone,
    constrain_to_bone,
    parent_of_parent,
    shape_key,
    lattice,
    hook,
    curve,
    bend,
]
MOVING += [cast, warp, nodes]


@pytest.mark.parametrize("which", ["hero_low", "hero_high"])
@pytest.mark.parametrize("move", MOVING, ids=lambda move: move.__name__)
def test_what_moves_one_of_the_two_is_named_and_can_be_left_out(move, which):
    """The map in the rest pose is that without the deformer, to the bit, and the scene is as before."""
    low, high = pair()
    bpy.context.view_layer.update()
    truth = scenes.bake(low, high, method="CAST", size=16)
    wanted = maps.pixels(bpy.data.images[truth.image])
    move(bpy.data.objects[which])
    bpy.context.view_layer.update()
    before = snapshot()
    (sentence,) = said(low, high)
    assert sentence.startswith(f"'{which}' ")
    assert f"'{'hero_high' if which == 'hero_low' else 'hero_low'}'" in sentence
    assert "--rest-pose" in sentence
    assert not difference(before, snapshot())
    posed = scenes.bake(low, high, method="CAST", size=16)
    assert sentence in posed.warnings
    assert not np.array_equal(maps.pixels(bpy.data.images[posed.image]), wanted)
    rest = scenes.bake(low, high, method="CAST", size=16, rest_pose=True)
    assert sentence not in rest.warnings
    assert np.array_equal(maps.pixels(bpy.data.images[rest.image]), wanted)
    assert said(low, high) == [sentence]


def test_sentences():
    low, high = pair()
    other = zoo.terrain("boots_high", 4)
    pose(low)
    (sentence,) = said(low, high, other)
    assert sentence == (
        "'hero_low' is posed by 'rig', 'hero_high', 'boots_high' are not: they do not fit each other; --rest-pose bakes "
        "them without that."
    )
    shape_key(low)
    assert "is posed by 'rig' and 1 more, 'hero_high'" in said(low, high)[0]
    low.modifiers.clear()
    assert said(low, high)[0].startswith("'hero_low' has the shape key 'smile', 'hero_high' does not: ")
    found = pair_checks.look_at_high(bpy.context, Job(low, [high]), SETTINGS).lines(str)
    assert any("'smile'" in line for line in found)


def at_rest(obj):
    by_modifier(obj, rig(0.0))


def switched_to_rest(obj):
    armature = rig()
    armature.data.pose_position = "REST"
    by_modifier(obj, armature)


def without_weights(obj):
    obj.modifiers.new("Armature", "ARMATURE").object = rig()


def without_object(obj):
    obj.modifiers.new("Armature", "ARMATURE")
    obj.modifiers.new("Lattice", "LATTICE")


def key_at_zero(obj):
    shape_key(obj, 0.0)


def key_that_is_muted(obj):
    shape_key(obj)
    obj.data.shape_keys.key_blocks["smile"].mute = True


def key_that_moves_nothing(obj):
    shape_key(obj, 1.0, 0.0)


def key_that_moves_less_than_a_texel(obj):
    shape_key(obj, 1.0, 1e-3)


def lattice_at_rest(obj):
    lattice(obj, is_moved=False)


def not_rendered(obj):
    pose(obj)
    obj.modifiers[0].show_render = False


def nodes_that_move_nothing(obj):
    nodes(obj, (0.0, 0.0, 0.0))


def other_modifiers(obj):
    obj.modifiers.new("Subdivision", "SUBSURF")
    obj.modifiers.new("Displace", "DISPLACE").strength = 0.2
    obj.modifiers.new("Smooth", "SMOOTH")


STILL = [
    at_rest,
    switched_to_rest,
    without_weights,
    without_object,
    key_at_zero,
    key_that_is_muted,
    key_that_moves_nothing,
]
STILL += [key_that_moves_less_than_a_texel, lattice_at_rest, not_rendered, nodes_that_move_nothing, other_modifiers]


@pytest.mark.parametrize("which", ["hero_low", "hero_high"])
@pytest.mark.parametrize("still", STILL, ids=lambda still: still.__name__)
def test_what_moves_nothing_is_not_named(still, which):
    pair()
    still(bpy.data.objects[which])
    assert not said(bpy.data.objects["hero_low"], bpy.data.objects["hero_high"])


def both_by_one_rig(low, high):
    armature = rig()
    by_modifier(low, armature)
    by_modifier(high, armature)


def one_by_weights_one_by_its_bone(low, high):
    armature = rig()
    by_modifier(low, armature)
    high.parent, high.parent_type, high.parent_bone = armature, "BONE", "head"


def both_by_the_same_key(low, high):
    shape_key(low)
    shape_key(high)


def both_bent(low, high):
    bend(low)
    bend(high)


def one_follows_the_other(low, high):
    pose(low)
    modifier = high.modifiers.new("Surface Deform", "SURFACE_DEFORM")
    modifier.target = low
    with bpy.context.temp_override(object=high, active_object=high):
        bpy.ops.object.surfacedeform_bind(modifier="Surface Deform")


def bent_and_modeled_on_it(low, high):
    """The high mesh is bent, and the low one was made to fit that."""
    bend(high)
    bend(low)
    bpy.context.view_layer.update()
    low.data = bpy.data.meshes.new_from_object(low.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    low.modifiers.clear()


def posed_onto_a_posed_sculpt(low, high):
    armature = rig()
    by_modifier(low, armature)
    by_modifier(high, armature)
    bpy.context.view_layer.update()
    high.data = bpy.data.meshes.new_from_object(high.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    high.modifiers.clear()


def detail_in_a_key(low, high):
    high.shape_key_add(name="Basis")
    key = high.shape_key_add(name="pores")
    for point in key.data:
        point.co.z += 0.05 * np.sin(40 * point.co.x)
    key.value = 1.0


def detail_by_nodes(low, high):
    """A mountain on the whole of the high mesh, on a low one that is flat."""
    nodes(high, (0.0, 0.0, 0.5))


ALIKE = [both_by_one_rig, one_by_weights_one_by_its_bone, both_by_the_same_key, both_bent, one_follows_the_other]
ALIKE += [bent_and_modeled_on_it, posed_onto_a_posed_sculpt, detail_in_a_key, detail_by_nodes]


@pytest.mark.parametrize("move", ALIKE, ids=lambda move: move.__name__)
def test_what_fits_is_not_named(move):
    low, high = pair()
    move(low, high)
    assert not said(low, high)


def test_two_values_of_a_key_differ():
    low, high = pair()
    shape_key(low)
    shape_key(high, 0.25)
    assert len(said(low, high)) == 2


def test_own_modifiers_and_other_kinds_of_objects():
    low, _ = pair()
    pose(low)
    assert not said(low, low)
    text = scenes.link(bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT")))
    assert not said(low, text)


def test_a_mesh_that_nodes_cut_is_compared_without_its_faces():
    """The low mesh has fewer vertices than its faces name."""
    low, high = pair()
    nodes(low, (0.0, 0.0, 0.0))
    tree = low.modifiers["Nodes"].node_group
    cut, last = tree.nodes.new("GeometryNodeDeleteGeometry"), tree.nodes["Group Output"]
    index, choose = tree.nodes.new("GeometryNodeInputIndex"), tree.nodes.new("FunctionNodeCompare")
    choose.data_type, choose.operation = "INT", "GREATER_THAN"
    numbers = [socket for socket in choose.inputs if socket.enabled]
    tree.links.new(index.outputs[0], numbers[0])
    numbers[1].default_value = 12
    tree.links.new(choose.outputs[0], cut.inputs["Selection"])
    tree.links.new(last.inputs[0].links[0].from_socket, cut.inputs["Geometry"])
    tree.links.new(cut.outputs[0], last.inputs[0])
    pose(high)
    assert ["'hero_high' is posed by 'rig'" in note for note in said(low, high)] == [True]


def test_nothing_is_copied_while_blender_renders(monkeypatch):
    low, high = pair()
    pose(low)
    monkeypatch.setattr(render_view, "is_busy", lambda: True)
    assert not said(low, high)
    with (
        pytest.raises(BakeError, match="a render or a bake of Blender runs"),
        poses.at_rest(bpy.context, low, [high], for_render=True),
    ):
        pass


def test_the_button_bakes_in_rest_pose():
    """Pressed after a bake that warns: the map becomes that of the objects as they were modeled."""
    low, high = pair()
    use(low, high, size=16, method="CAST", show_result=False)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    truth = maps.pixels(bpy.data.images["hero_low_normal"])
    pose(low)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    wrong = maps.pixels(bpy.data.images["hero_low_normal"])
    assert np.abs(wrong - truth).max() > 0.05
    assert bpy.ops.imprint.fix(kind="REST_POSE") == {"FINISHED"}
    assert bpy.context.scene.imprint.rest_pose
    assert np.array_equal(maps.pixels(bpy.data.images["hero_low_normal"]), truth)
    assert bpy.data.armatures["rig"].pose_position == "POSE"


def test_the_panel_says_it_before_the_bake():
    """It measures soon after it was drawn, and again after a change; with Rest Pose there is nothing to say."""
    low, high = pair()
    panel = use(low, high, size=16, method="CAST")
    armature = rig(0.0)
    by_modifier(low, armature)
    bpy.context.view_layer.update()
    shown = [bpy.context, low, [high], panel.to_settings()]
    assert not findings.pose_notes(*shown)
    findings.look()
    assert not findings.pose_notes(*shown)
    turn(armature, 0.4)
    bpy.context.view_layer.update()
    before, expected = snapshot(), said(low, high)
    assert not findings.pose_notes(*shown)
    findings.look()
    assert not difference(before, snapshot())
    assert findings.pose_notes(*shown) == expected
    drawn = panel_layout.draw(width=2000)
    assert "'hero_low' is posed by 'rig', 'hero_high' is not" in drawn.text
    assert "imprint.fix" in [name for name, _ in drawn.buttons]
    panel.rest_pose = True
    assert not findings.pose_notes(*shown[:-1], panel.to_settings())
    findings.drop()
