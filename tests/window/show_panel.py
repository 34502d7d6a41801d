# SPDX-License-Identifier: GPL-3.0-or-later
"""The first button of the first minute: Show Panel opens a sidebar that was never drawn, at the tab Imprint. From factory
settings, by a real key, in a Blender with a window, X11 and xdotool:

    blender --factory-startup --python tests/window/show_panel.py
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import addon  # noqa: E402
from tests.support import window  # noqa: E402

KEY = "F19"


def sidebar() -> bpy.types.Region:
    _, area, _ = window.view()
    return next(region for region in area.regions if region.type == "UI")


def step() -> Iterator[float]:
    addon.register()
    keymap = bpy.context.window_manager.keyconfigs.addon.keymaps.new("3D View", space_type="VIEW_3D")
    keymap.keymap_items.new("imprint.show_panel", KEY, "PRESS")
    yield 1.0
    for start in ("a sidebar that was never open", "a sidebar that was closed", "an open sidebar at another tab"):
        area = window.view()[1]
        if "closed" in start:
            area.spaces.active.show_region_ui = False
        elif "another" in start:
            sidebar().active_panel_category = "View"
        yield 0.5
        assert "open" in start or not area.spaces.active.show_region_ui, start
        yield from window.keys(KEY)
        yield 1.5
        assert window.view()[1].spaces.active.show_region_ui, start
        assert sidebar().active_panel_category == "Imprint", (start, sidebar().active_panel_category)
        print(f"Imprint is shown after {start}", flush=True)
    addon.unregister()


if __name__ == "__main__":
    window.start(step())
