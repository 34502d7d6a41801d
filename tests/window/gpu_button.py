# SPDX-License-Identifier: GPL-3.0-or-later
"""Presses Test My GPU in the preferences of a real Blender window, with real clicks: Esc stops it, and the second time it shows
its verdict, copies the report and saves it. Not collected by pytest; needs X11 and xdotool.

    blender --factory-startup --python tests/window/gpu_button.py -- dist/imprint-0.3.0.zip [PICTURE.png]

Blender exits with 1 if a part fails.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy

ARCHIVE, *PICTURE = sys.argv[sys.argv.index("--") + 1 :]
MODULE = "bl_ext.user_default.imprint"
PATIENCE = 150.0
"""Seconds to wait."""


def part(name):
    """A module of the installed extension."""
    return sys.modules[f"{MODULE}.addon.{name}"]


def step():
    """Run all parts. Yields the seconds to wait."""
    bpy.ops.extensions.package_install_files(filepath=ARCHIVE, repo="user_default", enable_on_install=True)
    yield 0.5
    bpy.context.preferences.active_section = "ADDONS"
    bpy.context.window_manager.addon_search = "Imprint"
    area().type = "PREFERENCES"
    yield 1.0
    bpy.ops.preferences.addon_expand(module=MODULE)
    area().tag_redraw()
    yield 1.0
    running, last = part("ui.modal").runner, part("ui.gpu_test").last
    yield from click("imprint.test_gpu")
    yield from until(lambda: running.run is not None)
    yield 1.5
    mouse("key", "Escape")
    yield from until(lambda: running.run is None)
    report("Esc stops it", running.run is None and last.report is None)
    yield from click("imprint.test_gpu")
    yield from until(lambda: running.run is not None)
    yield 3.0
    picture("running")
    report("a bar", part("ui.progress_display").display.current.what == "Testing the GPU")
    yield from until(lambda: running.run is None)
    yield 1.0
    picture("done")
    found = last.report
    print(found.text, flush=True)
    report("a verdict", found is not None and not found.wrong)
    report("in the clipboard", bpy.context.window_manager.clipboard == found.text)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gpu.json"
        bpy.ops.imprint.save_gpu_report(filepath=str(path))
        report("saved", json.loads(path.read_text())["machine"] == found.machine)


def area():
    """The largest area."""
    return max(bpy.context.window_manager.windows[0].screen.areas, key=lambda each: each.width * each.height)


def click(operator):
    """Click a button of the preferences, which are in the largest area."""
    window = bpy.context.window_manager.windows[0]
    region = next(each for each in area().regions if each.type == "WINDOW")
    top = window.height - region.y - region.height
    for y in range(top + 8, top + region.height, 10):
        for share in (0.35, 0.6, 0.8):
            mouse("mousemove", round(region.x + region.width * share), y)
            yield 0.04
            with bpy.context.temp_override(window=window, area=area(), region=region, screen=window.screen):
                copy = bpy.ops.ui.copy_python_command_button
                if copy.poll() and copy() == {"FINISHED"}:
                    named = bpy.context.window_manager.clipboard
                    if named.removeprefix("bpy.ops.").partition("(")[0] == operator:
                        mouse("click", 1)
                        yield 0.3
                        return
    picture("lost")
    report(f"find {operator}", False)


def mouse(*words):
    subprocess.run(["xdotool", *map(str, words)], check=True)


def until(is_done):
    waited = 0.0
    while not is_done():
        yield 0.2
        waited += 0.2
        if waited > PATIENCE:
            report("in time", False)


def picture(name):
    if PICTURE:
        path = Path(PICTURE[0])
        subprocess.run(["import", "-silent", "-window", "root", path.with_stem(f"{path.stem}-{name}")], check=True)


def report(what, is_right):
    print(f"{'right' if is_right else 'WRONG'}: {what}", flush=True)
    if not is_right:
        raise SystemExit(1)


steps = step()


def tick():
    seconds = next(steps, None)
    if seconds is None:
        window = bpy.context.window_manager.windows[0]
        with bpy.context.temp_override(window=window, area=area()):
            bpy.ops.wm.quit_blender()
    return seconds


bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(tick, first_interval=1.0, persistent=True)
