# SPDX-License-Identifier: GPL-3.0-or-later
"""Installs the zip in a real Blender window, bakes with the bar, shows all views, runs Live, and disables it. It is for each
version of Blender that the manifest allows. Not collected by pytest.

    blender --factory-startup --python tests/window/installed_zip.py -- dist/imprint-0.3.0.zip

Blender exits with 1 if a part fails. It needs no checkout but this file.
"""

import math
import sys

import bpy

ARGUMENTS = sys.argv[sys.argv.index("--") + 1 :]
MODULE = "bl_ext.user_default.imprint"
PATIENCE = 120.0
"""Seconds to wait."""


def part(name):
    """A module of the installed extension."""
    return sys.modules[f"{MODULE}.addon.{name}"]


def step():
    """Run all parts. Yields the seconds to wait."""
    bpy.ops.extensions.package_install_files(filepath=ARGUMENTS[0], repo="user_default", enable_on_install=True)
    yield 0.5
    report("installed", MODULE in bpy.context.preferences.addons)
    prepare()
    yield 0.5
    for green in ("-Y", "+Y"):
        yield from bake(green)
    yield from views()
    yield from follow()
    bpy.ops.preferences.addon_disable(module=MODULE)
    yield 0.5
    report("disabled", not hasattr(bpy.types.Scene, "imprint"))
    print(f"Blender {bpy.app.version_string}: installed, used and removed", flush=True)


def prepare():
    """A low and a high grid in the slots, and the panel in the sidebar."""
    window, area, region = view()
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.data.batch_remove(bpy.data.objects[:])
        for name, cuts in (("lo", 10), ("hi", 60)):
            bpy.ops.mesh.primitive_grid_add(x_subdivisions=cuts, y_subdivisions=cuts, size=4)
            bpy.context.object.name = name
    for vertex in bpy.data.objects["hi"].data.vertices:
        vertex.co.z = 0.3 * math.sin(5.0 * vertex.co.x) * math.cos(5.0 * vertex.co.y)
    settings = bpy.context.scene.imprint
    settings.low = bpy.data.objects["lo"]
    settings.highs.add().object = bpy.data.objects["hi"]
    settings.method, settings.width, settings.height, settings.maps = "CAST", 256, 256, {"AO", "HEIGHT"}
    settings.rays = 32
    area.spaces.active.show_region_ui = True


def bake(green):
    """Bake with the bar, and look at the image and the nodes."""
    bpy.context.scene.imprint.green = green
    press("bake")
    running = part("ui.modal").runner
    had_bar = running.run is not None
    yield from until(lambda: running.run is None)
    nodes = bpy.data.materials["lo"].node_tree.nodes
    tested = next(node for node in nodes if node.bl_idname == "ShaderNodeNormalMap")
    has_images = {"lo_normal", "lo_ao", "lo_height"} <= {*bpy.data.images.keys()}
    report(f"bake {green}", had_bar and has_images and tested.inputs["Color"].is_linked)


def views():
    """Show each view of the map."""
    viewer = part("ui.views").viewer
    for mode in ("MAP", "SPLIT", "DEVIATION", "BARE_DEVIATION"):
        press("view_show", mode=mode)
        yield from until(lambda mode=mode: viewer.mode is not None and viewer.mode.name == mode)
        yield 1.0
        report(f"view {mode}", viewer.mode is not None and viewer.mode.name == mode)
    press("view_show", mode="BARE_DEVIATION")
    yield 0.5


def follow():
    """Live bakes again when the high mesh changes."""
    press("live")
    live, runner = part("ui.live").live, part("ui.modal").runner
    yield from until(lambda: live.is_on and runner.run is None)
    before = bpy.data.images["lo_normal"].pixels[:]
    bpy.data.objects["hi"].scale.z = 2.0
    yield from until(lambda: bpy.data.images["lo_normal"].pixels[:] != before)
    report("Live", bpy.data.images["lo_normal"].pixels[:] != before)
    press("live")
    yield from until(lambda: not live.is_on and runner.run is None)


def press(operator, **arguments):
    window, area, region = view()
    with bpy.context.temp_override(window=window, area=area, region=region, screen=window.screen):
        getattr(bpy.ops.imprint, operator)("INVOKE_DEFAULT", **arguments)


def view():
    """The largest 3D viewport."""
    window = bpy.context.window_manager.windows[0]
    area = max((a for a in window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)
    return window, area, next(region for region in area.regions if region.type == "WINDOW")


def until(is_there):
    """Wait for it."""
    for _ in range(int(PATIENCE / 0.1)):
        if is_there():
            return
        yield 0.1


def report(name, is_right):
    print(f"{name:20} {'as promised' if is_right else 'WRONG'}", flush=True)
    if not is_right:
        raise SystemExit(1)


def start(steps):
    """Run `steps` in Blender's event loop, and quit after the last."""
    bpy.context.preferences.view.show_splash = False

    def advance():
        seconds = next(steps, None)
        if seconds is None:
            bpy.ops.wm.quit_blender()
        return seconds

    bpy.app.timers.register(advance, first_interval=1.0, persistent=True)


if __name__ == "__main__":  # otherwise, another script calls step()
    start(step())
