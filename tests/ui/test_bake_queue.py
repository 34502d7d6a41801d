# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the queue: that its process bakes what the window bakes, and what remains of it whatever ends it."""

import json
import time

import bpy
import numpy as np
import pytest

from addon.core.progress import finish
from addon.jobs import part_state
from addon.ui import object_pairs, sets
from addon.ui.bake_queue import Stage, queue
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
        marks = {key: value for key, value in image.items() if key not in {"imprint_map", "imprint_unpacked"}}
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
