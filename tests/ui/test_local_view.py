# SPDX-License-Identifier: GPL-3.0-or-later
"""While a view is drawn in place of high objects, they are hidden in the viewport. Afterwards they are visible again."""

import bpy
import pytest

import addon
from addon.scene import evaluation
from addon.ui import view_shading
from addon.ui.live import live
from addon.ui.local_view import hiding
from addon.ui.views import viewer
from tests.support import zoo
from tests.ui.test_view_mode import drawn_pixels, view, viewport

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")


@pytest.fixture
def pair():
    """A low terrain and a high one, in the slots, and another object that is selected."""
    low, high = zoo.terrains_in_slots("FLATTEN")
    choose(zoo.terrain("other", n=2))
    yield low, high
    live.stop()
    viewer.off()


def space():
    return viewport()["area"].spaces.active


def choose(*objects):
    bpy.context.view_layer.update()  # without this, Blender selects no new object
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    bpy.context.view_layer.update()


def chosen():
    return {obj.name for obj in bpy.context.view_layer.objects.selected}


def isolate(*objects):
    """Enter the user's own Local View of `objects`, or leave it."""
    choose(*objects)
    toggle()


def toggle():
    with bpy.context.temp_override(**viewport()):
        bpy.ops.view3d.localview(frame_selected=False)
    bpy.context.view_layer.update()


def shown():
    """The objects in the viewport, after it was drawn and its request was done."""
    drawn_pixels()
    if hiding.timer.is_running:
        hiding.timer.stop()
        hiding.catch_up()
    bpy.context.view_layer.update()
    return in_view()


def in_view():
    layer = bpy.context.view_layer
    return {obj.name for obj in layer.objects if obj.visible_get(view_layer=layer, viewport=space())}


@pytest.mark.parametrize("mode", ["MAP", "SPLIT", "DEVIATION", "BARE_DEVIATION"])
def test_the_high_object_is_hidden_during_a_view(mode, pair):
    view().mode = mode
    assert shown() == {"lo", "other"}
    assert (chosen(), pair[1].hide_get()) == ({"other"}, False)
    view().mode = "OFF"
    bpy.context.view_layer.update()
    assert in_view() == {"lo", "hi", "other"}
    assert (space().local_view, chosen(), hiding.is_off) == (None, {"other"}, True)


def test_hiding_works_without_a_selection(pair):
    choose()
    for obj in bpy.context.view_layer.objects:
        obj.hide_select = obj.name != "hi"
    view().mode = "MAP"
    assert shown() == {"lo", "other"}
    assert chosen() == set()
    viewer.off()
    assert (space().local_view, chosen()) == (None, set())


def test_the_viewport_does_not_change_if_nothing_can_be_selected(pair):
    for obj in bpy.context.view_layer.objects:
        obj.hide_select = True
    view().mode = "MAP"
    assert "hi" in shown()
    assert space().local_view is None
    assert not hiding.timer.is_running


def test_a_local_view_of_the_user_stays(pair):
    isolate(*pair)
    view().mode = "MAP"
    assert shown() == {"lo", "hi"}
    viewer.off()
    bpy.context.view_layer.update()
    assert space().local_view is not None
    assert in_view() == {"lo", "hi"}
    assert hiding.is_off
    toggle()


def test_leaving_local_view_shows_all_objects(pair):
    view().mode = "MAP"
    shown()
    toggle()
    assert "hi" in shown()
    isolate(pair[1])  # and they may then enter Local View themselves
    assert shown() == {"hi"}
    viewer.off()
    bpy.context.view_layer.update()
    assert in_view() == {"hi"}
    toggle()


def test_an_object_in_sculpt_mode_stays_visible(pair):
    view().mode = "MAP"
    assert "hi" not in shown()
    bpy.context.view_layer.objects.active = pair[1]
    pair[1].select_set(True)
    bpy.ops.object.mode_set(mode="SCULPT")
    assert "hi" in shown()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert "hi" not in shown()


def test_undo_and_redo_across_hiding_change_nothing(pair):
    bpy.ops.ed.undo_push(message="before")
    view().mode = "MAP"
    shown()
    for step in (1.0, 2.0):
        pair[0].location.x = step
        bpy.ops.ed.undo_push(message="moved")
    for undo in (bpy.ops.ed.undo, bpy.ops.ed.undo, bpy.ops.ed.redo, bpy.ops.ed.undo):
        undo()
        assert shown() == {"lo", "other"}
    assert chosen() == {"other"}
    viewer.off()
    for undo in (bpy.ops.ed.redo, bpy.ops.ed.redo, bpy.ops.ed.undo):
        undo()
        bpy.context.view_layer.update()
        assert (space().local_view, in_view()) == (None, {"lo", "hi", "other"})


def test_redo_before_hiding_changes_nothing(pair):
    for step in (1.0, 2.0):
        pair[0].location.x = step
        bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    view().mode = "MAP"
    shown()
    bpy.ops.ed.redo()
    assert shown() == {"lo", "other"}


def test_hiding_works_in_another_view_layer(pair):
    view().mode = "MAP"
    shown()
    window, layers = viewport()["window"], bpy.context.scene.view_layers
    before, window.view_layer = window.view_layer, layers.new("another")
    assert shown() == {"lo", "other"}
    viewer.off()
    bpy.context.view_layer.update()
    assert in_view() == {"lo", "hi", "other"}
    window.view_layer = before
    bpy.context.view_layer.update()
    assert in_view() == {"lo", "hi", "other"}


def test_a_saved_file_has_no_hidden_objects(pair, tmp_path):
    view().mode = "MAP"
    shown()
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    assert shown() == {"lo", "other"}
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    assert (space().local_view, in_view()) == (None, {"lo", "hi", "other"})


def test_new_objects_are_visible_and_deleted_ones_do_no_harm(pair):
    view().mode = "MAP"
    shown()
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("later", None))
    assert shown() == {"lo", "other", "later"}
    bpy.data.objects.remove(pair[1])
    assert shown() == {"lo", "other", "later"}
    viewer.off()
    assert (space().local_view, hiding.is_off) == (None, True)


def test_all_objects_are_visible_where_the_low_object_is_not(pair):
    view().mode = "MAP"
    shown()
    pair[0].hide_set(True)
    assert shown() == {"hi", "other"}
    assert space().local_view is None
    pair[0].hide_set(False)
    assert shown() == {"lo", "other"}


def test_an_object_that_is_its_own_high_object_stays(pair):
    pair[0].modifiers.new("Subdivision", "SUBSURF").levels = 2
    bpy.context.scene.imprint.highs[0].object = pair[0]
    view().mode = "MAP"
    assert shown() == {"lo", "hi", "other"}
    assert space().local_view is None


def test_the_panel_of_that_viewport_still_uses_the_high_object(pair):
    bpy.context.scene.imprint.highs.clear()
    bpy.context.view_layer.objects.active = pair[0]
    choose(*pair)
    view().mode = "MAP"
    shown()
    with bpy.context.temp_override(**viewport()):
        chosen = bpy.context.scene.imprint.chosen(bpy.context)
        assert (chosen.low, chosen.highs) == (pair[0], [pair[1]])
        assert evaluation.is_visible(pair[1])
        assert bpy.ops.imprint.view_refresh() == {"FINISHED"}
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        bpy.context.scene.imprint.highs.clear()
        assert bpy.ops.imprint.use_selection() == {"FINISHED"}
    assert [slot.object for slot in bpy.context.scene.imprint.highs] == [pair[1]]
    pair[1].hide_set(True)
    assert not evaluation.is_visible(pair[1])


@pytest.mark.parametrize("leave", ["file", "extension"])
def test_hiding_ends_with_the_file_and_with_the_extension(leave, pair):
    view().mode = "MAP"
    shown()
    if leave == "file":
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    else:
        addon.unregister()
    try:
        assert (space().local_view, hiding.is_off) == (None, True)
    finally:
        if leave == "extension":
            addon.register()


def test_hiding_ends_in_an_area_with_another_editor(pair):
    view().mode = "MAP"
    shown()
    place, taken = viewport(), space()
    place["area"].type = "IMAGE_EDITOR"
    viewer.off()
    assert place["area"].type == "IMAGE_EDITOR"
    place["area"].type = "VIEW_3D"
    assert (space(), space().local_view) == (taken, None)


def test_the_low_object_is_pulled_over_high_objects_only_where_they_are_visible(pair, monkeypatch):
    drawn = []
    draw = view_shading.Shading.draw
    monkeypatch.setattr(
        view_shading.Shading, "draw", lambda *args, **kw: drawn.append(kw["is_alone"]) or draw(*args, **kw)
    )
    view().mode = "MAP"
    shown()
    shown()
    bpy.context.view_layer.objects.active = pair[1]
    bpy.ops.object.mode_set(mode="SCULPT")
    shown()
    shown()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert drawn == [False, True, True, False]
