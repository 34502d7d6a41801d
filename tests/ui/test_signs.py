# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the signs of parts and sets: which updates mark them, how many looks follow, and what Bake Changed bakes."""

import os
import subprocess
import sys

import bpy
import numpy as np
import pytest

from addon.jobs import part_state
from addon.jobs.part_state import Status
from addon.scene import object_checks
from addon.ui import bake_panel, object_pairs, results_panel, sets, signs
from addon.ui import looks as looks_module
from addon.ui.progress_display import display
from addon.ui.signs import looks
from scripts.imprint import ROOT
from tests.support import panel_layout
from tests.support.panel import select, use
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

NAMES = ("wheel", "door", "lamp")


def pair(name, x):
    """A low cube and a rounder high one, with a material of its own."""
    bpy.ops.mesh.primitive_cube_add(location=(x, 0.0, 0.0))
    low = bpy.context.object
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=6, location=(x, 0.0, 0.0))
    high = bpy.context.object
    low.name, high.name = f"{name}_low", f"{name}_high"
    high.data.materials.append(bpy.data.materials.new(name))
    return low, high


@pytest.fixture
def props():
    """Three pairs by name, a set of them, and nothing selected."""
    lows = [pair(name, 4.0 * number)[0] for number, name in enumerate(NAMES)]
    select(lows[0])
    use(size=32, samples="1", maps={"BASE_COLOR"}, storage="MEMORY")
    one = bpy.context.scene.imprint_sets.add()
    one.name, one.source = "Cart", "NAMES"
    bpy.context.scene.imprint.bakes = "SETS"
    return one


def settle():
    """Do all looks. Returns how many there were."""
    bpy.context.view_layer.update()
    before = looks.count
    show()
    while looks.advance(bpy.context, 10.0):
        pass
    looks.advance(bpy.context, 10.0)  # one more round of what Blender does not report
    while looks.advance(bpy.context, 10.0):
        pass
    return looks.count - before


def show():
    """The signs of all parts of the set, by name, as rows ask for them."""
    one = bpy.context.scene.imprint_sets[0]
    return {low.name.partition("_")[0]: signs.of(bpy.context, low) for low in sets.lows(bpy.context, one)}


def statuses():
    return {name: sign.status for name, sign in show().items()}


def set_sign():
    return signs.of_set(bpy.context, bpy.context.scene.imprint_sets[0])


def waiting():
    return signs.waiting(bpy.context, bpy.context.scene.imprint_sets[0])


def bake(**how):
    assert bpy.ops.imprint.bake_sets(**how) == {"FINISHED"}


def all_are(status):
    return dict.fromkeys(NAMES, status)


def test_parts_are_unknown_never_baked_then_true(props):
    assert statuses() == all_are(Status.UNKNOWN)
    assert waiting() == ""  # nothing was ever baked
    settle()
    assert statuses() == all_are(Status.NEVER)
    assert set_sign().status == Status.NEVER
    bake()
    settle()
    assert statuses() == all_are(Status.TRUE)
    assert set_sign().status == Status.TRUE
    assert waiting() == ""
    looks.mark_all()
    assert waiting() == "Looked at 0 of 3 parts"


def baked():
    bake()
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_one_edit_is_one_look(props):
    baked()
    bpy.data.objects["door_high"].data.vertices[0].co.z += 0.3
    bpy.context.view_layer.update()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.UNKNOWN}
    assert settle() == 1
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}
    assert show()["door"].text == "Changed since the bake: the mesh of 'door_high'"
    assert set_sign().status == Status.CHANGED
    assert settle() == 0


def grow(name, by=0.3):
    bpy.data.objects[f"{name}_high"].data.vertices[0].co.z += by


def test_bake_changed_bakes_these_alone(props, tmp_path):
    use(storage="FILE", output=str(tmp_path / "{low}.png"))
    baked()
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.glob("*.png")}
    assert len(before) == 6
    for name in ("wheel", "lamp"):
        grow(name)
    bake(changed=True)
    after = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.glob("*.png")}
    touched = {name for name in after if after[name] != before[name]}
    assert {name.partition("_")[0] for name in touched} == {"wheel", "lamp"}
    settle()
    assert statuses() == all_are(Status.TRUE)
    bake(changed=True)
    assert {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.glob("*.png")} == after


def test_what_was_baked_stands_before_warnings(props, capsys):
    def told():
        capsys.readouterr()
        bake(changed=True)
        return bpy.context.window_manager.imprint_summary.split("\n"), capsys.readouterr().out.strip().split("\n")

    baked()
    bpy.data.objects["lamp_low"].data.uv_layers[0].uv[0].vector = (0.4, 0.4)  # a warning of the bake
    bpy.data.objects["lamp_low"].data.update_tag()
    lines, reports = told()
    assert lines[0] == "Baked 1 of 3 parts: lamp_low"
    assert reports[-1].startswith("Warning: Baked 1 of 3 parts: lamp_low. 'lamp_")
    lines, reports = told()
    assert lines == ["Nothing has changed: all maps show the scene as it is"]
    assert reports == [f"Info: {lines[0]}"]
    grow("wheel")
    bpy.data.objects["door_low"].imprint_is_baked = False
    lines, reports = told()
    assert lines[0] == "Baked 1 of 2 parts: wheel_low"
    bpy.data.objects["lamp_low"].data.uv_layers.remove(bpy.data.objects["lamp_low"].data.uv_layers[0])
    grow("wheel")
    lines, reports = told()
    assert lines[0] == "Baked 1 of 2 parts: wheel_low"
    assert reports[-1].startswith("Warning: Baked 1 of 2 parts: wheel_low. 'lamp_")


EDITS = {
    "mesh": lambda: grow("door"),
    "move high": lambda: setattr(bpy.data.objects["door_high"].location, "z", 0.2),
    "move low": lambda: setattr(bpy.data.objects["door_low"].location, "z", 0.2),
    "modifier": lambda: bpy.data.objects["door_high"].modifiers.new("Solid", "SOLIDIFY"),
    "material": lambda: setattr(
        bpy.data.materials["door"].node_tree.nodes["Principled BSDF"].inputs["Base Color"],
        "default_value",
        (1.0, 0.0, 0.0, 1.0),
    ),
    "deleted": lambda: bpy.data.objects.remove(bpy.data.objects["door_high"]),
    "size": lambda: setattr(bpy.data.objects["door_low"], "imprint_size", "256"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_marks_the_part_that_reads_it(props, edit):
    baked()
    EDITS[edit]()
    assert settle() == (0 if edit == "deleted" else 1)
    if edit == "deleted":  # two objects that are called alike are the part
        assert "door" not in statuses()
    else:
        assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}


def test_what_is_no_change_for_a_bake_stays_true(props):
    baked()
    bpy.data.objects["door_high"].show_wire = True
    bpy.data.objects["wheel_low"].select_set(False)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("new", None))
    assert settle() == 0
    assert statuses() == all_are(Status.TRUE)


def test_levels_for_renders_are_noticed(props):
    subdivision = bpy.data.objects["door_high"].modifiers.new("Levels", "SUBSURF")
    subdivision.levels = subdivision.render_levels = 1
    baked()
    subdivision.render_levels = 2  # Blender reports nothing
    assert settle() == 1
    assert statuses()["door"] == Status.CHANGED


def test_a_shared_material_marks_all_its_parts(props):
    shared = bpy.data.materials["door"]
    for name in ("wheel", "lamp"):
        bpy.data.objects[f"{name}_high"].material_slots[0].material = shared
    baked()
    shared.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.0, 1.0, 0.0, 1.0)
    assert settle() == 3
    assert statuses() == all_are(Status.CHANGED)


def test_a_setting_of_the_scene_and_back(props):
    baked()
    use(margin=3)
    settle()
    assert statuses() == all_are(Status.CHANGED)
    assert "Margin" in show()["door"].text
    bpy.context.scene.imprint.property_unset("margin")
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_a_set_has_its_own_settings(props):
    baked()
    other = bpy.context.scene.imprint_sets.add()
    other.name, other.source, other.own.width = "Large", "NAMES", 64
    other.own.height = 64
    settle()
    assert set_sign().status == Status.TRUE
    assert signs.of_set(bpy.context, other).status == Status.UNKNOWN
    settle()
    assert signs.of_set(bpy.context, other).status == Status.CHANGED


def test_undo_and_redo(props):
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="made")
    baked()
    bpy.ops.ed.undo_push(message="baked")
    grow("door")
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="edited")
    settle()
    assert statuses()["door"] == Status.CHANGED
    bpy.ops.ed.undo()
    assert statuses() == all_are(Status.UNKNOWN)
    settle()
    assert statuses() == all_are(Status.TRUE)
    grow("lamp")
    settle()
    assert statuses()["lamp"] == Status.CHANGED
    bpy.ops.ed.redo()
    assert statuses() == all_are(Status.UNKNOWN)
    settle()
    assert statuses()["door"] == Status.CHANGED


def test_after_opening_all_is_unknown_then_right(props, tmp_path):
    baked()
    grow("door")
    path = str(tmp_path / "cart.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert statuses() == all_are(Status.UNKNOWN)
    settle()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}


def test_a_part_in_edit_mode_waits(props):
    baked()
    select(bpy.data.objects["door_high"])
    bpy.ops.object.mode_set(mode="EDIT")
    assert settle() == 0
    assert statuses()["door"] == Status.UNKNOWN
    bpy.ops.object.mode_set(mode="OBJECT")
    assert settle() == 1
    assert statuses() == all_are(Status.TRUE)


def test_a_failed_part_stays_failed_until_a_bake_works(props, tmp_path):
    baked()
    layers = bpy.data.objects["door_low"].data.uv_layers
    layers.remove(layers[0])
    bake()
    settle()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.FAILED}
    assert "UV" in show()["door"].text
    assert set_sign().status == Status.FAILED
    bpy.data.objects["door_low"].name = "door_b_low"
    bpy.data.objects["door_high"].name = "door_b_high"
    settle()
    assert statuses()["door"] == Status.FAILED
    bpy.data.objects["door_b_low"].data.uv_layers.new()
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_the_sign_of_a_last_bake_has_its_settings(props):
    baked()
    use(margin=3)
    low = bpy.data.objects["door_low"]
    signs.of_past(bpy.context, low)
    settle()
    assert signs.of_past(bpy.context, low).text == "The maps show the scene as it is"
    grow("door")
    settle()
    assert signs.of_past(bpy.context, low).text == "Changed since the bake: the mesh of 'door_high'"


def test_a_file_that_another_program_writes(props, tmp_path):
    image = bpy.data.images.new("paint", 8, 8)
    image.filepath_raw, image.file_format = str(tmp_path / "paint.png"), "PNG"
    image.save()
    image.source = "FILE"
    tree = bpy.data.materials["door"].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    baked()
    other = bpy.data.images.new("other", 8, 8)
    other.pixels.foreach_set(np.full(256, 0.5, np.float32))
    other.filepath_raw, other.file_format = image.filepath_raw, "PNG"
    other.save()
    assert settle() == 1
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}
    os.remove(image.filepath_raw)
    assert settle() == 1
    assert statuses()["door"] == Status.CHANGED


def test_new_objects_of_a_name_make_a_part(props):
    baked()
    pair("mirror", 20.0)
    assert settle() == 1
    assert statuses() == all_are(Status.TRUE) | {"mirror": Status.NEVER}
    high = bpy.data.objects["mirror_high"]
    other = high.copy()
    other.name = "door_high_bolt"
    bpy.context.scene.collection.objects.link(other)
    settle()
    assert statuses()["door"] == Status.CHANGED


ELSEWHERE = """
import sys
import bpy
import addon
addon.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[-1])
for name in ("wheel", "lamp"):
    bpy.data.objects[f"{name}_high"].data.vertices[0].co.z += 0.3
assert bpy.ops.imprint.bake_sets(name="Cart", changed=True) == {"FINISHED"}
bpy.ops.wm.save_mainfile()
"""


@pytest.mark.parametrize("textures", ["PART", "ONE"])
def test_in_another_process_two_changed_parts_are_baked(props, tmp_path, textures):
    props.textures = textures
    for number, name in enumerate(NAMES):  # side by side in one image
        layer = bpy.data.objects[f"{name}_low"].data.uv_layers.active
        for corner in layer.data:
            corner.uv = ((corner.uv[0] + number) / 3.0, corner.uv[1])
    use(storage="FILE", output="//{low}.png", size=48)
    blend = str(tmp_path / "cart.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    baked()
    bpy.ops.wm.save_mainfile()
    before = {path.name: path.read_bytes() for path in tmp_path.glob("*.png")}
    own = texels_of_part("door", tmp_path) if textures == "ONE" else {}
    subprocess.run([sys.executable, "-c", ELSEWHERE, blend], cwd=ROOT, check=True, capture_output=True)
    after = {path.name: path.read_bytes() for path in tmp_path.glob("*.png")}
    assert after.keys() == before.keys()
    touched = {name for name in after if after[name] != before[name]}
    if textures == "PART":
        assert {name.partition("_")[0] for name in touched} == {"wheel", "lamp"}
    else:
        assert touched
        assert all(np.array_equal(own[name], now) for name, now in texels_of_part("door", tmp_path).items())
    bpy.ops.wm.open_mainfile(filepath=blend)
    settle()
    assert statuses() == all_are(Status.TRUE)


def texels_of_part(name, folder):
    """The columns of a part's own third of each file."""
    start = 16 * NAMES.index(name)
    found = {}
    for path in sorted(folder.glob("*.png")):
        image = bpy.data.images.load(str(path))
        values = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(values)
        found[path.name] = values.reshape(48, 48, 4)[:, start + 2 : start + 14].copy()
        bpy.data.images.remove(image)
    return found


def test_a_rename_is_no_change(props):
    baked()
    for ending in ("low", "high"):
        bpy.data.objects[f"door_{ending}"].name = f"gate_{ending}"
    bpy.data.materials["door"].name = "gate"
    settle()
    assert statuses() == {"wheel": Status.TRUE, "gate": Status.TRUE, "lamp": Status.TRUE}


def test_a_hidden_high_object_is_followed_and_stays_hidden(props):
    baked()
    high = bpy.data.objects["door_high"]
    high.hide_set(True)
    settle()
    assert statuses() == all_are(Status.TRUE)
    grow("door")
    settle()
    assert statuses()["door"] == Status.CHANGED
    assert high.hide_get()


def test_looks_leave_the_file_as_it_is(props):
    bpy.data.objects["door_high"].modifiers.new("Levels", "SUBSURF")  # of which renders see more
    baked()
    bpy.data.objects["lamp_high"].hide_set(True)
    bpy.context.view_layer.update()
    before, told = snapshot(), []
    looks.mark_all()
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: told.append(dict(looks._marked)))
    assert settle() == 3
    bpy.context.view_layer.update()
    assert difference(before, snapshot()) == {}
    assert looks._marked == {}
    bpy.app.handlers.depsgraph_update_post.pop()


def test_the_animation_of_a_high_object(props):
    high = bpy.data.objects["door_high"]
    high.keyframe_insert("location", frame=1)
    high.location.z = 0.5
    high.keyframe_insert("location", frame=10)
    bpy.context.scene.frame_set(1)
    baked()
    bpy.context.scene.frame_set(10)
    settle()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}
    bpy.context.scene.frame_set(1)
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_a_painted_texture(props):
    image = bpy.data.images.new("paint", 8, 8)
    tree = bpy.data.materials["door"].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    image.pack()
    baked()
    image.pixels.foreach_set(np.full(256, 0.25, np.float32))  # Blender reports nothing
    image.update()
    assert settle() == 1
    assert statuses()["door"] == Status.CHANGED


@pytest.mark.parametrize("storage", ["MEMORY", "PACK"])
@pytest.mark.parametrize(
    "edit", [lambda image: setattr(image.colorspace_settings, "name", "Non-Color"), lambda image: image.scale(8, 8)]
)
def test_a_map_of_another_color_space_or_size(props, edit, storage):
    use(storage=storage)
    baked()
    edit(bpy.data.images["door_low_base_color"])
    settle()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}
    assert show()["door"].text == "Changed since the bake: the image 'door_low_base_color' was edited"
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_a_painted_displacement(props):
    """The viewport's mesh does not follow the image, but that of a bake does."""
    image = bpy.data.images.new("paint", 8, 8)
    image.pack()
    texture = bpy.data.textures.new("paint", "IMAGE")
    texture.image = image
    bpy.data.objects["door_high"].modifiers.new("Displace", "DISPLACE").texture = texture
    baked()
    image.pixels.foreach_set(np.full(256, 0.25, np.float32))
    image.update()
    assert settle() == 1
    assert show()["door"].text == "Changed since the bake: the mesh of 'door_high'"
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)
    texture.type = "CLOUDS"  # the viewport follows this, and the look needs no scene of its own
    assert not object_checks.may_differ_in_renders(bpy.data.objects["door_high"], bpy.context.scene)


@pytest.mark.parametrize("gone", ["door_low_normal", "door_low_base_color"])
def test_each_map_of_a_bake_counts(props, gone):
    baked()
    bpy.data.images.remove(bpy.data.images[gone])
    settle()
    assert show()["door"].text == f"Changed since the bake: the image {gone!r} is gone"
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_an_export_is_no_bake(props, tmp_path):
    baked()
    door = bpy.data.objects["door_low"]
    select(door)
    before = door.imprint.baked
    assert bpy.ops.imprint.export(filepath=str(tmp_path / "door.glb")) == {"FINISHED"}
    assert object_pairs.of(door).reports()[0].exported
    assert door.imprint.baked == before
    settle()
    assert statuses() == all_are(Status.TRUE)


@pytest.fixture
def second(props):
    """A set of the door alone, which is a part of the first set too, with images of its own."""
    second = bpy.context.scene.imprint_sets.add()
    second.name, second.source = "Far", "PARTS"
    second.parts.add().object = bpy.data.objects["door_low"]
    second.own.image, second.own.width, second.own.height = "{low}_far", 16, 16
    return second


def of_both(second):
    """The statuses of the door in both sets."""
    found = []
    for number in range(2):
        bpy.context.scene.imprint.active_set = number
        settle()
        found += [signs.of(bpy.context, bpy.data.objects["door_low"]).status]
    return found


@pytest.mark.parametrize("at_once", [True, False])
def test_a_part_of_two_sets(props, second, at_once):
    door = bpy.data.objects["door_low"]
    for number in range(2):
        bpy.context.scene.imprint.active_set = number
        assert at_once or bpy.ops.imprint.bake_sets(name=("Cart", "Far")[number]) == {"FINISHED"}
    if at_once:
        bake()
    assert of_both(second) == [Status.TRUE, Status.TRUE]
    before = door.imprint.baked
    bake(changed=True)
    assert door.imprint.baked == before
    assert signs.of_past(bpy.context, door).status in {Status.TRUE, Status.UNKNOWN}
    settle()
    assert signs.of_past(bpy.context, door).status == Status.TRUE
    grow("door")
    assert of_both(second) == [Status.CHANGED, Status.CHANGED]
    bake(name="Far")
    assert of_both(second) == [Status.CHANGED, Status.TRUE]
    bake(changed=True)
    assert of_both(second) == [Status.TRUE, Status.TRUE]
    bpy.data.images.remove(bpy.data.images["door_low_far"])
    assert of_both(second) == [Status.TRUE, Status.CHANGED]
    assert "is gone" in signs.of(bpy.context, door).text


def test_occluders_are_parts_of_each_other(props):
    use(maps={"AO"}, occluders="ALL", rays=16)
    baked()
    grow("door")
    assert settle() == 3
    assert statuses() == all_are(Status.CHANGED)
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_a_part_that_is_off_is_no_matter_of_the_set(props):
    baked()
    bpy.data.objects["door_low"].imprint_is_baked = False
    bpy.data.objects["door_low"].update_tag()
    grow("door")
    settle()
    assert set_sign().status == Status.TRUE
    before = bpy.data.objects["door_low"].imprint.baked
    bake(changed=True)
    assert bpy.data.objects["door_low"].imprint.baked == before


def test_in_the_window_a_timer_looks_in_slices(props, monkeypatch):
    baked()
    grow("door")
    bpy.context.view_layer.update()
    monkeypatch.setattr(looks_module, "REST", 0.0)
    assert looks.tick() in {looks_module.TICK, looks_module.WATCH}
    assert statuses()["door"] == Status.CHANGED
    monkeypatch.setattr(looks_module, "REST", 60.0)
    grow("door")
    assert looks.tick() == looks_module.TICK
    assert looks._marked
    monkeypatch.setattr(display, "current", object())
    monkeypatch.setattr(looks_module, "REST", 0.0)
    assert looks.tick() == looks_module.WATCH
    assert looks._marked


def test_panels_say_what_has_changed(props):
    baked()
    props.source = "PARTS"
    for name in NAMES:
        props.parts.add().object = bpy.data.objects[f"{name}_low"]
    props.active_part = NAMES.index("door")
    grow("door")
    settle()
    text = panel_layout.draw(panels=[bake_panel.IMPRINT_PT_bake]).text
    assert "Changed since the bake, 1 of 3 parts: 'door_low'" in text
    assert "door_low: Changed since the bake: the mesh of 'door_high'" in text
    select(bpy.data.objects["door_low"])
    panel_layout.draw(panels=[results_panel.IMPRINT_PT_results])  # its rows ask for the last bakes
    assert waiting() == ""  # all parts of the set are known
    settle()
    text = panel_layout.draw(panels=[results_panel.IMPRINT_PT_results]).text
    assert "Changed since the bake: the mesh of 'door_high'" in text


def test_a_change_of_settings_shows_at_once(props):
    baked()
    use(margin=3)
    bpy.context.scene.update_tag()  # as Blender does for a field of a panel
    bpy.context.view_layer.update()
    assert statuses() == all_are(Status.UNKNOWN)


def test_a_part_whose_own_size_changes_is_looked_at_once(props):
    baked()
    low = bpy.data.objects["door_low"]
    low.imprint_size = "256"
    low.update_tag()
    assert settle() == 1
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}


def test_a_deleted_high_object_of_a_part(props):
    baked()
    props.source = "PARTS"
    for name in NAMES:
        props.parts.add().object = bpy.data.objects[f"{name}_low"]
    settle()
    assert statuses() == all_are(Status.TRUE)
    select(bpy.data.objects["door_high"])
    bpy.ops.object.delete()
    assert "door_high" in bpy.data.objects  # the pair keeps it
    bpy.context.view_layer.update()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.UNKNOWN}
    settle()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}
    assert "'door_high'" in show()["door"].text


def test_what_takes_long_waits_for_a_pause(props, monkeypatch):
    baked()
    grow("door")
    bpy.context.view_layer.update()
    monkeypatch.setattr(looks_module, "REST", 0.0)
    monkeypatch.setattr(looks_module, "COSTLY", 0.0)
    assert looks.tick() == looks_module.WATCH
    assert statuses()["door"] == Status.UNKNOWN
    monkeypatch.setattr(looks_module, "LONG_REST", 0.0)
    looks.tick()
    assert statuses()["door"] == Status.CHANGED


def test_what_failed_is_baked_also_if_nothing_has_changed(props):
    baked()
    object_pairs.keep_failure(bpy.data.objects["door_low"], "The disk is full.")
    assert show()["door"].text == "The disk is full."
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)


def test_the_active_set_comes_first_then_what_was_marked_last(props):
    baked()
    other = bpy.context.scene.imprint_sets.add()
    other.name, other.source = "Other", "NAMES"
    signs.of_set(bpy.context, other)
    settle()
    looked, look = [], looks.look
    looks.look = lambda context, part, asked: (
        looked.append((part.of_set, asked.job.low_ref.name)),
        look(context, part, asked),
    )
    try:
        for name in ("lamp", "wheel"):
            grow(name)
            bpy.context.view_layer.update()
        settle()
    finally:
        del looks.look
    own = [("Cart", "wheel_low"), ("Cart", "lamp_low")]
    assert looked == [*own, ("Other", "wheel_low"), ("Other", "lamp_low")]


def test_a_look_that_touches_its_object_is_the_last_one(props):
    """A bake onto the own base mesh keeps a modifier from moving UVs, which Blender reports."""
    select(bpy.data.objects["door_low"])
    bpy.data.objects["door_low"].modifiers.new("Levels", "SUBSURF")
    props.source = "PARTS"
    props.parts.add().object = bpy.data.objects["door_low"]
    bpy.data.objects["door_high"].name = "other"
    use(maps=set())
    bake()  # it gives the object a material, which the next one reads
    bake()
    assert settle() == 1
    assert list(statuses().values()) == [Status.TRUE]
    bpy.data.objects["door_low"].modifiers["Levels"].subdivision_type = "SIMPLE"
    assert settle() == 1
    assert list(statuses().values()) == [Status.CHANGED]


def test_the_scene_shades(props):
    use(maps={"AO"}, occluders="SCENE", rays=16)
    baked()
    bpy.ops.mesh.primitive_cube_add(location=(0.0, 0.0, 9.0))
    cube = bpy.context.object
    assert settle() == 3
    assert statuses() == all_are(Status.CHANGED)
    bake(changed=True)
    assert settle() == 3
    assert statuses() == all_are(Status.TRUE)
    cube.location.z = 5.0
    assert settle() == 3
    assert statuses() == all_are(Status.CHANGED)


def test_a_slice_ends_after_its_time(props):
    baked()
    looks.mark_all()
    before = looks.count
    assert looks.advance(bpy.context, 1e-9)
    assert looks.count - before <= 1


def side_by_side():
    """Give each part a third of the tile."""
    for number, name in enumerate(NAMES):
        for corner in bpy.data.objects[f"{name}_low"].data.uv_layers.active.data:
            corner.uv = ((corner.uv[0] + number) / 3.0, corner.uv[1])


def wear(material):
    for name in NAMES:
        bpy.data.objects[f"{name}_low"].data.materials.append(material)


def rename_set(props):
    props.name = "Coach"


def rename_material(_props):
    bpy.data.materials["Wood"].name = "Oak"


def rename_low(_props):
    bpy.data.objects["door_low"].name, bpy.data.objects["door_high"].name = "gate_low", "gate_high"


SIDES = "the name of the image", "the name of the file"
OTHER_PLACES = {
    "set, one image": ("ONE", "//{low}.png", rename_set, SIDES, NAMES),
    "set, in memory": ("ONE", "", rename_set, SIDES[:1], NAMES),
    "material": ("MATERIAL", "//{material}.png", rename_material, SIDES, NAMES),
    "parts to one": ("PART", "", lambda props: setattr(props, "textures", "ONE"), SIDES[:1], NAMES),
    "one to parts": ("ONE", "", lambda props: setattr(props, "textures", "PART"), SIDES[:1], NAMES),
    "low": ("PART", "//{low}.png", rename_low, SIDES[1:], ["gate"]),
    "name of the low": ("PART", "//{name}.png", rename_low, SIDES[1:], ["gate"]),
}
"""What Textures is, the path of files or none, what is done, the changes, and which parts have them."""


@pytest.mark.parametrize("what", OTHER_PLACES)
def test_a_bake_into_another_image_or_file_is_a_change(props, tmp_path, what):
    props.textures, output, act, changes, changed = OTHER_PLACES[what]
    side_by_side()
    wear(bpy.data.materials.new("Wood"))
    use(storage="FILE" if output else "MEMORY", output=output.replace("//", f"{tmp_path}/"), size=48)
    baked()
    act(props)
    settle()
    said = {name: sign.text for name, sign in show().items() if sign.status == Status.CHANGED}
    assert said == dict.fromkeys(changed, f"Changed since the bake: {', '.join(changes)}")
    bake(changed=True)
    settle()
    assert set(statuses().values()) == {Status.TRUE}


@pytest.mark.parametrize("is_told", [True, False])
def test_an_image_of_a_new_name_has_all_parts(props, tmp_path, monkeypatch, is_told):
    """Also if their signs do not know it."""
    props.textures = "ONE"
    side_by_side()
    use(storage="FILE", output=str(tmp_path / "{low}.png"), size=48)
    baked()
    files, whole = list(tmp_path.glob("*.png")), texels_of_all(tmp_path)
    rename_set(props)
    if not is_told:
        monkeypatch.setattr(looks_module.part_state, "changes", lambda then, now: [])
        object_pairs.keep_failure(bpy.data.objects["door_low"], "It failed.")
    bake(changed=True)
    for path in files:
        path.unlink()
    after = texels_of_all(tmp_path)
    assert len(after) == len(whole) == 6
    for (name, part), texels in whole.items():
        assert np.array_equal(after[name.replace("Cart", "Coach"), part], texels)


def texels_of_all(folder):
    return {(path, part): texels for part in NAMES for path, texels in texels_of_part(part, folder).items()}


def duplicated(*, linked):
    low, high = (bpy.data.objects[f"door_{kind}"] for kind in ("low", "high"))
    select(low, high)
    assert bpy.ops.object.duplicate(linked=linked) == {"FINISHED"}
    copies = {obj.name.partition("_")[2][:3]: obj for obj in bpy.context.selected_objects}
    copies["low"].name, copies["hig"].name = "gate_low", "gate_high"


def copied_by_script():
    for kind in ("low", "high"):
        copy = bpy.data.objects[f"door_{kind}"].copy()
        copy.name = f"gate_{kind}"
        bpy.context.scene.collection.objects.link(copy)


def copied_after_a_rename():
    """The original has lost the name that it was baked with, the copy has not got it."""
    for kind in ("low", "high"):
        bpy.data.objects[f"door_{kind}"].name = f"entry_{kind}"
        copy = bpy.data.objects[f"entry_{kind}"].copy()
        copy.name = f"gate_{kind}"
        bpy.context.scene.collection.objects.link(copy)


@pytest.mark.parametrize(
    "copy",
    [
        lambda: duplicated(linked=False),
        lambda: duplicated(linked=True),
        copied_by_script,
        copied_after_a_rename,
    ],
    ids=["duplicate", "linked duplicate", "script", "renamed original"],
)
def test_a_copy_of_a_part_was_never_baked(props, copy, tmp_path):
    use(storage="FILE", output=str(tmp_path / "{low}.png"))
    baked()
    copy()
    settle()
    name = "entry" if "entry_low" in bpy.data.objects else "door"
    of_original = Status.CHANGED if name == "entry" else Status.TRUE  # its file would have another name
    wanted = {"wheel": Status.TRUE, "lamp": Status.TRUE, name: of_original, "gate": Status.NEVER}
    assert statuses() == wanted
    assert show()["gate"].text == f"Never baked: a copy of '{name}_low'"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "props.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "props.blend"))
    settle()
    assert statuses() == wanted
    grow(name)
    bake(changed=True)
    settle()
    assert set(statuses().values()) == {Status.TRUE}
    assert (tmp_path / "gate_low.png").is_file()
    assert bpy.data.objects["gate_low"].imprint.state != bpy.data.objects[f"{name}_low"].imprint.state


def test_a_copy_does_not_follow_the_next_bake_of_its_original(props):
    baked()
    copied_by_script()
    grow("door")
    bpy.context.scene.imprint_sets[0].source = "PARTS"
    part = bpy.context.scene.imprint_sets[0].parts.add()
    part.object = bpy.data.objects["door_low"]
    bake()
    bpy.context.scene.imprint_sets[0].source = "NAMES"
    settle()
    assert show()["gate"].status == Status.CHANGED
    assert "the image 'door_low_normal' is of another bake" in show()["gate"].text


def test_a_copy_whose_original_is_gone_has_its_maps(props):
    baked()
    copied_by_script()
    for kind in ("low", "high"):
        bpy.data.objects.remove(bpy.data.objects[f"door_{kind}"])
    settle()
    assert {*statuses().items()} == {("wheel", Status.TRUE), ("lamp", Status.TRUE), ("gate", Status.TRUE)}


@pytest.mark.parametrize("how", ["LINK_COPY", "FULL_COPY"])
def test_a_copy_of_the_scene(props, how):
    """In a linked copy the objects are the same ones, in a full copy they have other names, and get images of their own."""
    baked()
    bpy.ops.scene.new(type=how)
    settle()
    wanted = Status.TRUE if how == "LINK_COPY" else Status.NEVER
    assert {*statuses().values()} == {wanted}


def test_an_appended_copy_has_maps_of_its_own(props, tmp_path):
    path = str(tmp_path / "props.blend")
    baked()
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    with bpy.data.libraries.load(path) as (_, here):
        here.objects = ["door_low", "door_high"]
    for obj, name in zip(here.objects, ("gate_low", "gate_high"), strict=True):
        obj.name = name
        bpy.context.scene.collection.objects.link(obj)
    settle()
    assert {*statuses().values()} == {Status.TRUE}
    grow("door")
    bake(changed=True)
    settle()
    assert {*statuses().values()} == {Status.TRUE}
    grow("gate")
    settle()
    assert show()["gate"].status == Status.CHANGED


@pytest.mark.parametrize("storage", ["MEMORY", "PACK", "FILE"])
def test_the_bake_of_a_part_replaces_the_map_of_one_that_had_its_name(props, storage, tmp_path):
    use(storage=storage, output=str(tmp_path / "{low}.png"))
    baked()
    for kind in ("low", "high"):
        door, lamp = (bpy.data.objects[f"{name}_{kind}"] for name in ("door", "lamp"))
        door.name = "kept"
        lamp.name, door.name = f"door_{kind}", f"lamp_{kind}"
    settle()
    of_names = Status.CHANGED if storage == "FILE" else Status.TRUE
    assert statuses() == all_are(of_names) | {"wheel": Status.TRUE}
    grow("door")
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)
    before = texels_of_maps()
    bake()
    assert all(np.array_equal(before[name], texels) for name, texels in texels_of_maps().items())
    if storage == "FILE":
        assert sorted(path.name for path in tmp_path.glob("*_low.png")) == sorted(f"{name}_low.png" for name in NAMES)


def texels_of_maps():
    """The texels of all images of maps that parts show now, by part and image."""
    texels = {}
    for name in NAMES:
        low = bpy.data.objects[f"{name}_low"]
        maps = part_state.kept(low).of_kind("image")
        texels |= {(name, image): np.array(bpy.data.images[image].pixels) for image in maps}
    return texels


MIXED = {
    "scaled by the largest": {"maps": {"HEIGHT", "BASE_COLOR"}},
    "numbered over all": {"maps": {"OBJECT_ID"}},
    "mixed in mip levels": {"maps": {"BASE_COLOR"}, "mip_files": True},
}
"""Maps of which texels of some parts change if those of others do."""


@pytest.mark.parametrize(
    "case", [("ONE", "Wood", NAMES), ("MATERIAL", "Wood", NAMES), ("MATERIAL", "Glass", ("door", "lamp"))]
)
@pytest.mark.parametrize("values", MIXED.values(), ids=MIXED)
def test_all_parts_of_a_map_that_mixes_them_are_baked(props, tmp_path, values, case):
    """Also those that share another image with such a part, and no others.

    case: Textures, the material of the first part, and what is baked.
    """
    props.textures, first, expected = case
    side_by_side()
    for name, materials in zip(NAMES, ([first], ["Wood", "Metal"], ["Metal"]), strict=True):
        low = bpy.data.objects[f"{name}_low"]
        for material in materials:
            low.data.materials.append(bpy.data.materials.get(material) or bpy.data.materials.new(material))
        low.data.polygons[0].material_index = len(materials) - 1
    use(**{"storage": "FILE", "output": str(tmp_path / "{low}.png"), "size": 48, **values})
    baked()
    times = {name: bpy.data.objects[f"{name}_low"].imprint.baked for name in NAMES}
    grow("lamp", 1.5)
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)
    again = {name for name in NAMES if bpy.data.objects[f"{name}_low"].imprint.baked != times[name]}
    assert again == {*expected}
    after = contents(tmp_path)
    bake()
    assert contents(tmp_path) == after


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_part_that_is_off_does_not_lose_its_numbers(props, tmp_path):
    """Bake Changed is refused then."""
    props.textures = "ONE"
    side_by_side()
    use(storage="FILE", output=str(tmp_path / "{low}.png"), size=48, maps={"OBJECT_ID"})
    baked()
    before = contents(tmp_path)
    grow("wheel")
    bpy.data.objects["lamp_low"].imprint_is_baked = False
    with pytest.raises(RuntimeError, match="numbered over all objects"):
        bake(changed=True)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("how", ["deleted", "written"])
def test_a_tile_of_a_map_that_another_program_changes(props, how, tmp_path):
    """What a path with a place for the tile's number stands for is looked at without a press."""
    use(storage="FILE", output=str(tmp_path / "{low}.<UDIM>.png"), udim=True)
    baked()
    path = tmp_path / "door_low.1001.png"
    if how == "deleted":
        path.unlink()
    else:
        path.write_bytes((tmp_path / "door_low_base_color.1001.png").read_bytes())
    settle()
    assert statuses() == all_are(Status.TRUE) | {"door": Status.CHANGED}
    bake(changed=True)
    settle()
    assert statuses() == all_are(Status.TRUE)
