# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that a bake changes only an image and a material: not modes, selection or visibility."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.scene import mesh_reader
from tests.support import maps, scenes, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

MODES = ["EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT"]
SLOPE = 1.0
"""Of the planes below: 45 degrees, so that their normal differs from all others."""
SLOPED = np.array([0.5 - 0.5 * np.sqrt(0.5), 0.5, 0.5 + 0.5 * np.sqrt(0.5)])
"""Its texel in object space."""
ROUNDING = 1e-6
"""The error of single precision."""


@pytest.fixture
def pair():
    return zoo.plane("lo"), zoo.plane("hi", 4)


def bake_without_trace(low, *highs, **settings):
    """The texels of a bake that must not change anything but its image."""
    before = snapshot(without=("images",))
    texels = maps.bake(low, *highs, **{"size": (16, 16)} | settings)
    assert difference(before, snapshot(without=("images",))) == {}
    return texels


def enter(mode, *objects):
    """Select only these objects, make the first active, and enter a mode."""
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    for obj in objects:
        obj.select_set(True)
    bpy.context.view_layer.objects.active = objects[0]
    bpy.ops.object.mode_set(mode=mode)
    assert objects[0].mode == mode


def lean(obj):
    """Give a plane in Edit Mode a slope: an edit that is not in its mesh yet."""
    mesh = bmesh.from_edit_mesh(obj.data)
    for vertex in mesh.verts:
        vertex.co.z = SLOPE * vertex.co.x
    bmesh.update_edit_mesh(obj.data)


def is_sloped(texels):
    return np.allclose(texels[..., :3], SLOPED, rtol=0, atol=ROUNDING)


# Modes


@pytest.mark.parametrize("name", ["lo", "hi"])
@pytest.mark.parametrize("mode", MODES)
def test_the_mode_is_restored(pair, mode, name):
    enter(mode, bpy.data.objects[name])
    bake_without_trace(*pair)


@pytest.mark.parametrize("hide", ["hide_viewport", "hide_set"])
@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_a_hidden_object_may_be_in_a_mode(pair, mode, hide):
    low, high = pair
    enter(mode, high)
    high.hide_set(True) if hide == "hide_set" else setattr(high, hide, True)
    bake_without_trace(low, high)


def test_edits_are_baked_while_in_edit_mode(pair):
    low, high = pair
    enter("EDIT", high)
    lean(high)
    assert is_sloped(bake_without_trace(low, high, space="OBJECT"))


def test_edits_on_another_object_with_the_same_mesh_are_baked(pair):
    low, high = pair
    twin = high.copy()
    bpy.context.collection.objects.link(twin)
    enter("EDIT", twin)
    lean(twin)
    assert is_sloped(bake_without_trace(low, high, space="OBJECT"))


def test_edits_of_a_mesh_that_is_its_own_low_object_are_baked():
    obj = zoo.plane("own", 4)
    obj.modifiers.new("Rounded", "SUBSURF")
    twin = obj.copy()
    bpy.context.collection.objects.link(twin)
    enter("EDIT", twin)
    lean(twin)
    assert is_sloped(bake_without_trace(obj, obj, space="OBJECT"))


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_a_hidden_object_with_the_same_mesh_leaves_its_mode_and_returns(mode):
    obj = zoo.plane("own", 4)
    obj.modifiers.new("Rounded", "SUBSURF")
    twin = obj.copy()
    bpy.context.collection.objects.link(twin)
    enter(mode, twin)
    twin.hide_viewport = True
    bake_without_trace(obj, obj)


def test_edits_are_baked_if_another_object_is_active(pair):
    low, high = pair
    enter("EDIT", high)
    lean(high)
    bpy.context.view_layer.objects.active = low
    assert is_sloped(bake_without_trace(low, high, space="OBJECT"))


def test_a_modifier_hidden_in_edit_mode_is_baked(pair):
    low, high = pair
    displace = high.modifiers.new("Lift", "DISPLACE")
    displace.direction, displace.texture_coords = "Z", "LOCAL"
    displace.show_in_editmode = False
    displace.vertex_group = high.vertex_groups.new(name="right").name
    high.vertex_groups["right"].add([v.index for v in high.data.vertices if v.co.x > 0.1], 1.0, "REPLACE")
    expected = maps.bake(low, high)
    assert np.ptp(expected[..., 0]) > 0.1
    enter("EDIT", high)
    np.testing.assert_array_equal(bake_without_trace(low, high, size=(64, 64)), expected)


def test_other_objects_keep_their_modes(pair):
    low, high = pair
    bystander, selected = zoo.cube("bystander"), zoo.cube("selected")
    enter("EDIT", bystander, high)
    bystander.select_set(False)
    selected.select_set(True)
    assert (bystander.mode, high.mode, selected.mode) == ("EDIT", "EDIT", "OBJECT")
    bake_without_trace(low, high)


def test_edits_of_others_are_not_lost(pair):
    low, high = pair
    bystander = zoo.plane("bystander")
    enter("EDIT", bystander, high)
    lean(bystander)
    bake_without_trace(low, high)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bystander.data.vertices[-1].co.z == SLOPE


def test_a_file_saved_in_edit_mode(pair, tmp_path):
    """Without a window, its UV layers have no elements until Edit Mode is left."""
    low, high = pair
    enter("EDIT", low, high)
    lean(high)
    path = str(tmp_path / "editing.blend")
    scenes.save(path)
    bpy.ops.wm.open_mainfile(filepath=path)
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    assert low.mode == high.mode == "EDIT"
    assert len(low.data.uv_layers[0].uv) == 0  # otherwise this tests nothing
    assert is_sloped(bake_without_trace(low, high, space="OBJECT"))


# Visibility


def in_collection(obj):
    collection = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(collection)
    bpy.context.scene.collection.objects.unlink(obj)
    collection.objects.link(obj)
    return collection


HIDDEN = {
    "by the eye": lambda obj: obj.hide_set(True),
    "in viewports": lambda obj: setattr(obj, "hide_viewport", True),
    "in viewports and by the eye": lambda obj: (obj.hide_set(True), setattr(obj, "hide_viewport", True)),
    "in renders": lambda obj: setattr(obj, "hide_render", True),
    "from selection": lambda obj: setattr(obj, "hide_select", True),
    "with its collection in renders": lambda obj: setattr(in_collection(obj), "hide_render", True),
}


@pytest.mark.parametrize("name", ["lo", "hi"])
@pytest.mark.parametrize("way", HIDDEN)
def test_hidden_objects_are_baked_and_stay_hidden(way, name):
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=SLOPE)
    obj = bpy.data.objects[name]
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    HIDDEN[way](obj)
    bpy.context.view_layer.update()
    assert is_sloped(bake_without_trace(low, high, space="OBJECT"))


def test_a_linked_hidden_high_object_is_baked(tmp_path):
    zoo.plane("hi", slope=SLOPE).hide_viewport = True
    path = str(tmp_path / "library.blend")
    scenes.save(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    low, namesake = zoo.plane("lo"), zoo.plane("hi")
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["hi"]
    (high,) = wanted.objects
    bpy.context.scene.collection.objects.link(high)
    assert high.name == namesake.name
    assert is_sloped(bake_without_trace(low, high, space="OBJECT"))
    assert not is_sloped(bake_without_trace(low, namesake, space="OBJECT"))


# Modifiers


@pytest.mark.parametrize(("modifiers", "level"), [("RENDER", 3), ("VIEWPORT", 1)])
@pytest.mark.parametrize("kind", ["SUBSURF", "MULTIRES"])
def test_modifiers_are_baked_at_the_chosen_levels_and_keep_theirs(pair, kind, modifiers, level):
    low, high = pair
    modifier = high.modifiers.new("Detail", kind)
    if kind == "MULTIRES":
        bpy.context.view_layer.objects.active = high
        for _ in range(3):
            bpy.ops.object.multires_subdivide(modifier="Detail")
        modifier.sculpt_levels = 2
    modifier.levels, modifier.render_levels = 1, 3
    before = snapshot(without=("images",))
    report = bake_pair(bpy.context, low, [high], Settings(width=16, height=16, modifiers=modifiers, material=False))
    assert report.triangles["high"] == 2 * 16 * 4**level
    assert difference(before, snapshot(without=("images",))) == {}


@pytest.mark.parametrize(("modifiers", "counts"), [("RENDER", True), ("VIEWPORT", False)])
def test_modifiers_are_baked_if_they_are_enabled_for_rendering_or_the_viewport(pair, modifiers, counts):
    low, high = pair
    array = high.modifiers.new("Row", "ARRAY")
    array.show_viewport, array.show_render = False, True
    before = snapshot(without=("images",))
    report = bake_pair(bpy.context, low, [high], Settings(width=16, height=16, modifiers=modifiers, material=False))
    assert report.triangles["high"] == 2 * 16 * (2 if counts else 1)
    assert difference(before, snapshot(without=("images",))) == {}


# Data


@pytest.mark.parametrize("storage", ["PACK", "MEMORY", "FILE"])
def test_a_bake_makes_one_image_and_one_material(pair, storage, tmp_path):
    low, high = pair
    made = ("images", "materials")
    disc = zoo.disc("n-gon")  # triangulated in a temporary mesh
    for obj in (low, disc):
        before, images = snapshot(without=made), set(bpy.data.images)
        settings = Settings(width=16, height=16, storage=storage, output=str(tmp_path / f"{obj.name}.png"))
        report = bake_pair(bpy.context, obj, [high], settings)
        changed = difference(before, snapshot(without=made))
        assert list(changed) == [("object", obj.name)]  # whose material it is
        assert obj.active_material.name == obj.name
        assert set(bpy.data.images) - images == {bpy.data.images[report.image]}


def test_reading_does_not_change_meshes(pair):
    low, high = pair
    low.data.uv_layers.new(name="Second")
    low.data.uv_layers["Second"].active_render = True
    low.data.uv_layers.active = low.data.uv_layers[0]
    before = snapshot(without=("images",))
    maps.bake(low, high, uv_layer="Second")
    assert difference(before, snapshot(without=("images",))) == {}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_while_reading_changes_nothing(pair, monkeypatch, error):
    def fail(*_, **__):
        raise error

    low, high = pair
    low.modifiers.new("Rounded", "SUBSURF").levels = 0
    enter("EDIT", low)
    low.hide_viewport = True
    before = snapshot()
    monkeypatch.setattr(mesh_reader, "surface", fail)
    with pytest.raises(error):
        bake_pair(bpy.context, low, [low], Settings(width=16, height=16))
    assert difference(before, snapshot()) == {}
