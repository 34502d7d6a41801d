# SPDX-License-Identifier: GPL-3.0-or-later
"""The checks in the panel, and the buttons that show where issues are."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.jobs.masks import KINDS, ON_TEXELS
from addon.ui import bake_results, check_panel
from addon.ui.bake_results import results
from tests.support import maps, panel_layout, zoo
from tests.support.panel import area, image_editor, refusal, window
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def baked():
    """A low object of 4 x 4 quads after its bake. No high triangle covers its right half."""
    low, high = zoo.plane("lo", 4), zoo.plane("hi", 4)
    keep_left(high)
    bake("lo", "hi")
    return low, high


LEFT, RIGHT = [0, 1, 4, 5, 8, 9, 12, 13], [2, 3, 6, 7, 10, 11, 14, 15]


def keep_left(high):
    """Move the UVs of the right half off the map."""
    uv = np.array([corner.vector for corner in high.data.uv_layers[0].uv]).reshape(-1, 4, 2)
    uv[uv.mean(axis=1)[:, 0] > 0.5] += (5, 0)
    high.data.uv_layers[0].uv.foreach_set("vector", uv.astype(np.float32).ravel())


def bake(low, high, **settings):
    values = {"method": "FLATTEN", "width": 32, "height": 32, "material": False} | settings
    assert bpy.ops.imprint.bake(low=low, high=[{"name": high}], **values) == {"FINISHED"}


def select(kind="UNCOVERED", **arguments):
    assert bpy.ops.imprint.select_flaws(kind=kind, **arguments) == {"FINISHED"}


def selected(obj):
    """Indices of the polygons, edges and vertices of an object that are selected."""
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    return [
        [e.index for e in elements if e.select] for elements in (obj.data.polygons, obj.data.edges, obj.data.vertices)
    ]


def is_right_half(obj):
    """Whether only the faces, edges and vertices of the right half are selected."""
    faces, edges, vertices = selected(obj)
    right = {vertex.index for vertex in obj.data.vertices if vertex.co.x > -1e-6}
    return (
        faces == RIGHT
        and set(vertices) == right
        and edges == [edge.index for edge in obj.data.edges if set(edge.vertices) <= right]
    )


# Faces


def test_faces_are_selected_in_edit_mode(baked):
    low, high = baked
    bpy.context.tool_settings.mesh_select_mode = (True, False, False)
    high.select_set(True)
    bpy.context.view_layer.objects.active = high
    select()
    assert bpy.context.view_layer.objects.active == low
    assert (low.mode, high.mode) == ("EDIT", "OBJECT")
    assert not high.select_get()
    assert tuple(bpy.context.tool_settings.mesh_select_mode) == (False, False, True)
    assert is_right_half(low)


@pytest.mark.parametrize("editing", ["lo", "hi", "both"])
def test_selection_works_in_edit_mode(baked, editing):
    low, high = baked
    for obj in baked:
        obj.select_set(editing in {obj.name, "both"})
    bpy.context.view_layer.objects.active = low if editing == "lo" else high
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    select()
    assert (low.mode, high.mode) == ("EDIT", "OBJECT")
    assert is_right_half(low)
    select("POLYGONS")
    assert selected(low)[0] == list(range(16))


def test_selection_works_when_another_object_is_in_a_mode(baked):
    low, high = baked
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.view_layer.objects.active = high
    select()
    assert is_right_half(low)


def test_hidden_faces_with_an_issue_are_revealed(baked):
    low, _ = baked
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.hide()
    bpy.ops.object.mode_set(mode="OBJECT")
    select()
    assert is_right_half(low)
    assert [polygon.index for polygon in low.data.polygons if polygon.hide] == LEFT


def test_undo_of_a_selection(baked):
    low, high = baked
    low.data.polygons.foreach_set("select", [True] * 16)
    low.data.polygons[3].hide = True
    bpy.context.view_layer.objects.active = high
    bpy.ops.ed.undo_push(message="before")
    before, chosen = snapshot(), selected(low)
    bpy.ops.imprint.select_flaws("EXEC_DEFAULT", True, kind="UNCOVERED")
    assert is_right_half(bpy.data.objects["lo"])
    for _ in range(2):  # Edit Mode and the selection are undone
        assert bpy.ops.ed.undo() == {"FINISHED"}
    low = bpy.data.objects["lo"]
    assert difference(before, snapshot()) == {}
    assert selected(low) == chosen
    assert [polygon.index for polygon in low.data.polygons if polygon.hide] == [3]
    for _ in range(2):
        assert bpy.ops.ed.redo() == {"FINISHED"}
    assert bpy.data.objects["lo"].mode == "EDIT"
    assert is_right_half(bpy.data.objects["lo"])


def test_undo_of_a_selection_in_edit_mode(baked):
    low, _ = baked
    bpy.context.view_layer.objects.active = low
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.object.mode_set("EXEC_DEFAULT", True, mode="EDIT")
    bpy.ops.mesh.select_all("EXEC_DEFAULT", True, action="SELECT")
    bpy.ops.imprint.select_flaws("EXEC_DEFAULT", True, kind="UNCOVERED")
    for _ in range(2):
        assert bpy.ops.ed.undo() == {"FINISHED"}
    assert bpy.data.objects["lo"].mode == "EDIT"
    assert selected(bpy.data.objects["lo"])[0] == list(range(16))


def out_of_the_scene(low, high):
    bpy.data.scenes.new("other").collection.objects.link(high)
    bpy.context.scene.collection.objects.unlink(high)


def fixed(low, high):
    high.data.uv_layers[0].uv.foreach_set("vector", np.ravel([c.vector for c in low.data.uv_layers[0].uv]))


OBJECTS_GONE = {
    "high gone": (lambda low, high: bpy.data.objects.remove(high), "'hi' was deleted"),
    "out of the scene": (out_of_the_scene, "'hi' is not in scene"),
}
REFUSALS = {
    "hidden": (lambda low, high: low.hide_set(True), "'lo' is hidden"),
    "hidden in viewports": (lambda low, high: setattr(low, "hide_viewport", True), "'lo' is hidden"),
    **OBJECTS_GONE,
    "fixed": (fixed, "No face of 'lo' has this issue: uncovered"),
}


@pytest.mark.parametrize(("make", "reason"), REFUSALS.values(), ids=REFUSALS)
def test_refusals_to_select_have_a_message(baked, make, reason):
    make(*baked)
    assert reason in refusal(bpy.ops.imprint.select_flaws, kind="UNCOVERED")


def test_linked_objects_do_not_change(baked, tmp_path):
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.data.objects["lo"]})
    bpy.data.objects.remove(bpy.data.objects["lo"])
    with bpy.data.libraries.load(path, link=True) as (_, linked_data):
        linked_data.objects = ["lo"]
    bpy.context.scene.collection.objects.link(linked_data.objects[0])
    bake("lo", "hi")
    assert "'lo' is linked" in refusal(bpy.ops.imprint.select_flaws, kind="UNCOVERED")
    assert "'lo' is linked" in refusal(bpy.ops.imprint.add_triangulate)
    assert bpy.ops.imprint.show_mask(kind="UNCOVERED") == {"FINISHED"}


def test_buttons_are_disabled_before_a_bake(baked):
    bpy.data.objects.remove(baked[0])
    for operator in (bpy.ops.imprint.select_flaws, bpy.ops.imprint.show_mask, bpy.ops.imprint.add_triangulate):
        assert not operator.poll()


# Masks


def test_the_mask_is_a_separate_image(baked):
    for _ in range(2):
        assert bpy.ops.imprint.show_mask(kind="UNCOVERED") == {"FINISHED"}
    image = bpy.data.images["lo_normal_uncovered"]
    assert image.packed_file is None
    assert image.colorspace_settings.is_data
    expected = np.zeros((32, 32), bool)
    expected[:, 16:] = True
    np.testing.assert_array_equal(maps.pixels(image)[..., 0], expected)
    assert len(bpy.data.images) == 2


def test_the_mask_follows_the_settings_of_the_bake(baked):
    """It does not follow those of the panel, which may have changed since."""
    bpy.context.scene.imprint.width = 128
    bake("lo", "hi", image="{low} map", height=64)
    bpy.context.scene.imprint.image = "Other"
    bpy.ops.imprint.show_mask(kind="UNCOVERED")
    assert tuple(bpy.data.images["lo map_uncovered"].size) == (32, 64)


def test_an_open_image_editor_shows_the_mask(baked):
    image, other = bpy.data.images["lo_normal"], bpy.data.images.new("other", 4, 4)
    for editors, shows in (
        ([], None),
        ([image_editor(other), image_editor(other)], 0),
        ([image_editor(other), image_editor(image)], 1),  # the other image stays
        ([image_editor(other, use_image_pin=True), image_editor(None)], 1),
        ([image_editor(other, use_image_pin=True)], None),
    ):
        before = [area.spaces.active.image for area in editors]
        windows = [window(area("VIEW_3D")), window(*editors)]
        context = SimpleNamespace(window_manager=SimpleNamespace(windows=windows))
        assert bake_results.show_image(context, image) == (shows is not None)
        after = [image if number == shows else was for number, was in enumerate(before)]
        assert [area.spaces.active.image for area in editors] == after


def test_undo_of_a_mask(baked):
    bpy.ops.ed.undo_push(message="before")
    before = snapshot()
    bpy.ops.imprint.show_mask("EXEC_DEFAULT", True, kind="FAR")
    assert "lo_normal_far" in bpy.data.images
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot()) == {}


@pytest.mark.parametrize(("make", "reason"), OBJECTS_GONE.values(), ids=OBJECTS_GONE)
def test_refusals_to_make_a_mask_have_a_message(baked, make, reason):
    make(*baked)
    assert reason in refusal(bpy.ops.imprint.show_mask, kind="UNCOVERED")


# Triangles


def test_a_modifier_is_added_once(baked):
    low, _ = baked
    bpy.ops.ed.undo_push(message="before")
    before = snapshot()
    bpy.ops.imprint.add_triangulate("EXEC_DEFAULT", True)
    assert [modifier.type for modifier in bpy.data.objects["lo"].modifiers] == ["TRIANGULATE"]
    assert "already has a Triangulate modifier" in refusal(bpy.ops.imprint.add_triangulate)
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot()) == {}


# The panel


def draw(active, width=1000):
    bpy.context.view_layer.objects.active = active
    return panel_layout.draw(width, panels=[check_panel.IMPRINT_PT_checks])


def enabled(drawn):
    """The buttons that can be pressed, with their arguments."""
    both = zip(drawn.buttons, drawn.given, strict=True)
    return [(name, vars(given)) for (name, is_enabled), (_, given) in both if is_enabled]


def test_the_panel_is_hidden_before_a_bake():
    low = zoo.plane("lo")
    assert not check_panel.IMPRINT_PT_checks.poll(SimpleNamespace(scene=bpy.context.scene, active_object=low))


def test_the_panel_shows_an_icon_and_a_number_for_each_check(baked):
    drawn = draw(baked[0])
    rows = dict(zip(drawn.labels[::2], zip(drawn.icons[::2], drawn.labels[1::2], strict=True), strict=True))
    assert len(rows) == len(KINDS)
    assert rows["Uncovered"] == ("ERROR", "50.0%")
    assert rows["Overlapping UVs"] == ("CHECKMARK", "0.0%")
    assert rows["Quads, n-gons"] == ("BLANK1", "16")  # nothing is wrong in Blender
    assert enabled(drawn) == [
        ("imprint.show_mask", {"kind": "UNCOVERED", "low": "lo"}),
        ("imprint.select_flaws", {"kind": "UNCOVERED", "low": "lo"}),
        ("imprint.select_flaws", {"kind": "POLYGONS", "low": "lo"}),
        ("imprint.add_triangulate", {"low": "lo"}),
    ]
    for button, kinds in (("show_mask", ON_TEXELS), ("select_flaws", KINDS)):
        given = [given.kind for name, given in drawn.given if name == f"imprint.{button}"]
        assert sorted(given) == sorted(kind.upper() for kind in kinds)


def test_every_enabled_button_works(baked):
    for name, arguments in enabled(draw(baked[0])):
        assert getattr(bpy.ops.imprint, name.removeprefix("imprint."))(**arguments) == {"FINISHED"}


def test_the_checks_of_the_active_low_object_are_shown():
    for number, name in enumerate(("a", "b")):
        zoo.plane(f"{name}_low", 1 + number)
        zoo.plane(f"{name}_high")
    settings = bpy.context.scene.imprint
    settings.width = settings.height = 16
    settings.method, settings.material = "FLATTEN", False
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    first, second = bpy.data.objects["a_low"], bpy.data.objects["b_low"]
    for active, name, count in ((second, "b_low", 4), (first, "a_low", 1)):
        drawn = draw(active)
        assert drawn.labels[drawn.labels.index("Quads, n-gons") + 1] == str(count)
        assert {given.low for _, given in drawn.given} == {name}
    other = SimpleNamespace(scene=bpy.context.scene, active_object=bpy.data.objects["a_high"])
    assert not check_panel.IMPRINT_PT_checks.poll(other)
    select("POLYGONS", low="b_low")
    assert second.mode == "EDIT"
    assert "Nothing was baked onto 'c'" in refusal(bpy.ops.imprint.select_flaws, kind="POLYGONS", low="c")


def test_checks_of_the_last_successful_bake_stay(baked):
    before = results.named(bpy.context, "lo")
    with pytest.raises(RuntimeError):
        bake("lo", "missing")
    assert results.named(bpy.context, "lo") == before is not None
