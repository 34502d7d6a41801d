# SPDX-License-Identifier: GPL-3.0-or-later
"""Undo and Redo of bakes to files: files and images are those of the step, in any order."""

import random
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.output import file_history
from addon.ui import results_panel
from addon.ui.held_files import held_files
from tests.support import maps, panel_layout, zoo
from tests.support.panel import select, use
from tests.ui.test_modal import Button, bake_operators, tiny  # noqa: F401

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def folder(tmp_path):
    """A folder for maps, and a pair of which the window bakes a normal map into it."""
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=1.0)
    use(low, high, size=16, method="FLATTEN", storage="FILE", output=str(tmp_path / "lo.png"))
    select(low)
    bpy.ops.ed.undo_push(message="before")
    held_files.is_on = True
    yield tmp_path
    held_files.is_on = False
    held_files.forget()


def tilt(slope):
    """Give the high object another slope, and bake: the map has one color, which is returned."""
    points = bpy.data.objects["hi"].data.vertices
    for point in points:
        point.co.z = slope * point.co.x
    bpy.ops.ed.undo_push(message="tilted")
    assert bpy.ops.imprint.bake("EXEC_DEFAULT", True) == {"FINISHED"}
    return shown()


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def shown():
    """The texels of each image, as Blender has them."""
    return {image.name: maps.pixels(image).tobytes() for image in bpy.data.images if image.size[0]}


def test_a_bake_that_is_undone_leaves_no_file_and_redo_brings_it_back(folder):
    before, images = tilt(1.0), shown()
    files = contents(folder)
    assert [*files] == ["lo.png"]
    bpy.ops.ed.undo()
    assert contents(folder) == {}
    assert "lo_normal" not in bpy.data.images
    bpy.ops.ed.redo()
    assert contents(folder) == files
    assert shown() == images == before
    assert held_files.told == []


def test_undo_brings_back_the_file_that_was_there(folder):
    (folder / "lo.png").write_bytes(b"of another program")
    tilt(1.0)
    bpy.ops.ed.undo()
    assert contents(folder) == {"lo.png": b"of another program"}


@pytest.mark.parametrize("seed", range(30))
def test_files_and_images_are_those_of_the_step_in_any_order(folder, seed):
    chance, at = random.Random(seed), 0
    states = [(contents(folder), shown())]
    for number in range(12):
        if chance.random() < 0.5:
            tilt(0.1 * number)
            states[at + 1 :] = [(contents(folder), shown())] * 2  # the slope is a step of its own
            states[at + 1] = states[at]
            at += 2
        elif (is_undo := chance.random() < 0.6) and at:
            bpy.ops.ed.undo()
            at -= 1
        elif not is_undo and at + 1 < len(states):
            bpy.ops.ed.redo()
            at += 1
        assert (contents(folder), shown()) == states[at], number
    assert held_files.told == []


def test_all_tiles_and_levels_of_a_bake_go_and_come(folder):
    low = bpy.data.objects["lo"]
    low.data.uv_layers[0].data.foreach_set("uv", np.float32([[0, 0], [2, 0], [2, 1], [0, 1]]).ravel())
    output = str(folder / "new" / "lo.<UDIM>.png")
    use(output=output, udim=True, method="CAST", mip_files=True, maps={"AO"}, rays=4)
    tilt(1.0)
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*.*")}
    assert {"new/lo.1001.png", "new/lo.1002.png", "new/lo_mip1.1001.png", "new/lo_ao.1002.png"} <= files
    first = {path: path.read_bytes() for path in folder.rglob("*.*")}
    tilt(0.5)
    assert all(path.read_bytes() != first[path] for path in first if "ao" not in path.name and "mip4" not in path.name)
    second = maps.pixels(bpy.data.images["lo_normal"])
    bpy.ops.ed.undo()
    assert {path: path.read_bytes() for path in folder.rglob("*.*")} == first
    assert not np.array_equal(maps.pixels(bpy.data.images["lo_normal"]), second)
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert list(folder.rglob("*")) == []


def test_exports_of_levels_go_and_come(folder):
    low = zoo.terrain("ground", n=12)
    select(low)
    use(output=str(folder / "{low}.png"), export=str(folder / "out" / "ground.glb"), level_triangles="40, 20")
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.imprint.make_levels("EXEC_DEFAULT", True) == {"FINISHED"}
    files = {path: path.read_bytes() for path in folder.rglob("*.*")}
    assert {path.suffix for path in files} == {".png", ".glb"}
    bpy.ops.ed.undo()
    assert list(folder.iterdir()) == []
    bpy.ops.ed.redo()
    assert {path: path.read_bytes() for path in folder.rglob("*.*")} == files


def test_what_was_changed_since_stays_and_is_told(folder, monkeypatch):
    told = []
    monkeypatch.setattr("addon.ui.held_files._telling", type("", (), {"start": lambda: told.append(held_files.told)}))
    tilt(1.0)
    tilt(0.5)
    (folder / "lo.png").write_bytes(b"painted")
    bpy.ops.ed.undo()
    assert contents(folder) == {"lo.png": b"painted"}
    assert told == [["Left alone, since changed or deleted after the bake: 'lo.png'."]]
    assert told[0][0] in panel_layout.draw(panels=[results_panel.IMPRINT_PT_results]).text
    bpy.ops.ed.redo()
    tilt(1.0)
    assert held_files.told == []


def test_other_steps_change_no_file(folder):
    tilt(1.0)
    files = contents(folder)
    for _ in range(3):
        bpy.context.object.location.x += 1.0
        bpy.ops.ed.undo_push(message="moved")
    for _ in range(3):
        bpy.ops.ed.undo()
        assert contents(folder) == files
    bpy.ops.ed.undo()
    assert contents(folder) == {}


@pytest.mark.parametrize("way", ["first", "again", "winding", "over itself"])
def test_files_that_a_saved_blend_shows_stay(folder, monkeypatch, way):
    """Also where the bake is undone and Blender closed without another save."""
    told = []
    monkeypatch.setattr("addon.ui.held_files._telling", type("", (), {"start": lambda: told.append(held_files.told)}))
    saved = str(folder / "a.blend")
    if way != "first":
        bpy.ops.wm.save_as_mainfile(filepath=saved)
    tilt(1.0)
    baked, shows = tilt(0.5), contents(folder)
    if way == "again":
        bpy.ops.wm.save_mainfile()
    else:
        winding = str(folder / ".." / folder.name / "a.blend")
        bpy.ops.wm.save_as_mainfile(filepath=winding if way == "winding" else saved, copy=way == "over itself")
    shows |= contents(folder)
    for _ in range(4):
        bpy.ops.ed.undo()
        assert contents(folder).items() >= shows.items()
    sentence = "Left alone, since the .blend was saved after the bake: 'lo.png'."
    assert told == [[sentence], [sentence]]
    assert sentence in panel_layout.draw(panels=[results_panel.IMPRINT_PT_results]).text
    bpy.ops.wm.open_mainfile(filepath=saved)
    assert contents(folder).items() >= shows.items()
    assert shown() == baked


def test_a_bake_after_a_save_goes_back_to_what_was_saved(folder):
    tilt(1.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "a.blend"))
    saved, images = contents(folder), shown()
    tilt(0.5)
    bpy.ops.ed.undo()
    assert (contents(folder), shown(), held_files.told) == (saved, images, [])
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    tilt(0.25)
    bpy.ops.ed.undo()
    assert contents(folder) == saved


@pytest.mark.parametrize("has_path", [False, True])
def test_a_saved_copy_is_no_save(folder, tmp_path_factory, has_path):
    """The queue bakes from such copies."""
    elsewhere = tmp_path_factory.mktemp("copy")
    if has_path:
        bpy.ops.wm.save_as_mainfile(filepath=str(elsewhere / "a.blend"))
    tilt(1.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(elsewhere / "b.blend"), copy=True)
    bpy.ops.ed.undo()
    assert (contents(folder), held_files.told) == ({}, [])


def test_a_bake_of_another_object_after_undo_leaves_what_was_saved(folder):
    """Also when the file is closed then, whatever step its scenes are at."""
    tilt(1.0)
    path = str(folder / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    saved = contents(folder)
    bpy.ops.ed.undo()
    use(output=str(folder / "other.png"))
    tilt(0.5)
    assert contents(folder).items() >= saved.items()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert contents(folder).items() >= saved.items()


def test_an_export_is_no_step(folder):
    tilt(1.0)
    assert bpy.ops.imprint.export(filepath=str(folder / "lo.glb")) == {"FINISHED"}
    bpy.context.object.location.x += 1.0
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert {path.name for path in folder.iterdir()} == {"lo.png", "lo.glb"}


def test_a_scene_that_is_deleted_takes_no_file_along(folder):
    tilt(1.0)
    old = bpy.context.scene
    bpy.context.window.scene = bpy.data.scenes.new("other")
    bpy.data.scenes.remove(old)
    bpy.ops.ed.undo_push(message="removed")
    bpy.ops.object.empty_add()
    bpy.ops.ed.undo_push(message="added")
    bpy.ops.ed.undo()
    assert [*contents(folder)] == ["lo.png"]
    bpy.ops.ed.undo()
    assert [*contents(folder)] == ["lo.png"]
    bpy.ops.ed.undo()
    assert contents(folder) == {}


def test_a_packed_image_keeps_its_own_content(folder):
    tilt(1.0)
    bpy.data.images["lo_normal"].pack()
    packed = maps.pixels(bpy.data.images["lo_normal"])
    tilt(0.25)
    painted = contents(folder)["lo.png"]
    bpy.ops.ed.undo()
    (folder / "lo.png").write_bytes(painted)
    tilt(0.5)
    bpy.ops.ed.undo()
    assert contents(folder) == {"lo.png": painted}
    np.testing.assert_array_equal(maps.pixels(bpy.data.images["lo_normal"]), packed)
    assert bpy.data.images["lo_normal"].packed_files


def test_each_image_of_a_file_shows_what_is_in_it(folder):
    tilt(1.0)
    other = bpy.data.images.load(str(folder / "lo.png"), check_existing=False)
    other.use_fake_user = True
    first = maps.pixels(other)
    bpy.ops.ed.undo_push(message="loaded")
    tilt(0.5)
    other = bpy.data.images["lo.png"]
    other.reload()
    assert not np.array_equal(maps.pixels(other), first)
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(maps.pixels(bpy.data.images["lo.png"]), first)


def test_a_bake_that_fails_leaves_the_redo_steps(folder):
    tilt(1.0)
    files = contents(folder)
    bpy.ops.ed.undo()
    with pytest.raises(RuntimeError):
        bpy.ops.imprint.bake(low="lo", high=[{"name": "nobody"}])
    bpy.ops.ed.redo()
    assert contents(folder) == files


class UndoneButton(Button):
    bl_options = {"UNDO"}  # noqa: RUF012


@pytest.mark.usefixtures("tiny")
def test_a_bake_by_the_button_is_a_step_and_esc_ends_it(folder):
    bpy.context.scene.imprint.show_result = False
    button = UndoneButton(bake_operators.IMPRINT_OT_bake)
    button.press()
    assert button.run() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="baked")
    files = contents(folder)
    bpy.ops.ed.undo()
    assert contents(folder) == {}
    bpy.ops.ed.redo()
    assert contents(folder) == files
    tilt(0.5)
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert contents(folder) == files
    bpy.ops.ed.redo()
    button = UndoneButton(bake_operators.IMPRINT_OT_bake)
    button.press()
    button.event()
    assert button.event("ESC") == {"CANCELLED"}
    assert contents(folder) == files
    bpy.ops.ed.redo()
    assert held_files.told == []
    assert contents(folder) != files


def kept():
    return [path for path in Path(bpy.app.tempdir).glob("imprint-*/*") if path.is_file()]


@pytest.mark.parametrize("way", ["another file", "switched off"])
def test_nothing_is_kept_for_another_file(folder, way):
    tilt(1.0)
    tilt(0.5)
    assert len(kept()) == 1
    if way == "another file":
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "a.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(folder / "a.blend"))
    else:
        held_files.forget()
    assert kept() == []
    files = contents(folder)
    held_files.put_back()
    assert contents(folder) == files


def test_bakes_in_the_background_keep_nothing(folder):
    held_files.is_on = False
    tilt(1.0)
    tilt(0.5)
    files = contents(folder)
    bpy.ops.ed.undo()
    assert kept() == []
    assert contents(folder) == files


def test_what_is_not_kept_is_told(folder, monkeypatch):
    tilt(1.0)
    monkeypatch.setattr(file_history, "MOST_KEPT", 1)
    tilt(0.5)
    files = contents(folder)
    bpy.ops.ed.undo()
    assert held_files.told == ["Not brought back, since the old content was not kept: 'lo.png'."]
    assert contents(folder) == files
