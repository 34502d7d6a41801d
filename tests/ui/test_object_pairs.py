# SPDX-License-Identifier: GPL-3.0-or-later
"""The pair of a low object, which the file keeps: high objects, cage, method, distances and the last result."""

import json
import subprocess
import sys
import textwrap

import bpy
import numpy as np
import pytest

from addon.ui import object_pairs
from scripts.imprint import ROOT
from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def crate():
    """A baked low object, active, and its high object, which Imprint has hidden."""
    low, high = zoo.plane("crate_low"), zoo.plane("crate_high", slope=1.0)
    small()
    select(low, high)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    high.hide_set(True)
    select(low)
    return low, high


def small(**changes):
    settings = bpy.context.scene.imprint
    settings.width = settings.height = 16
    for name, value in ({"method": "CAST"} | changes).items():
        setattr(settings, name, value)
    return settings


def select(active, *others):
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    for obj in (active, *others):
        obj.select_set(True)
    bpy.context.view_layer.objects.active = active


def chosen(low=None):
    """The names of the high objects that the panel would bake."""
    return [high.name for high in bpy.context.scene.imprint.chosen_objects(bpy.context, low)[1]]


def pair(name="crate_low"):
    return object_pairs.of(bpy.data.objects[name])


def texels(name):
    return maps.pixels(bpy.data.images[name])


def save(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def open_file(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))


def elsewhere(path, code):
    """Run code in a new process with a file open. Returns what it stores in `found`."""
    script = f"""
        import json, sys
        sys.path.insert(0, {str(ROOT)!r})
        import bpy, addon
        addon.register()
        bpy.ops.wm.open_mainfile(filepath={str(path)!r})
        from addon.ui import object_pairs
        from addon.ui.bake_results import results
        low = bpy.context.active_object
    """
    script = (
        textwrap.dedent(script) + textwrap.dedent(code) + "\nprint('found: ' + json.dumps(found))\naddon.unregister()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("found: "))[7:])


def select_all_as_the_outliner():
    for obj in bpy.context.view_layer.objects:
        obj.select_set(True)


# Day two


def test_another_process_bakes_the_saved_pair(crate, tmp_path):
    """With the low object alone active, and after selecting all, while the high object is still hidden."""
    before = texels("crate_low_normal")
    save(tmp_path / "crate.blend")
    found = elsewhere(
        tmp_path / "crate.blend",
        """
        scene = bpy.context.scene
        found = {"shown": results.of(bpy.context).high, "hidden": [o.name for o in scene.objects if o.hide_get()]}
        for select_all in (False, True):
            for obj in bpy.context.view_layer.objects:
                obj.select_set(select_all or obj == low)
            bpy.data.images.remove(bpy.data.images["crate_low_normal"])
            assert bpy.ops.imprint.bake() == {"FINISHED"}
            found[f"texels {select_all}"] = list(bpy.data.images["crate_low_normal"].pixels)
        assert bpy.ops.imprint.show_high() == {"FINISHED"}
        found["hidden after the eye"] = [o.name for o in scene.objects if o.hide_get()]
        """,
    )
    assert (found["shown"], found["hidden"], found["hidden after the eye"]) == (["crate_high"], ["crate_high"], [])
    for kind in (False, True):
        assert np.array_equal(np.array(found[f"texels {kind}"], np.float32).reshape(before.shape), before)
