# SPDX-License-Identifier: GPL-3.0-or-later
"""While a view is drawn in place of high objects, these are out of the viewport; then all is as it was."""

import bpy
import pytest

import addon
from addon.scene import visibility
from addon.ui.live.live_controller import live
from addon.ui.viewport.object_hiding import hiding
from addon.ui.viewport.view_mode import viewer
from addon.views import view_shading
from tests.support import zoo
from tests.ui.test_view_mode import seen, view, viewport

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
    bpy.context.view_layer.update()  # before that, Blender selects nothing new
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    bpy.context.view_layer.update()


def chosen():
    return {obj.name for obj in bpy.context.view_layer.objects.selected}


def isolate(*objects):
    """The artist's own local view of `objects`, or out of it."""
    choose(*objects)
    toggle()


def toggle():
    with bpy.context.temp_override(**viewport()):
        bpy.ops.view3d.localview(frame_selected=False)
    bpy.context.view_layer.update()


def shown():
    """What the viewport shows, once it was drawn and what it asked for was done."""
    seen()
    if hiding.timer.is_running:
        hiding.timer.stop()
        hiding.catch_up()
    bpy.context.view_layer.update()
    return in_view()


def in_view():
    layer = bpy.context.view_layer
    return {obj.name for obj in layer.objects if obj.visible_get(view_layer=layer, viewport=space())}


@pytest.mark.parametrize("mode", ["MAP", "SPLIT", "DEVIATION", "BARE_DEVIATION"])
def test_the_high_object_is_out_of_a_view_and_comes_back(mode, pair):
    view().mode = mode
    assert shown() == {"lo", "other"}
    assert (chosen(), pair[1].hide_get()) == ({"other"}, False)
    view().mode = "OFF"
    bpy.context.view_layer.update()
    assert in_view() == {"lo", "hi", "other"}
    assert (space().local_view, chosen(), hiding.is_off) == (None, {"other"}, True)


def test_nothing_need_be_selected(pair):
    choose()
    for obj in bpy.context.view_layer.objects:
        obj.hide_select = obj.name != "hi"
    view().mode = "MAP"
    assert shown() == {"lo", "other"}
    assert chosen() == set()
    viewer.off()
    assert (space().local_view, chosen()) == (None, set())


def test_where_nothing_can_be_selected_the_viewport_stays_as_it_is(pair):
    for obj in bpy.context.view_layer.objects:
        obj.hide_select = True
    view().mode = "MAP"
    assert "hi" in shown()
    assert space().local_view is None
    assert not hiding.timer.is_running


def test_a_local_view_of_the_artists_own_stays(pair):
    isolate(*pair)
    view().mode = "MAP"
    assert shown() == {"lo", "hi"}
    viewer.off()
    bpy.context.view_layer.update()
    assert space().local_view is not None
    assert in_view() == {"lo", "hi"}
    assert hiding.is_off
    toggle()


def test_who_leaves_the_local_view_sees_all(pair):
    view().mode = "MAP"
    shown()
    toggle()
    assert "hi" in shown()
    isolate(pair[1])  # and may have one of their own
    assert shown() == {"hi"}
    viewer.off()
    bpy.context.view_layer.update()
    assert in_view() == {"hi"}
    toggle()


def test_strokes_need_the_object_in_view(pair):
    view().mode = "MAP"
    assert "hi" not in shown()
    bpy.context.view_layer.objects.active = pair[1]
    pair[1].select_set(True)
    bpy.ops.object.mode_set(mode="SCULPT")
    assert "hi" in shown()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert "hi" not in shown()


def test_undo_to_before_it_and_back_changes_nothing(pair):
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


def test_redo_to_before_it_changes_nothing(pair):
    for step in (1.0, 2.0):
        pair[0].location.x = step
        bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    view().mode = "MAP"
    shown()
    bpy.ops.ed.redo()
    assert shown() == {"lo", "other"}


def test_another_view_layer_is_asked_for_too(pair):
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


def test_a_file_is_saved_without_it(pair, tmp_path):
    view().mode = "MAP"
    shown()
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    assert shown() == {"lo", "other"}
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    assert (space().local_view, in_view()) == (None, {"lo", "hi", "other"})


def test_what_comes_later_is_seen_and_what_is_gone_does_no_harm(pair):
    view().mode = "MAP"
    shown()
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("later", None))
    assert shown() == {"lo", "other", "later"}
    bpy.data.objects.remove(pair[1])
    assert shown() == {"lo", "other", "later"}
    viewer.off()
    assert (space().local_view, hiding.is_off) == (None, True)


def test_where_the_low_object_is_not_seen_all_is(pair):
    view().mode = "MAP"
    shown()
    pair[0].hide_set(True)
    assert shown() == {"hi", "other"}
    assert space().local_view is None
    pair[0].hide_set(False)
    assert shown() == {"lo", "other"}


def test_an_object_that_is_its_own_high_one_stays(pair):
    pair[0].modifiers.new("Subdivision", "SUBSURF").levels = 2
    bpy.context.scene.imprint.highs[0].object = pair[0]
    view().mode = "MAP"
    assert shown() == {"lo", "hi", "other"}
    assert space().local_view is None


def test_the_panel_in_that_viewport_still_knows_the_high_object(pair):
    bpy.context.scene.imprint.highs.clear()
    bpy.context.view_layer.objects.active = pair[0]
    choose(*pair)
    view().mode = "MAP"
    shown()
    with bpy.context.temp_override(**viewport()):
        assert bpy.context.scene.imprint.chosen_objects(bpy.context) == (pair[0], [pair[1]])
        assert visibility.is_visible(pair[1])
        assert bpy.ops.imprint.view_refresh() == {"FINISHED"}
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        bpy.context.scene.imprint.highs.clear()
        assert bpy.ops.imprint.use_selection() == {"FINISHED"}
    assert [slot.object for slot in bpy.context.scene.imprint.highs] == [pair[1]]
    pair[1].hide_set(True)
    assert not visibility.is_visible(pair[1])


@pytest.mark.parametrize("leave", ["file", "extension"])
def test_it_ends_with_the_file_and_with_the_extension(leave, pair):
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


def test_another_editor_in_its_place_goes_back_too(pair):
    view().mode = "MAP"
    shown()
    place, taken = viewport(), space()
    place["area"].type = "IMAGE_EDITOR"
    viewer.off()
    assert place["area"].type == "IMAGE_EDITOR"
    place["area"].type = "VIEW_3D"
    assert (space(), space().local_view) == (taken, None)


def test_the_low_object_is_pulled_over_high_ones_only_where_they_are_in_view(pair, monkeypatch):
    told = []
    draw = view_shading.Shading.draw
    monkeypatch.setattr(
        view_shading.Shading, "draw", lambda *args, **kw: told.append(kw["is_alone"]) or draw(*args, **kw)
    )
    view().mode = "MAP"
    shown()
    shown()
    bpy.context.view_layer.objects.active = pair[1]
    bpy.ops.object.mode_set(mode="SCULPT")
    shown()
    shown()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert told == [False, True, True, False]
