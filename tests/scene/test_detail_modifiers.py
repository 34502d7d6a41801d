# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests a selected low object without others: it is its own high object, and no map of other objects changes."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_pair
from addon.scene import object_checks
from addon.ui import bake_panel, object_pairs
from addon.ui.properties import Chosen
from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

WITHOUT_DETAIL = (
    "TRIANGULATE",
    "WEIGHTED_NORMAL",
    "EDGE_SPLIT",
    "ARMATURE",
    "UV_WARP",
    "MIRROR",
    "SOLIDIFY",
    "SHRINKWRAP",
    "DATA_TRANSFER",
    "DECIMATE",
    "SMOOTH",
)
WITH_DETAIL = ("SUBSURF", "DISPLACE", "BEVEL", "REMESH", "WAVE")


@pytest.fixture
def low():
    """The only selected object, with a map from a high object that still exists, as from an earlier session."""
    low, high = zoo.plane("lo", 2), zoo.terrain("hi")
    settings = bpy.context.scene.imprint
    settings.width = settings.height = 16
    bake_pair(bpy.context, low, [high], settings.to_settings())
    high.select_set(False)
    low.select_set(True)
    bpy.context.view_layer.objects.active = low
    return low


def map_of_low():
    return maps.pixels(bpy.data.images["lo_normal"])


def auto_smooth(obj):
    assert bpy.ops.object.shade_auto_smooth() == {"FINISHED"}
    assert obj.modifiers[0].type == "NODES"


def nodes(obj, *kinds, nested=False):
    """Add geometry nodes of these kinds to `obj`. nested: inside a group."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for kind in kinds:
        tree.nodes.new(kind)
    obj.modifiers.new("Nodes", "NODES").node_group = tree
    if nested:
        outer = bpy.data.node_groups.new("Outer", "GeometryNodeTree")
        outer.nodes.new("GeometryNodeGroup").node_tree = tree
        obj.modifiers["Nodes"].node_group = outer


@pytest.mark.parametrize("kind", WITHOUT_DETAIL)
@pytest.mark.parametrize("from_slot", [False, True], ids=["selected", "slot"])
def test_modifiers_without_detail_do_not_overwrite_a_map(low, kind, from_slot):
    low.modifiers.new("Some name", kind)
    settings, before = bpy.context.scene.imprint, map_of_low()
    if from_slot:
        settings.low = low
        settings.highs.add().object = low
    with pytest.raises(RuntimeError, match="holds a map of 'hi'") as refused:
        bpy.ops.imprint.bake()
    np.testing.assert_array_equal(map_of_low(), before)
    assert bake_panel.bake_problem(bpy.context, settings.chosen(bpy.context)) in str(refused.value)


@pytest.mark.parametrize(
    "kind", sorted({*WITHOUT_DETAIL} - {"MIRROR", "SOLIDIFY", "UV_WARP", "SHRINKWRAP", "SMOOTH", "DECIMATE"})
)
def test_the_high_object_of_the_last_bake_is_used_instead(low, kind):
    assert bpy.ops.imprint.bake(low="lo", high=[{"name": "hi"}]) == {"FINISHED"}
    before = map_of_low()
    low.modifiers.new("Some name", kind)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    np.testing.assert_allclose(map_of_low(), before, atol=0.02)
    assert np.ptp(map_of_low()[..., 0]) > 0.1


def test_auto_smooth_adds_no_detail(low):
    auto_smooth(low)
    assert object_checks.own_highs(low) == []


@pytest.mark.parametrize("nested", [False, True], ids=["plain", "nested"])
def test_the_nodes_of_a_modifier_decide(low, nested):
    nodes(low, "GeometryNodeSetMaterial", "GeometryNodeInputPosition", nested=nested)
    assert object_checks.own_highs(low) == []
    low.modifiers.clear()
    nodes(low, "GeometryNodeSetMaterial", "GeometryNodeSetPosition", nested=nested)
    assert object_checks.own_highs(low) == [low]
    low.modifiers["Nodes"].node_group = None
    assert object_checks.own_highs(low) == []


def test_a_group_inside_itself_is_read_once():
    obj, tree = zoo.plane(), bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    other = bpy.data.node_groups.new("Other", "GeometryNodeTree")
    obj.modifiers.new("Nodes", "NODES").node_group = tree
    for outer, inner in ((tree, other), (other, other)):
        outer.nodes.new("GeometryNodeGroup").node_tree = inner
    assert object_checks.own_highs(obj) == []


@pytest.mark.parametrize("kind", WITH_DETAIL)
@pytest.mark.parametrize("other", ["TRIANGULATE", "ARMATURE"])
def test_one_modifier_with_detail_is_enough(low, kind, other):
    low.modifiers.new("Other", other)
    low.modifiers.new("Detail", kind)
    assert object_checks.own_highs(low) == [low]
    low.modifiers["Detail"].show_viewport = low.modifiers["Detail"].show_render = False
    assert object_checks.own_highs(low) == []


def test_subdivision_and_triangulate_bake_onto_their_base(low):
    bump = low.modifiers.new("Bump", "DISPLACE")
    low.vertex_groups.new(name="middle").add([4], 1.0, "REPLACE")
    bump.vertex_group = "middle"
    low.modifiers.new("Finer", "SUBSURF").render_levels = 2
    low.modifiers.new("Triangles", "TRIANGULATE")
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert np.ptp(map_of_low()[..., 0]) > 0.1


# A flat map


def report(*objects, image="map", **settings):
    low, *highs = objects
    values = {"width": 16, "height": 16, "image": image, "storage": "MEMORY", "material": False, **settings}
    return bake_pair(bpy.context, low, highs, Settings(**values))


def flat(warnings):
    return [warning for warning in warnings if warning.startswith("The map is flat")]


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize("depth", [8, 32])
def test_a_flat_map_gives_a_warning(method, depth):
    (warning,) = flat(report(zoo.plane("lo"), zoo.plane("hi", 4), method=method, depth=depth).warnings)
    assert "'hi'" in warning
    assert "'lo'" in warning


def test_without_a_normal_map_none_is_called_flat():
    assert not flat(report(zoo.plane("lo"), zoo.plane("hi", 4), normal=False, maps=("COVERAGE",)).warnings)


def test_modifiers_without_effect_give_a_warning(low):
    low.modifiers.new("Lift", "DISPLACE").strength = 0.0
    (warning,) = flat(report(low, low).warnings)
    assert "neither modifiers nor materials of 'lo'" in warning


def test_a_map_of_modifiers_is_kept_once_they_are_gone(low):
    """The detail of modifiers that were removed cannot be baked again."""
    low.modifiers.new("Detail", "MULTIRES")
    pair = low.imprint
    object_pairs.remember_objects(low, [low], None, report(low, low).settings, {})
    assert pair.found() == [low]
    low.modifiers.clear()
    assert pair.found() == []
    object_pairs.remember_objects(low, [low], None, report(low, low).settings, {})
    assert pair.found() == [low]


@pytest.mark.parametrize("green", ["+Y", "-Y"])
def test_a_map_with_detail_is_not_flat(green):
    assert not flat(report(zoo.plane("lo"), zoo.terrain("hi"), green=green).warnings)
    assert not flat(report(zoo.plane("lo"), zoo.plane("hi", slope=0.005), green=green).warnings)


def test_a_map_of_one_normal_is_flat_only_in_tangent_space():
    assert not flat(report(zoo.plane("lo"), zoo.plane("hi"), space="OBJECT").warnings)


def test_maps_that_share_an_image_are_checked_in_the_same_way():
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=1.0)  # its normals have a z of 0.7, more than one half
    settings = Settings(method="FLATTEN", width=16, height=16, storage="MEMORY", material=False)
    (shared,) = bake_all(bpy.context, [Job(low, [high])], settings, share_image=True)
    assert not flat(shared.warnings)
    (shared,) = bake_all(bpy.context, [Job(low, [zoo.plane("flat")])], settings, share_image=True)
    assert flat(shared.warnings)


# A map from another high object


def replaced(warnings):
    return [warning for warning in warnings if "replaced" in warning]


def test_replacing_a_map_of_another_high_object_gives_a_warning():
    low, first, second = zoo.plane("lo"), zoo.terrain("first"), zoo.terrain("second", height=0.05)
    assert not replaced(report(low, first).warnings)
    assert not replaced(report(low, first).warnings)
    assert not replaced(report(low, first, second).warnings)  # the map of the same object, with one more
    assert not replaced(report(low, second).warnings)
    (warning,) = replaced(report(low, first).warnings)
    assert "'map'" in warning
    assert "'second'" in warning
    assert "'first'" in warning


def test_replacing_a_painted_image_gives_no_warning():
    bpy.data.images.new("map", 16, 16)
    assert not replaced(report(zoo.plane("lo"), zoo.terrain("hi")).warnings)


def test_the_panel_names_the_high_object_of_the_map_to_replace(low):
    settings, other = bpy.context.scene.imprint, zoo.terrain("other")
    assert "which holds" not in bake_panel.describe_bake(Chosen(settings, low, [bpy.data.objects["hi"]]))
    line = bake_panel.describe_bake(Chosen(settings, low, [other]))
    assert line.endswith("over the image 'lo_normal', which holds a map of 'hi'.")
    low.modifiers.new("Finer", "SUBSURF")
    assert "holds a map of 'hi'" in bake_panel.describe_bake(settings.chosen(bpy.context))
