# SPDX-License-Identifier: GPL-3.0-or-later
"""Cures what is found before a bake, and undoes and redoes each cure, in a real Blender window. Not collected by pytest.

    blender --factory-startup --python tests/window/cure_buttons.py

It prints what the box shows after each cure. Blender exits with 1 if a cure, or its undo, is wrong, or if a redraw looks at the
mesh again.
"""

import sys
import time
from pathlib import Path

import bpy

sys.path[:0] = [str(Path(__file__).resolve().parents[2]), str(Path(__file__).resolve().parent)]


import addon  # noqa: E402
from addon.ui.checks import findings  # noqa: E402
from tests.support import window, zoo  # noqa: E402

KINDS = ("LAYER", "HARD_EDGES", "POLYGONS")


def step():
    """Run all parts. Yields the seconds to wait."""
    addon.register()
    prepare()
    yield 1.0
    show_panel()
    yield 1.0
    wrong = []
    if shown() != {"POLYGONS", "LAYER", "HARD_EDGES"}:
        wrong.append(f"the box shows {shown()}")
    looks = findings.looks
    for _ in range(10):
        redraw()
        yield 0.05
    if findings.looks != looks:
        wrong.append("a redraw looks at the mesh again")
    for kind in KINDS:
        start = time.monotonic()
        press(kind)
        yield 0.5
        after = shown()
        print(f"{kind:10} leaves {sorted(after)}", flush=True)
        if kind in after:
            wrong.append(f"{kind} is not cured")
        with window.at_view():
            bpy.ops.ed.undo()
        yield 0.5
        if kind not in shown():
            wrong.append(f"Undo of {kind} leaves {shown()}")
        with window.at_view():
            bpy.ops.ed.redo()
        yield 0.5
        if kind in shown():
            wrong.append(f"Redo of {kind} leaves {shown()}")
        print(f"{'':10} {time.monotonic() - start:.1f} s", flush=True)
    print(wrong or "as promised", flush=True)
    addon.unregister()
    if wrong:
        raise SystemExit(1)


def prepare():
    """A low object with flat faces and two UV maps, for a program with green down."""
    with window.at_view():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
    low, high = zoo.terrain("lo", 8, smooth=False), zoo.terrain("hi", 24)
    high.hide_set(True)
    low.data.uv_layers.new(name="Second")
    low.data.uv_layers.active = low.data.uv_layers["Second"]
    settings = bpy.context.scene.imprint
    settings.low, settings.green, settings.uv_layer = low, "-Y", zoo.LAYER
    settings.highs.add().object = high
    window.view()[1].spaces.active.show_region_ui = True
    with window.at_view():
        bpy.ops.ed.undo_push(message="prepared")


def show_panel():
    """Show the tab of the panel, which exists once the sidebar was drawn."""
    _, area, _ = window.view()
    next(region for region in area.regions if region.type == "UI").active_panel_category = "Imprint"


def shown():
    """The kinds that the box shows."""
    return {finding.kind for finding in findings.known}


def redraw():
    window.view()[1].tag_redraw()


def press(kind):
    with window.at_view():
        bpy.ops.imprint.cure("INVOKE_DEFAULT", True, kind=kind)


if __name__ == "__main__":  # otherwise, another script calls step()
    window.start(step())
