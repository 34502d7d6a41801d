# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the queue: that its process bakes what the window bakes, and what remains of it whatever ends it."""

import json
import os
import signal
import time
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon import older_blender
from addon.core.errors import BakeError
from addon.core.progress import finish
from addon.jobs import part_state
from addon.ui import bake_queue, object_pairs, sets
from addon.ui.bake_queue import Stage, queue
from tests.support import maps
from tests.support.panel import use
from tests.support.snapshot import difference, snapshot
from tests.ui.test_sets import new_set

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 32
PATIENCE = 240.0
"""Seconds for a process to start and to bake on a machine that does other things."""


@pytest.fixture(autouse=True)
def ended():
    """No process stays, nor a copy."""
    yield
    queue.end()
    queue.longest = 0.0


def cube(name, x, size):
    bpy.ops.mesh.primitive_cube_add(location=(x, 0.0, 0.0), size=size)
    bpy.context.object.name = name
    return bpy.context.object


@pytest.fixture
def file(tmp_path):
    """A saved file with three sets: files and nodes of materials, packed images in one for all, and attributes."""
    lows = []
    for number, name in enumerate(("crate", "lid", "lock", "rope")):
        lows.append(cube(f"{name}_low", 4.0 * number, 2.0))
        cube(f"{name}_high", 4.0 * number, 1.9)
    use(size=SIDE, maps={"AO", "POSITION"}, storage="MEMORY", samples="1", rays=16, occluders="OWN", connect_maps=True)
    crate = new_set(lows[0], name="Files")
    crate.own.storage, crate.own.output = "FILE", "//maps/{low}.png"
    both = new_set(lows[1], lows[2], name="Packed", textures="ONE")
    both.own.storage = "PACK"
    rope = new_set(lows[3], name="Memory")
    rope.own.vertex_domain = "POINT"
    path = tmp_path / "props.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def opened(path, folder):
    """The file in another folder, opened."""
    folder.mkdir()
    copy = folder / path.name
    copy.write_bytes(path.read_bytes())
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    return folder


def changed():
    """What signs would tell of each set's parts."""
    found = {}
    for one in bpy.context.scene.imprint_sets:
        set_job = sets.resolve(bpy.context, one)
        for job in set_job.jobs:
            then = part_state.kept(job.low)
            of_set = {"jobs": set_job.jobs, "share_image": set_job.share_image, "shared_name": set_job.name}
            now = finish(part_state.look(bpy.context, job, set_job.settings, then=then, **of_set))
            found[job.low.name] = part_state.changes(then, now) if then else None
    return found


def wait(until=lambda: False):
    """Do what the timer does until nothing is left to do, or `until` returns whether to stop."""
    end = time.monotonic() + PATIENCE
    while queue.tick() is not None and not until():
        assert time.monotonic() < end
        time.sleep(0.02)


def add(*names):
    queue.add(bpy.context, names or [one.name for one in bpy.context.scene.imprint_sets])


def states():
    return {item.name: (item.state, item.sentence) for item in queue.items}


def kept(folder):
    """What bakes have left in the file and in its folder, once it is saved: that packs maps in memory."""
    bpy.ops.wm.save_mainfile()
    lows = [obj for obj in bpy.data.objects if object_pairs.of(obj) is not None]
    reports = {}
    for low in lows:
        values = json.loads(low.imprint.result)
        for each in values:
            for key in ("seconds", "startup", "output"):
                each.pop(key)
        state = {key: value for key, value in part_state.kept(low).pieces.items() if not key.startswith("image:")}
        reports[low.name] = values, [high.title for high in low.imprint.highs], len(low.imprint.maps), state
    files = {str(each.relative_to(folder)): each.read_bytes() for each in folder.rglob("*") if each.is_file()}
    images = {}
    for image in bpy.data.images:
        texels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(texels)
        marks = {
            key: value for key, value in image.items() if key not in {"imprint_map", "imprint_home", "imprint_unpacked"}
        }
        values = tuple(image.size), image.is_float, image.depth, marks, image.colorspace_settings.name
        packed = [each.packed_file.data for each in image.packed_files]
        images[image.name] = values, texels.tobytes(), packed, image.use_fake_user, image.alpha_mode
    return reports, images, {name: data for name, data in files.items() if not name.endswith((".blend", ".blend1"))}


def without(state, *names):
    """A snapshot without what differs between two openings of a file."""
    return {key: _without(value, {"session_uid", *names}) for key, value in state.items()}


def _without(value, names):
    if isinstance(value, dict):
        return {key: _without(each, names) for key, each in value.items() if key not in names}
    return [_without(each, names) for each in value] if isinstance(value, list | tuple) else value


def test_the_queue_bakes_what_the_window_bakes(file, tmp_path):
    here = opened(file, tmp_path / "here")
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    expected, before = kept(here), snapshot()
    there = opened(file, tmp_path / "there")
    add()
    assert bpy.data.is_dirty is False
    wait()
    assert states() == dict.fromkeys(("Files", "Packed", "Memory"), (Stage.DONE, ""))
    found, after = kept(there), snapshot()
    assert found[2].keys() == expected[2].keys()
    assert len(found[2]) == 3
    for part, own in zip(expected, found, strict=True):
        assert own == part
    assert changed() == dict.fromkeys(("crate_low", "lid_low", "lock_low", "rope_low"), [])
    fleeting = "generated_width", "generated_height", "use_generated_float"
    assert difference(without(before, *fleeting), without(after, *fleeting)) == {}


@pytest.mark.parametrize(("is_painted", "depth"), [(False, "8"), (True, "8"), (False, "32")])
def test_a_second_result_is_shown_where_the_first_one_was_looked_at(file, is_painted, depth):
    """In images that are packed and in memory, of one part and of two."""
    use(depth=depth)
    add()
    wait()
    images = [image for image in bpy.data.images if image.source == "FILE" and image.packed_files]
    assert len(images) >= 4
    shown = {image.name: maps.pixels(image) for image in images}
    if is_painted:
        for image in images:
            image.pixels[0] = 0.3
            image.update()
            assert image.is_dirty
    for name in ("lid", "lock", "rope"):
        bpy.data.objects[f"{name}_high"].data.vertices[0].co *= 1.4
    add()
    wait()
    assert {state for state, _ in states().values()} == {Stage.DONE}
    again = {image.name: maps.pixels(image) for image in images}
    assert not [name for name in shown if np.array_equal(shown[name], again[name])]
    assert changed() == dict.fromkeys(("crate_low", "lid_low", "lock_low", "rope_low"), [])
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    for image in images:
        np.testing.assert_allclose(maps.pixels(image), again[image.name], atol=1.1 / 255)


def tokens():
    """What the file has of each image, without what reading it loads."""
    return {image.name: (image.source, image.filepath, image.is_dirty) for image in bpy.data.images}


def test_what_is_newer_stays(file, tmp_path):
    """Files, images and low objects that change while the queue bakes; other sets go on."""
    folder = opened(file, tmp_path / "there")
    image = bpy.data.images.new("rope_low_normal", SIDE, SIDE)
    add()
    painted = np.random.default_rng(7).random(4 * SIDE * SIDE, np.float32)
    image.pixels.foreach_set(painted)
    (folder / "maps").mkdir()
    png = folder / "maps" / "crate_low_ao.png"
    png.write_bytes(b"of another program")
    wait()
    found = states()
    assert found["Files"] == (
        Stage.FAILED,
        f"The file {str(png)!r} was changed meanwhile, and stays: add the set again.",
    )
    why = "The image 'rope_low_normal' was changed meanwhile, and stays: add the set again."
    assert found["Memory"] == (Stage.FAILED, why)
    assert found["Packed"] == (Stage.DONE, "")
    assert png.read_bytes() == b"of another program"
    assert [each.name for each in (folder / "maps").iterdir()] == [png.name]
    texels = np.empty_like(painted)
    image.pixels.foreach_get(texels)
    assert np.abs(texels - painted).max() <= 0.5 / 255.0
    assert "rope_low_ao" not in bpy.data.images
    assert changed() == {"crate_low": None, "lid_low": [], "lock_low": [], "rope_low": None}
    png.unlink()
    bpy.data.images.remove(image)
    add("Files", "Memory")
    wait()
    assert set(states().values()) == {(Stage.DONE, "")}
    assert changed() == dict.fromkeys(("crate_low", "lid_low", "lock_low", "rope_low"), [])


def test_a_low_object_that_is_baked_or_deleted_meanwhile_is_left_alone(file, tmp_path):
    opened(file, tmp_path / "there")
    add()
    assert bpy.ops.imprint.bake_sets(name="Memory") == {"FINISHED"}
    rope = bpy.data.objects["rope_low"]
    before = rope.imprint.baked, rope.imprint.result, tokens()
    bpy.data.objects.remove(bpy.data.objects["lid_low"])
    bpy.data.objects["crate_low"].name = "box"  # it is found all the same
    bpy.data.objects["crate_high"].data.vertices[0].co.x += 0.5
    wait()
    assert states() == {
        "Files": (Stage.DONE, ""),
        "Packed": (Stage.FAILED, "A low object was deleted during the bake, so its maps were left out."),
        "Memory": (Stage.FAILED, "'rope_low' was baked again meanwhile: these newer maps stay."),
    }
    assert (rope.imprint.baked, rope.imprint.result) == before[:2]
    assert tokens().items() >= before[2].items()
    assert changed()["box"] == ["the mesh of 'crate_high'", "the name of the file"]
    assert {image.name for image in bpy.data.images if image.name.startswith(("lid", "lock", "Packed"))} == set()


def test_an_image_that_no_file_has_goes_along(file, tmp_path):
    """A texture of a high object that was painted and not saved is baked as it is."""
    opened(file, tmp_path / "there")
    material = bpy.data.materials.new("painted")
    older_blender.switch_on_nodes(material)
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    tree.links.new(node.outputs["Color"], next(each for each in tree.nodes if each.type == "BSDF_PRINCIPLED").inputs[0])
    node.image = image = bpy.data.images.new("paint", 8, 8)
    image.pixels.foreach_set(np.tile(np.float32([0.2, 0.6, 0.4, 1.0]), 64))
    bpy.data.objects["rope_high"].data.materials.append(material)
    bpy.context.scene.imprint.maps = {"BASE_COLOR"}
    bpy.context.scene.imprint_sets["Memory"].own.storage = "PACK"
    add("Memory")
    assert image.is_dirty
    wait()
    texels = np.empty(4 * SIDE * SIDE, np.float32)
    bpy.data.images["rope_low_base_color"].pixels.foreach_get(texels)
    assert np.unique(np.rint(texels * 255.0).reshape(-1, 4), axis=0).tolist()[-1] == [51, 153, 102, 255]
    assert bpy.ops.imprint.bake_sets(name="Memory") == {"FINISHED"}
    here = np.empty_like(texels)
    bpy.data.images["rope_low_base_color"].pixels.foreach_get(here)
    assert np.array_equal(texels, here)


def test_a_file_that_was_never_saved_and_one_that_is_saved_meanwhile(file, tmp_path):
    use(output="//maps/{low}.png")
    bpy.ops.wm.open_mainfile(filepath=str(file))
    bpy.ops.imprint.bake_sets(name="Memory")  # a map in memory, which saving packs
    add()
    assert bpy.data.images["rope_low_ao"].is_dirty  # the copy packs none of the window
    (tmp_path / "elsewhere").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "elsewhere" / "props.blend"), relative_remap=True)
    wait()
    assert set(states().values()) == {(Stage.DONE, "")}
    assert bpy.path.abspath(bpy.data.images["crate_low_ao"].filepath) == str(tmp_path / "maps" / "crate_low_ao.png")
    bpy.ops.wm.read_homefile(use_empty=True)
    assert queue.items == []
    cube("a_low", 0.0, 2.0), cube("a_high", 0.0, 1.9)
    new_set(bpy.data.objects["a_low"], name="In")
    new_set(bpy.data.objects["a_low"], name="Out")
    use(size=SIDE, storage="MEMORY")
    out = bpy.context.scene.imprint_sets["Out"].own
    out.storage, out.output = "FILE", "//a.png"
    add()
    wait()
    assert states() == {
        "In": (Stage.DONE, ""),
        "Out": (Stage.FAILED, "'//a.png' is relative to a .blend file that was never saved: save it first."),
    }


def test_sets_can_be_canceled_paused_and_added_again_and_fail(file, tmp_path):
    folder = opened(file, tmp_path / "there")
    scene = bpy.context.scene
    new_set(name="Empty")
    slow = new_set(bpy.data.objects["rope_low"], name="Slow").own
    slow.method, slow.samples, slow.width, slow.height, slow.rays = "CAST", "16", 1024, 1024, 256
    slow.image = "slow_{low}"
    assert bpy.ops.imprint.queue_add(name="Slow") == {"FINISHED"}
    assert bpy.ops.imprint.queue_add(all=True) == {"FINISHED"}  # "Slow" is in it, once
    assert [item.name for item in queue.items] == ["Files", "Packed", "Memory", "Empty", "Slow"]
    queue.cancel(scene, "Packed")
    bpy.ops.imprint.queue_pause()
    wait(lambda: queue.tick() is not None and time.sleep(0.1) is None)
    assert bake_queue.state_of(scene, "Files").text == "Paused"
    bpy.ops.imprint.queue_pause()
    wait(lambda: bake_queue.state_of(scene, "Slow").done > 0.01)
    bpy.ops.imprint.queue_pause()
    seen = [0.0, 0.5]
    while seen[-1] != seen[-2]:  # a slice may take long on a machine that does other things
        until = time.monotonic() + 4.0
        wait(lambda: time.monotonic() > until)  # noqa: B023 - it is called now
        seen.append(bake_queue.state_of(scene, "Slow").done)
    assert seen[-1] < 1.0
    assert bake_queue.state_of(scene, "Slow").text == f"Paused at {int(100 * seen[-1])} %"
    bpy.ops.imprint.queue_pause()
    bpy.ops.imprint.queue_cancel(name="Slow")
    wait()
    assert states() == {
        "Files": (Stage.DONE, ""),
        "Packed": (Stage.CANCELED, ""),
        "Memory": (Stage.DONE, ""),
        "Empty": (Stage.FAILED, "The set 'Empty' has no part: add low objects."),
        "Slow": (Stage.CANCELED, ""),
    }
    assert not list(folder.rglob(".imprint*"))
    queue.is_paused = True  # what is paused is over
    add("Memory")
    wait(lambda: bool(processes()))
    assert not queue.is_paused
    bpy.ops.imprint.queue_cancel()
    assert queue.items == []


def processes():
    """The numbers of the processes that the queue has started."""
    found = [queue._process, *(each for each, _ in queue._leaving)]
    return [each._process.pid for each in found if each is not None]


def is_running(number):
    try:
        return Path(f"/proc/{number}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc").exists(), reason="processes of Linux")
def test_a_process_that_is_killed_costs_one_set(file, tmp_path):
    folder = opened(file, tmp_path / "there")
    add()
    wait(lambda: any(item.state is Stage.BAKING for item in queue.items))
    (number,) = processes()
    os.kill(number, signal.SIGKILL)
    wait()
    why = "Blender crashed with signal 9, Killed"
    assert states()["Files"][0] is Stage.FAILED and states()["Files"][1].startswith(why)
    assert [states()[name] for name in ("Packed", "Memory")] == [(Stage.DONE, "")] * 2
    add("Files")
    wait(lambda: bool(processes()))
    (number,) = processes()
    os.kill(number, signal.SIGKILL)
    wait()
    assert states()["Files"][1].startswith("The process to bake in does not start: signal 9")
    add("Files")
    wait(lambda: bool(processes()))
    numbers = processes()
    bpy.ops.wm.read_homefile(use_empty=True)  # another file is opened
    assert not any(map(is_running, numbers))
    assert queue.items == [] and not queue.timer.is_running
    assert not list(folder.rglob(".imprint*"))


@pytest.mark.skipif(not Path("/proc").exists(), reason="processes of Linux")
def test_a_process_that_is_killed_at_its_first_file_leaves_nothing(file, tmp_path):
    """It had no time to tell how far its set is."""
    maps = opened(file, tmp_path / "there") / "maps"
    add("Files")
    wait(lambda: any(item.state is Stage.BAKING for item in queue.items))
    (number,), until = processes(), time.monotonic() + PATIENCE
    while not list(maps.glob(".imprint*")):
        assert time.monotonic() < until
    os.kill(number, signal.SIGKILL)
    wait()
    assert states()["Files"][0] is Stage.FAILED
    assert not list(maps.glob(".imprint*"))


def test_undo_does_not_take_results(file, tmp_path):
    opened(file, tmp_path / "there")
    bpy.ops.ed.undo_push(message="before")
    add()
    wait()
    low = bpy.data.objects["rope_low"]
    baked, before = low.imprint.baked, kept(tmp_path / "there")
    low.location.x += 1.0
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert bpy.data.objects["rope_low"].location.x == 12.0
    again = kept(tmp_path / "there")
    assert again[1] == before[1]
    assert again[0] == before[0]
    assert changed() == dict.fromkeys(("crate_low", "lid_low", "lock_low", "rope_low"), [])
    bpy.ops.ed.redo()
    assert kept(tmp_path / "there")[1] == before[1]
    assert bpy.data.objects["rope_low"].imprint.baked >= baked


MOMENTS = 15
LOWS = ("crate_low", "lid_low", "lock_low", "rope_low")


def whole(folder):
    """The files and the pixels of images that bakes have left, of which none may be half there."""
    files = {each.name: each.read_bytes() for each in (folder / "maps").glob("*")} if (folder / "maps").exists() else {}
    images = {}
    for image in bpy.data.images:
        texels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(texels)
        images[image.name] = texels.tobytes()
    return files, images


def kill(_path):
    for number in processes():
        os.kill(number, signal.SIGKILL)


def fill_disk(path):
    """No file of the process can grow beyond some bytes."""
    resource = pytest.importorskip("resource")
    for number in processes():
        resource.prlimit(number, resource.RLIMIT_FSIZE, (path.stat().st_size % 997, resource.RLIM_INFINITY))


def close(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))


@pytest.mark.skipif(not Path("/proc").exists(), reason="processes of Linux")
@pytest.mark.slow
def test_nothing_is_half_there_whenever_it_ends(file, tmp_path):
    folder = opened(file, tmp_path / "first")
    add()
    began = time.monotonic()
    wait()
    seconds = time.monotonic() - began
    expected = whole(folder)
    for moment in range(MOMENTS):
        chance = np.random.default_rng(moment)
        folder = opened(file, tmp_path / str(moment))
        add()
        numbers, end = set(), time.monotonic() + chance.uniform(0.0, seconds)
        wait(lambda numbers=numbers, end=end: numbers.update(processes()) or time.monotonic() > end)
        (kill, fill_disk, close)[moment % 3](folder / file.name)
        wait()
        files, images = whole(folder)
        assert files.items() <= expected[0].items(), moment
        assert images.items() <= expected[1].items(), moment
        found = changed()
        assert set(map(str, found.values())) <= {"None", "[]"}, moment
        done = {name for name, (state, _) in states().items() if state is Stage.DONE}
        of_sets = {"Files": LOWS[:1], "Packed": LOWS[1:3], "Memory": LOWS[3:]}
        assert all(found[low] == [] for name in done for low in of_sets[name]), moment
        assert found["lid_low"] == found["lock_low"], moment
        assert not list(folder.rglob(".imprint*")), moment
        assert not any(map(is_running, numbers - set(processes()))), moment
        add()
        wait()
        assert set(states().values()) == {(Stage.DONE, "")}, moment
        assert whole(folder) == expected, moment
        assert changed() == dict.fromkeys(LOWS, []), moment


def test_a_disk_without_room_for_the_copy_is_a_sentence(file, tmp_path):
    resource = pytest.importorskip("resource")
    folder = opened(file, tmp_path / "there")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, before[1]))
    try:
        with pytest.raises(BakeError, match="^A copy of the file to bake from could not be written: [^\n]*[.]$"):
            add("Files")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert queue.items == []
    assert [each.name for each in folder.iterdir()] == [file.name]


def press(name):
    assert bpy.ops.imprint.queue_add(name=name) == {"FINISHED"}


def test_a_set_that_is_added_again_while_it_is_baked_gets_the_newer_maps(file, tmp_path):
    """Its first press, canceled by the second one, delivers a part after the second copy was saved."""
    opened(file, tmp_path / "there")
    press("Files")
    wait(lambda: any(item.state is Stage.BAKING for item in queue.items))
    until = time.monotonic() + PATIENCE
    while queue._messages.empty():  # between two looks of the timer
        assert time.monotonic() < until
        time.sleep(0.02)
    bpy.data.objects["crate_high"].data.vertices[0].co.x += 0.5
    press("Files")
    wait()
    assert states() == {"Files": (Stage.DONE, "")}
    assert changed()["crate_low"] == []


def test_two_presses_of_one_low_object_arrive_both(file, tmp_path):
    """What the queue itself has put into the file is not newer than another press."""
    opened(file, tmp_path / "there")
    bpy.context.scene.imprint_sets["Memory"].own.image = "rope"
    other = new_set(bpy.data.objects["rope_low"], name="Other").own
    other.image, other.width, other.height = "small", 16, 16
    press("Memory")
    press("Other")
    wait()
    assert states() == dict.fromkeys(("Memory", "Other"), (Stage.DONE, ""))
    assert sizes("rope") == {(SIDE, SIDE)} and sizes("small") == {(16, 16)}


def sizes(name):
    return {tuple(image.size) for image in bpy.data.images if image.name.startswith(name)}


def test_undo_leaves_the_later_one_of_two_results(file, tmp_path):
    """And what it makes newer is not newer than a press."""
    opened(file, tmp_path / "there")
    bpy.ops.ed.undo_push(message="before")
    memory = bpy.context.scene.imprint_sets["Memory"].own
    for side in (SIDE, 16):
        memory.width = memory.height = side
        press("Memory")
        wait()
    bpy.ops.ed.undo_push(message="baked")
    press("Memory")
    bpy.ops.ed.undo()
    assert sizes("rope") == {(16, 16)}
    wait()
    assert states()["Memory"] == (Stage.DONE, "")


def test_an_image_that_got_other_parts_since_the_copy_was_saved_keeps_them(file, tmp_path):
    opened(file, tmp_path / "there")
    new_set(bpy.data.objects["lock_low"], name="Other")
    bpy.context.scene.imprint_sets["Packed"].parts.remove(1)
    for number, name in enumerate(("lid_low", "lock_low")):
        for corner in bpy.data.objects[name].data.uv_layers.active.data:
            corner.uv.x = 0.5 * (corner.uv.x + number)
    sets_of = bpy.context.scene.imprint_sets
    for name, is_on in (("Packed", True), ("Other", False)):
        one = sets_of[name]
        one.own.image, one.own.storage, one.is_on = "both", "PACK", is_on
    press("Packed")
    sets_of["Packed"].is_on = False
    press("Other")
    wait()
    why = "The image 'both' was baked for 'lid_low' meanwhile, and stays: add the set again."
    assert states() == {"Packed": (Stage.DONE, ""), "Other": (Stage.FAILED, why)}
    press("Other")
    wait()
    assert states()["Other"] == (Stage.DONE, "")
    assert changed()["lid_low"] == changed()["lock_low"] == []


def shown_in(material):
    return {node.image.name for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"}


@pytest.fixture
def by_material(file, tmp_path):
    """The materials of a low object that a set bakes by material, while it is in the queue."""
    opened(file, tmp_path / "there")
    low = bpy.data.objects["rope_low"]
    wood, metal = materials = [bpy.data.materials.new(name) for name in ("Wood", "Metal")]
    for number, polygon in enumerate(low.data.polygons):
        polygon.material_index = number % 2
    for material in materials:
        low.data.materials.append(material)
    one = bpy.context.scene.imprint_sets["Memory"]
    one.textures, one.own.image, one.own.vertex_domain = "MATERIAL", "T_{material}", "NONE"
    press("Memory")
    wait(lambda: any(item.state is Stage.BAKING for item in queue.items))
    return low, wood, metal


def test_maps_by_material_follow_slots_that_are_moved(by_material):
    low, wood, metal = by_material
    low.data.materials[0], low.data.materials[1] = metal, wood
    low.data.materials.append(bpy.data.materials.new("Glass"))
    for polygon in low.data.polygons:
        polygon.material_index = 1 - polygon.material_index
    wait()
    assert states()["Memory"] == (Stage.DONE, "")
    assert shown_in(wood) and all(name.startswith("T_Wood") for name in shown_in(wood))
    assert shown_in(metal) and all(name.startswith("T_Metal") for name in shown_in(metal))
    assert {(each.material, tuple(each.slots)) for each in low.imprint.reports()} == {("Wood", (1,)), ("Metal", (0,))}


def test_maps_of_a_material_that_is_gone_are_left_out(by_material):
    low, wood, metal = by_material
    low.data.materials[0] = bpy.data.materials.new("Glass")
    wait()
    why = "The materials of 'rope_low' were changed meanwhile, so its maps were left out: add the set again."
    assert states()["Memory"] == (Stage.FAILED, why)
    assert not wood.node_tree or not shown_in(wood)


def test_copies_that_the_queue_makes_of_materials_are_not_changes(file, tmp_path):
    opened(file, tmp_path / "there")
    lows = [bpy.data.objects[f"{name}_low"] for name in ("rope", "lock")]
    wood = bpy.data.materials.new("Wood")
    for low in lows:
        low.data.materials.append(wood)
    own = bpy.context.scene.imprint_sets["Memory"].own
    own.single_user, own.vertex_domain = True, "NONE"
    other = new_set(lows[0], name="Other", textures="MATERIAL").own
    other.image, other.vertex_domain = "T_{material}_{low}", "NONE"
    press("Memory")
    press("Other")
    wait()
    assert states() == dict.fromkeys(("Memory", "Other"), (Stage.DONE, ""))
    assert lows[0].data.materials[0] != wood


@pytest.mark.skipif(not Path("/proc").exists(), reason="processes of Linux")
def test_a_second_process_that_cannot_open_the_copy_ends_its_sets(file, tmp_path):
    """The first one has opened it. Nothing is tried for ever."""
    opened(file, tmp_path / "there")
    add()
    wait(lambda: any(item.state is Stage.BAKING for item in queue.items))
    Path(queue._runs[0].setup.copy).write_bytes(b"damaged")
    kill(file)
    wait()
    assert states()["Files"][1].startswith("Blender crashed with signal 9")
    for name in ("Packed", "Memory"):
        assert states()[name][1].startswith("The process to bake in does not start: ")


@pytest.mark.skipif(not Path("/proc").exists(), reason="processes of Linux")
def test_a_process_that_ends_while_its_result_is_put_leaves_a_whole_one(file, tmp_path, monkeypatch):
    opened(file, tmp_path / "there")
    monkeypatch.setattr(bake_queue, "MOST_AT_ONCE", 0.0)  # one step at each look
    press("Packed")
    wait(lambda: queue._putting is not None)
    kill(file)
    time.sleep(0.5)
    wait()
    assert changed()["lid_low"] == changed()["lock_low"] == []


def test_undo_puts_nothing_back_whose_file_another_program_has_changed(file, tmp_path):
    folder = opened(file, tmp_path / "there")
    bpy.ops.ed.undo_push(message="before")
    press("Files")
    wait()
    bpy.ops.ed.undo_push(message="baked")
    (folder / "maps" / "crate_low_ao.png").write_bytes(b"of another program")
    bpy.ops.ed.undo()
    assert changed()["crate_low"] != []
