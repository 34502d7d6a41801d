# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes several maps in a real Blender window, stops bakes with Esc, and draws strokes with Live on. Not collected by pytest.

    blender --factory-startup --python tests/window/several_maps.py

Needs X11 (or Xvfb) and xdotool, and the mouse for a minute or two. It prints what each part found. Blender exits with 1 if
one is wrong.
"""

import math
import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2]), str(Path(__file__).resolve().parent)]

import live_strokes  # noqa: E402

import addon  # noqa: E402
from addon.ui import modal  # noqa: E402
from addon.ui.live import live  # noqa: E402
from addon.ui.progress_display import display  # noqa: E402
from tests.support import window  # noqa: E402

PATIENCE = 120.0
MAPS = {"AO", "HEIGHT", "BASE_COLOR"}
NAMES = {"lo_normal", "lo_ao", "lo_height", "lo_base_color", "lo_orm"}


def step():
    """Run all parts. Yields the seconds to wait."""
    addon.register()
    yield 0.5
    wrong = []
    for name, part in (("Esc", escape()), ("bake", whole()), ("Live", strokes())):
        found = yield from part
        print(f"{name:6} {found or 'as promised'}", flush=True)
        wrong += found
    live.stop()
    addon.unregister()
    if wrong:
        raise SystemExit(1)


def prepare():
    """A low and a high grid, and the settings of small maps."""
    with window.at_view():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        for name, cuts in (("lo", 10), ("hi", 60)):
            bpy.ops.mesh.primitive_grid_add(x_subdivisions=cuts, y_subdivisions=cuts, size=4)
            bpy.context.object.name = name
    for vertex in bpy.data.objects["hi"].data.vertices:  # so that occlusion differs from ray to ray
        vertex.co.z = 0.3 * math.sin(5.0 * vertex.co.x) * math.cos(5.0 * vertex.co.y)
    settings = bpy.context.scene.imprint
    settings.low = bpy.data.objects["lo"]
    settings.highs.clear()
    settings.highs.add().object = bpy.data.objects["hi"]
    settings.method, settings.width, settings.height, settings.rays = "CAST", 256, 256, 64
    settings.maps, settings.pack = MAPS, "GLTF"


def escape():
    """Stop a bake by Esc in each of its steps. Nothing may remain."""
    prepare()
    yield 0.5
    found, stopped = [], set()
    before = {*bpy.data.images.keys()}, {*bpy.data.materials.keys()}
    while True:
        press_bake()
        step_name, is_done = yield from until(lambda: display.current.what not in {*stopped, "Starting"})
        if is_done:
            break
        window.mouse("key", "Escape")
        _, is_stopped = yield from until(lambda: False)
        stopped.add(step_name)
        after = {*bpy.data.images.keys()}, {*bpy.data.materials.keys()}
        if not is_stopped or after != before:
            return [f"Esc in {step_name!r} left {after}"]
    print(f"       Esc in {sorted(stopped)}", flush=True)
    if "Casting rays for occlusion" not in stopped:
        found.append("no bake was stopped while rays were cast for occlusion")
    return found


def whole():
    """Bake again, over the images. The bar shows pictures of several maps."""
    pictures, bars = [], []

    def note():
        picture = display.picture
        if picture is not None:
            pictures.append(np.asarray(picture.read(), np.float32).mean())
        bars.append(display.current.done)
        return False

    bpy.context.scene.imprint.rays = 512
    press_bake()
    yield from until(note)
    found = []
    if not {*bpy.data.images.keys()} >= NAMES:
        found.append(f"the images are {bpy.data.images.keys()}")
    if bars != sorted(bars):
        found.append(f"the bar went back: {bars}")
    if len({*pictures}) < 2:
        found.append("the picture did not change")
    return found


def strokes():
    """Draw a stroke with Live on: the normal map follows it, and after a pause the other maps."""
    settings = bpy.context.scene.imprint
    settings.low = None
    settings.highs.clear()
    bpy.data.batch_remove(bpy.data.objects[:])  # a slot keeps the name of an object that is only deleted
    high = yield from live_strokes.prepare("CAST", None)
    settings.maps, settings.pack, settings.rays = MAPS, "NONE", 64
    yield from live_strokes.wait()
    live_strokes.activate("Draw")
    yield 0.3
    before = texels()
    maps = yield from live_strokes.stroke(8)
    during = texels()
    start = time.monotonic()
    yield from live_strokes.wait()
    after = texels()
    seconds = time.monotonic() - start
    print(f"       {maps} normal maps while the button was down, all maps {seconds:.1f} s after it", flush=True)
    live.stop()
    press_bake()
    yield from until(lambda: False)
    fresh = texels()
    found = [f"{name} is not that of a bake" for name in after if not np.array_equal(after[name], fresh[name])]
    found += [f"{name} did not change" for name in ("lo_normal", "lo_ao") if np.array_equal(before[name], after[name])]
    if not np.array_equal(before["lo_ao"], during["lo_ao"]):
        found.append("lo_ao changed during the stroke")
    if live_strokes.points(high).reshape(-1, 3)[:, 2].max() <= 0.0:
        found.append("the stroke moved nothing")
    return found


def texels():
    """The texels of all maps by name."""
    names = [image.name for image in bpy.data.images if image.name.startswith("lo_")]
    return {name: live_strokes.pixels(bpy.data.images[name]) for name in names}


def press_bake():
    with window.at_view():
        bpy.context.scene.imprint.show_result = False
        bpy.ops.imprint.bake("INVOKE_DEFAULT")


def until(condition):
    """Wait until `condition` or the end of the bake. Returns the step, and whether the bake has ended."""
    start = time.monotonic()
    while display.current is not None and time.monotonic() - start < PATIENCE:
        if condition():
            return display.current.what, False
        yield 0.0
    return "", modal.runner.run is None


if __name__ == "__main__":  # otherwise, another script calls step()
    window.start(step())
