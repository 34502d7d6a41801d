# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks at baked maps on the model in a real Blender window, by clicks, keys and drags, with pictures. Not collected by pytest.

    blender --factory-startup --python tests/window/stored_views.py

Needs X11 (or Xvfb) of 1920 x 1080, xdotool and ImageMagick, and the mouse for some minutes. It prints what each part found, and
how long views of maps of $MAP_SIZE take until they are drawn. Pictures go to the folder in $PICTURES, or the current one.
Blender exits with 1 if a part is wrong.
"""

import math
import os
import sys
import time
from pathlib import Path

import bpy

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

import addon  # noqa: E402
from addon.ui import modal  # noqa: E402
from addon.ui.view_shading import Mode  # noqa: E402
from addon.ui.views import viewer  # noqa: E402
from tests.support import window  # noqa: E402

FOLDER = Path(os.environ.get("PICTURES", ".")).resolve()
SIZE = int(os.environ.get("MAP_SIZE", "4096"))
"""Of the maps whose times are taken."""
TRIES = 9
wrong: list[str] = []


def step():
    """Run all parts. Yields the seconds to wait."""
    window.open_alone("IMPRINT_PT_bake", "IMPRINT_PT_view")
    addon.register()
    yield 0.5
    prepare()
    yield 1.0
    yield from bake()
    yield from looking()
    yield from following()
    yield from reopened()
    yield from times()
    addon.unregister()
    print("failed: " + ", ".join(wrong) if wrong else "all as promised", flush=True)
    if wrong:
        raise SystemExit(1)


def prepare():
    """Two pairs beside each other. The high ones are painted, and hide the low ones."""
    with window.at_view():
        bpy.data.batch_remove(bpy.data.objects[:])
        for number, name in enumerate(("crate", "barrel")):
            for kind, cuts in (("low", 6), ("high", 90)):
                bpy.ops.mesh.primitive_grid_add(
                    x_subdivisions=cuts, y_subdivisions=cuts, size=3, location=(3.4 * number, 0, 0)
                )
                obj = bpy.context.object
                obj.name = obj.data.name = f"{name}_{kind}"
                if kind == "high":
                    for vertex in obj.data.vertices:
                        vertex.co.z = 0.15 * math.sin((5 + 3 * number) * vertex.co.x) * math.cos(5 * vertex.co.y)
                    obj.data.materials.append(paint(name, number))
        bpy.ops.object.select_all(action="DESELECT")
        bpy.ops.view3d.view_all()
    settings = bpy.context.scene.imprint
    settings.method, settings.width, settings.height, settings.rays = "CAST", 128, 128, 16
    settings.maps, settings.show_result = {"AO", "CURVATURE", "BASE_COLOR", "HEIGHT", "MATERIAL_ID"}, False
    window.select_only(bpy.data.objects["crate_low"])


def paint(name, number):
    material = bpy.data.materials.new(name)
    color = (0.8, 0.15, 0.05, 1.0) if number == 0 else (0.05, 0.3, 0.8, 1.0)
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
    return material


def bake():
    with window.at_view():
        bpy.ops.imprint.bake_pairs("INVOKE_DEFAULT")
    yield from until(lambda: modal.runner.run is None)
    window.select_only(bpy.data.objects["crate_low"])
    yield 1.0


def looking():
    """Each map by a click on its button, the key that flickers, the line, the light, the mask."""
    yield from click("imprint.view_map")
    check("a click shows the map", (viewer.mode, viewer.map) == (Mode.MAP, "AO"))
    picture("ao")
    for name in ("CURVATURE", "BASE_COLOR", "HEIGHT", "MATERIAL_ID", "NORMAL"):
        with window.at_view():
            bpy.ops.imprint.view_map(map=name)
        yield 0.7
        picture(name.lower())
    yield from window.keys("ctrl+alt+h")
    check("the key shows the high object", viewer.mode is Mode.HIGH)
    picture("flicker")
    yield from window.keys("ctrl+alt+h")
    check("and the map again", viewer.mode is Mode.MAP)
    view = bpy.context.scene.imprint_view
    view.mode = "SPLIT"
    yield 0.7
    before = view.split
    whole, _, region = window.view()
    x, y = region.x + round(before * region.width), whole.height - region.y - region.height // 2
    yield from drag((x, y), (x + 150, y), 1)
    check("the line follows the mouse", abs(view.split - before - 150 / region.width) < 0.02)
    picture("split")
    view.mode = "SIDES"
    yield 0.7
    picture("sides")
    turned = tuple(view.direction)
    window.mouse("keydown", "ctrl", "keydown", "alt")
    yield from drag((x, y), (x + 120, y - 60), 3)
    window.mouse("keyup", "alt", "keyup", "ctrl")
    yield 0.5
    check("the light turns", tuple(view.direction) != turned)
    picture("light")
    bpy.data.objects["crate_high"].scale = 0.7, 0.7, 1.0
    bpy.ops.object.select_all(action="DESELECT")
    window.select_only(bpy.data.objects["crate_low"])
    yield from bake_low()
    view.mask = "UNCOVERED"
    yield from until(lambda: modal.runner.run is None)
    yield 0.7
    check("a mask lies over the map", view.mask == "UNCOVERED" and viewer.mode in {Mode.MAP, Mode.SIDES})
    view.mode = "MAP"
    yield 0.7
    picture("mask")
    view.mask = "NONE"
    view.mode = "DEVIATION"
    yield from until(lambda: modal.runner.run is None)
    yield 0.7
    check("deviations of the stored map", viewer.deviations is not None and viewer.own.settings is None)
    picture("deviation")


def following():
    """The view follows a click in the Outliner, and shows all low objects."""
    view = bpy.context.scene.imprint_view
    view.mode, viewer.map = "MAP", "AO"
    with window.at_view():
        bpy.ops.imprint.view_map(map="AO")
    yield 0.5
    yield from window.click_row("barrel_low")
    yield from until(lambda: viewer.low.name == "barrel_low" or viewer.mode is Mode.OFF)
    yield 1.0
    check("the view follows the active low object", viewer.low.name == "barrel_low")
    picture("followed")
    view.all_lows = True
    yield 3.0
    picture("all lows")
    view.all_lows = False
    yield 0.5


def reopened():
    """The file is saved and opened again: a click shows a map, and nothing is baked."""
    path = str(FOLDER / "views.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    yield 3.0
    check("no view after opening", viewer.is_idle)
    window.select_only(bpy.data.objects["barrel_low"])
    yield 1.0
    yield from click("imprint.view_map")
    check("a click shows the map after opening", viewer.mode is Mode.MAP and viewer.own is None)
    yield 2.0
    picture("reopened")


def times():
    """How long it takes until a view of a large map is drawn."""
    settings = bpy.context.scene.imprint
    settings.width = settings.height = SIZE
    settings.maps, settings.samples, settings.method = {"BASE_COLOR"}, "1", "FLATTEN"
    for name in ("crate", "barrel"):
        bpy.data.objects[f"{name}_high"].scale = 1.0, 1.0, 1.0
    viewer.off()
    with window.at_view():
        bpy.ops.imprint.bake_pairs("INVOKE_DEFAULT")
    yield from until(lambda: modal.runner.run is None, 600)
    yield 2.0
    low, other = bpy.data.objects["crate_low"], bpy.data.objects["barrel_low"]
    window.select_only(low)
    yield 1.0
    took = {}
    took["redraw without a view"] = [timed(lambda: None) for _ in range(TRIES)]

    def show(name):
        bpy.ops.imprint.view_map(map=name)

    took["first view of a color map"] = [timed(lambda: show("BASE_COLOR"))]
    took["first view of a normal map"] = [timed(lambda: show("NORMAL"))]
    took["view of a map"] = [timed(lambda n=n: show(("BASE_COLOR", "NORMAL")[n % 2])) for n in range(TRIES)]
    took["first flicker"] = [timed(bpy.ops.imprint.view_flicker)]
    took["flicker"] = [timed(bpy.ops.imprint.view_flicker) for _ in range(TRIES)]
    show("BASE_COLOR")
    took["first switch of object"] = [timed(lambda: switch(other))]
    took["switch of object"] = [timed(lambda n=n: switch((low, other)[n % 2])) for n in range(TRIES)]
    for what, seconds in took.items():
        middle = sorted(seconds)[len(seconds) // 2]
        print(f"  {what:28} {1000 * middle:7.1f} ms (median of {len(seconds)})", flush=True)
    picture("times")


def switch(low):
    window.select_only(low)
    redraw()  # notices the other object
    viewer.catch_up()


def timed(action):
    """Seconds until the window shows what `action` has changed."""
    with window.at_view():
        start = time.perf_counter()
        action()
        redraw()
        return time.perf_counter() - start


def redraw():
    with window.at_view():
        bpy.context.area.tag_redraw()
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)


def bake_low():
    with window.at_view():
        bpy.ops.imprint.bake("INVOKE_DEFAULT")
    yield from until(lambda: modal.runner.run is None)
    yield 0.5


def click(button):
    """Click the second button of this operator, beside the first one."""
    yield from window.find(button)
    window.mouse("mousemove_relative", 120, 0)
    yield 0.2
    window.mouse("click", 1)
    yield 0.7


def drag(start, end, button):
    window.mouse("mousemove", *start)
    yield 0.3
    window.mouse("mousedown", button)
    yield 0.3
    for share in (0.3, 0.7, 1.0):
        window.mouse("mousemove", *(round(a + share * (b - a)) for a, b in zip(start, end, strict=True)))
        yield 0.2
    window.mouse("mouseup", button)
    yield 0.4


def until(is_there, seconds=120):
    for _ in range(int(seconds / 0.1)):
        if is_there():
            return
        yield 0.1
    raise TimeoutError


def check(what, is_right):
    print(f"  {what:45} {'as promised' if is_right else 'WRONG'}", flush=True)
    if not is_right:
        wrong.append(what)


def picture(name):
    """A picture of the window, after it was drawn."""
    redraw()
    window.screenshot(FOLDER / f"view {name}.png")


if __name__ == "__main__":  # otherwise, another script calls step()
    window.start(step())
