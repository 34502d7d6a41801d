# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws strokes with the mouse in a real Blender window, and prints whether Live follows them. Not collected by pytest.

    blender --factory-startup --python tests/window/live_strokes.py

Needs X11 (or Xvfb) and xdotool, and the mouse for a minute or two. Each row has the stroke, the number of vertices that it
moved, the number of maps while the button was down, the seconds from its release to the last map, and whether the image then
equals a new bake to the bit. Blender exits with 1 if a row is wrong.
"""

import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import addon  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402
from addon.ui.callbacks import events  # noqa: E402
from addon.ui.live import live  # noqa: E402
from tests.support import window  # noqa: E402

BRUSHES = "brushes/essentials_brushes-mesh_sculpt.blend/Brush/"
PATIENCE = 20.0
"""Seconds to wait for a map."""
CASES = [
    ("Draw", "FLATTEN", None),
    ("Smooth", "FLATTEN", None),
    ("Grab", "FLATTEN", None),
    ("Inflate/Deflate", "FLATTEN", None),
    ("Clay Strips", "FLATTEN", None),
    ("Crease Sharp", "CAST", None),
    ("Draw", "CAST", "undo"),
    ("Draw", "FLATTEN", "Subdivision"),
    ("Draw", "FLATTEN", "shape key"),
    ("Draw", "CAST", "Dyntopo"),
    ("Draw", "CAST", "Voxel Remesh"),
    ("Draw", "FLATTEN", "Multires"),
]


def step():
    """Run all cases. Yields the seconds to wait."""
    addon.register()
    yield 0.5
    is_well = True
    print(f"{'brush':16} {'with':14} {'method':8} {'moved':>7} {'maps':>5} {'seconds':>8}  equal", flush=True)
    only = globals().get("ARGS")
    for brush, method, what in CASES:
        if only and brush not in only and what not in only:
            continue
        high = yield from prepare(method, what)
        activate(brush)
        yield 0.3
        before = points(high)
        maps = yield from stroke(
            2 if brush == "Grab" else 8
        )  # Blender updates folded quads only when it leaves the mode
        seconds = yield from wait()
        if what == "undo":
            with window.at_view():
                bpy.ops.ed.undo()
            seconds = yield from wait()
            maps += yield from stroke(8, offset=30)
            seconds = yield from wait()
        elif what == "Voxel Remesh":
            with window.at_view():
                bpy.ops.object.voxel_remesh()
            seconds = yield from wait()
        message, image = live.message, pixels(bpy.data.images["lo_normal"])
        after, mode = points(high), high.mode
        equal = np.array_equal(image, fresh(high))
        moved = len(after) if len(after) != len(before) else int((after != before).any(axis=1).sum())
        is_expected = equal and moved > 0 and mode == "SCULPT" and not message
        if what == "Multires":  # Blender does not return the detail in Sculpt Mode, and Live reports that
            is_expected = "leaves Sculpt Mode" in message
        is_well &= is_expected
        verdict = (
            ("yes" if equal else "no") + (f" ({message})" if message else "") + ("" if is_expected else "  <-- WRONG")
        )
        print(f"{brush:16} {what or '':14} {method:8} {moved:7} {maps:5} {seconds:8.2f}  {verdict}", flush=True)
        live.stop()
    print("all as promised" if is_well else "NOT all as expected", flush=True)
    addon.unregister()
    if not is_well:
        raise SystemExit(1)


def prepare(method, what):
    """Make a scene with a low grid and a high one in Sculpt Mode, and turn Live on. Returns the high grid."""
    _, area, _ = window.view()
    with window.at_view():
        if bpy.context.object is not None and bpy.context.object.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        for image in list(bpy.data.images):
            bpy.data.images.remove(image)
        for name, cuts in (("lo", 10), ("hi", 60)):
            bpy.ops.mesh.primitive_grid_add(x_subdivisions=cuts, y_subdivisions=cuts, size=4)
            bpy.context.object.name = name
            bpy.ops.object.shade_smooth()
        high, low = bpy.context.object, bpy.data.objects["lo"]
        low.hide_set(True)
        modify(high, what)
        area.spaces.active.overlay.show_overlays = False
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_all()
        settings = bpy.context.scene.imprint
        settings.low = low
        settings.highs.clear()
        settings.highs.add().object = high
        settings.method, settings.width, settings.height = method, 256, 256
        bpy.ops.imprint.live("EXEC_DEFAULT")
        bpy.ops.object.mode_set(mode="SCULPT")
        if what == "Dyntopo":
            bpy.ops.sculpt.dynamic_topology_toggle()
    yield 1.0
    return high


def modify(high, what):
    if what == "Subdivision":
        high.modifiers.new("Subdivision", "SUBSURF")
    elif what == "Multires":
        high.modifiers.new("Multires", "MULTIRES")
        bpy.ops.object.multires_subdivide(modifier="Multires")
    elif what == "shape key":
        high.shape_key_add(name="Basis")
        high.shape_key_add(name="Key").value = 1.0
        high.active_shape_key_index = 1
    elif what == "Voxel Remesh":
        high.data.remesh_voxel_size = 0.1


def activate(brush):
    with window.at_view():
        bpy.ops.brush.asset_activate(asset_library_type="ESSENTIALS", relative_asset_identifier=BRUSHES + brush)


def stroke(pace, offset=0):
    """Drag the mouse over the middle of the view. Returns the number of maps before the button was released."""
    whole, _, region = window.view()
    x, y = region.x + region.width // 2 - 50, whole.height - (region.y + region.height // 2) + offset
    maps_drawn = []

    def note():
        texels = live.session and live.session.texels
        if texels is not None and not any(texels is known for known in maps_drawn):
            maps_drawn.append(texels)

    note()
    first = len(maps_drawn)
    events.hear(live=note)
    window.mouse("mousemove", x, y)
    yield 0.3
    window.mouse("mousedown", 1)
    yield 0.1
    for number in range(12):
        window.mouse("mousemove", x + pace * number, y + pace // 2 * number)
        yield 0.1
    count = len(maps_drawn) - first
    window.mouse("mouseup", 1)
    yield 0.05
    return count


def wait():
    """Wait until Live has nothing to do. Returns the seconds until its last map."""
    start = time.monotonic()
    last, texels = start, live.session.texels
    yield 0.3
    while not live.is_resting and time.monotonic() - start < PATIENCE:
        yield 0.05
        if live.session.texels is not texels:
            last, texels = time.monotonic(), live.session.texels
    return last - start


def fresh(high):
    """The texels of a new bake of the present objects."""
    plain = bpy.context.scene.imprint.to_settings().flat()
    own = {"image": "fresh", "storage": "MEMORY", "material": False, "modifiers": "VIEWPORT"}
    method = {"method": live.session.plan.method}
    with window.at_view():
        bake_pair(bpy.context, bpy.data.objects["lo"], [high], Settings(**plain | own | method))
    return pixels(bpy.data.images["fresh"])


def pixels(image):
    texels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(texels)
    return texels


def points(obj):
    values = np.empty(len(obj.data.vertices) * 3, np.float32)
    source = obj.active_shape_key.data if obj.data.shape_keys else obj.data.vertices
    source.foreach_get("co", values)
    return values.reshape(-1, 3)


if __name__ == "__main__":  # otherwise, another script calls step() or single functions
    window.start(step())
