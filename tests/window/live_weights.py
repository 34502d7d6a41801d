# SPDX-License-Identifier: GPL-3.0-or-later
"""Paints weights with the mouse in a real Blender window, and prints whether Live follows them. Not collected by pytest.

    blender --factory-startup --python tests/window/live_weights.py

Needs X11 (or Xvfb) and xdotool, and the mouse for a minute. Each row has what was done, the number of vertices whose weights
it changed, the number of maps while the button was down, the seconds from its release to the last map, the share of the texels
that changed, and whether the image then equals a new bake to the bit. Blender exits with 1 if a row is wrong.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import addon  # noqa: E402
from addon.ui.live import live  # noqa: E402
from tests.support import window  # noqa: E402
from tests.window import live_strokes as strokes  # noqa: E402

CASES = [
    ("offset_group", 0.0, "BLENDED", 8),
    ("offset_group", 1.0, "BLENDED", 8),
    ("straight_group", 0.0, "SPLIT", 1),
    ("straight_group", 1.0, "SMOOTH", 1),
]
"""The setting of the group that is painted, the brush's weight, the directions of rays, and how often the low cube's edges are
cut. With few cuts, smooth normals differ from the faces' normals in the middle as well."""


def rename(name):
    return lambda low: setattr(low.vertex_groups[0], "name", name)


def remove(_low):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.object.vertex_group_remove()


def reset(low):
    low.vertex_groups[0].add(range(len(low.data.vertices)), 0.5, "REPLACE")


ACTIONS = [
    ("renamed", rename("other"), False, "no vertex group 'painted'"),
    ("named back", rename("painted"), False, ""),
    ("removed", remove, False, "no vertex group 'painted'"),
    ("undone", lambda _low: bpy.ops.ed.undo(), False, ""),
    ("reset to 0.5", reset, True, ""),
]
"""After each stroke: what is done, a function of the low object that does it, whether the map changes, and Live's message."""


def step():
    """Run all cases. Yields the seconds to wait."""
    addon.register()
    yield 0.5
    is_well = True
    print(f"{'what':24} {'weights':>8} {'maps':>5} {'seconds':>8} {'texels':>8}  equal", flush=True)

    def row(what, before, maps, seconds, *, changes=True, message=""):
        after = weights(), strokes.pixels(bpy.data.images["lo_normal"])
        moved, texels = (
            float((old != new).mean()) if old.shape == new.shape else 1.0
            for old, new in zip(before, after, strict=True)
        )
        equal = bool(message) or np.array_equal(after[1], strokes.fresh(bpy.data.objects["hi"]))
        is_expected = (
            equal and (texels > 0.0) == changes and message in live.message and bool(live.message) == bool(message)
        )
        print(
            f"{what:24} {moved:8.1%} {maps:5} {seconds:8.2f} {texels:8.2%}  {'yes' if equal else 'no'} {live.message}"
            + ("" if is_expected else "  <-- WRONG"),
            flush=True,
        )
        return is_expected

    for setting, weight, directions, cuts in CASES:
        yield from prepare(setting, weight, directions, cuts)
        before = weights(), strokes.pixels(bpy.data.images["lo_normal"])
        maps = yield from strokes.stroke(8)
        seconds = yield from strokes.wait()
        is_well &= row(f"{setting} {weight}", before, maps, seconds)
        for what, do, changes, message in ACTIONS:
            before = weights(), strokes.pixels(bpy.data.images["lo_normal"])
            with window.at_view():
                do(bpy.data.objects["lo"])
            seconds = yield from strokes.wait()
            is_well &= row(f"  {what}", before, 0, seconds, changes=changes, message=message)
        live.stop()
    print("all as expected" if is_well else "NOT all as expected", flush=True)
    addon.unregister()
    if not is_well:
        raise SystemExit(1)


def prepare(setting, weight, directions, cuts):
    """Make a low cube and a larger uneven one, the low in Weight Paint Mode, and turn Live on."""
    _, area, _ = window.view()
    with window.at_view():
        if bpy.context.object is not None and bpy.context.object.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        for obj in list(bpy.data.objects):
            bpy.data.objects.remove(obj)
        for image in list(bpy.data.images):
            bpy.data.images.remove(image)
        for name, number in (("hi", 20), ("lo", cuts)):
            bpy.ops.mesh.primitive_cube_add(size=2)
            bpy.context.object.name = name
            bpy.ops.object.mode_set(mode="EDIT")
            bpy.ops.mesh.subdivide(number_cuts=number)
            bpy.ops.object.mode_set(mode="OBJECT")
        low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
        rng = np.random.default_rng(7)
        points = strokes.points(high)
        high.data.attributes["position"].data.foreach_set(
            "vector", (points * 1.05 + rng.normal(0, 0.01, points.shape)).ravel()
        )
        high.data.update()
        high.hide_set(True)
        low.vertex_groups.new(name="painted").add(range(len(low.data.vertices)), 0.5, "REPLACE")
        area.spaces.active.overlay.show_overlays = False
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_all()
        settings = bpy.context.scene.imprint
        settings.low = low
        settings.highs.clear()
        settings.highs.add().object = high
        settings.method, settings.width, settings.height = "CAST", 256, 256
        settings.measure, settings.extrusion, settings.max_distance = False, 0.06, 0.2  # too short for some peaks
        settings.directions, settings.offset_group, settings.straight_group = directions, "", ""
        setattr(settings, setting, "painted")
        bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
        paint = bpy.context.tool_settings.weight_paint
        (
            getattr(paint, "unified_paint_settings", None) or bpy.context.tool_settings.unified_paint_settings
        ).weight = weight
        paint.brush.weight = weight
        bpy.ops.imprint.live("EXEC_DEFAULT")
    yield from strokes.wait()
    yield 0.5


def weights():
    """The weights of the low mesh, by vertex."""
    low = bpy.data.objects["lo"]
    return np.array([vertex.groups[0].weight if vertex.groups else 0.5 for vertex in low.data.vertices])


if __name__ == "__main__":  # otherwise, another script calls step()
    window.start(step())
