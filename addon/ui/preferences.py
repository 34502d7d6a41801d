# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's entry in Blender's preferences: first steps, the GPU, and the address of a render farm."""

import tomllib
from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty

from ..core.errors import BakeError
from ..passes import allocation
from . import gpu_button
from .bake_results import find_viewport
from .callbacks import Timer
from .modal import QuickOperator
from .texts import SidebarPanel, labeled, message

MODULE = __package__.partition(".addon.")[0]
"""Blender's name for the extension."""
ROOT = Path(__file__).resolve().parents[2]
"""The folder of the extension."""


class IMPRINT_AP_preferences(bpy.types.AddonPreferences):
    """What the extension keeps in Blender's preferences, and the first steps."""

    bl_idname = MODULE

    flamenco: labeled(
        StringProperty,
        "Flamenco Manager",
        "Address of the Flamenco Manager that gets job files, as http://flamenco.local:8080",
    )

    gpu_memory: labeled(
        IntProperty,
        "GPU Memory (MiB)",
        "GPU memory for the maps of a bake, in MiB. Bakes that need more are drawn in more parts. Meshes and images need "
        "memory beside it",
        default=allocation.BUDGET // 2**20,
        min=allocation.LEAST_BUDGET,
        max=2**16,
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        text = message("The panel is in the sidebar of the 3D viewport: press N there, then the tab Imprint")
        layout.label(text=text, icon="INFO", translate=False)
        row = layout.row()
        row.operator("imprint.show_panel", icon="VIEW3D")
        row.operator("imprint.open_manual", icon="HELP")
        layout.prop(self, "gpu_memory")
        layout.prop(self, "flamenco")
        gpu_button.draw(layout, context)


def gpu_memory() -> int | None:
    """The GPU memory for maps in MiB as the preferences have it; None if this is no installed extension."""
    own = bpy.context.preferences.addons.get(MODULE)
    return own.preferences.gpu_memory if own and own.preferences else None


def flamenco_address(context: bpy.types.Context) -> str:
    """The address of the Flamenco Manager, or "" if none is set, or if this is no installed extension."""
    own = context.preferences.addons.get(MODULE)
    return own.preferences.flamenco.strip() if own and own.preferences else ""


class IMPRINT_OT_show_panel(QuickOperator, bpy.types.Operator):
    """Open the sidebar of the 3D viewport at the tab Imprint"""

    bl_idname = "imprint.show_panel"
    bl_label = "Show Panel"

    def apply(self, context: bpy.types.Context) -> str:
        area = _viewport(context)
        if area is None:
            raise BakeError("No 3D viewport is open: open one.")
        area.spaces.active.show_region_ui = True
        area.tag_redraw()
        if not _choose_tab(area):
            tab_choice.start(SOON)
        return ""


SOON, PATIENCE = 0.05, 100
"""Seconds between tries to choose the tab, and the number of tries: a sidebar has no tabs until it was drawn."""


def _viewport(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D viewport, of the first window that has one: the preferences are a window of their own."""
    for window in context.window_manager.windows:
        with context.temp_override(window=window, area=None):
            area = find_viewport(bpy.context)
        if area is not None:
            return area
    return None


def _choose_tab(area: bpy.types.Area) -> bool:
    """Choose the tab Imprint of the sidebar. Returns whether it has tabs yet."""
    sidebar = next(region for region in area.regions if region.type == "UI")
    try:
        sidebar.active_panel_category = SidebarPanel.bl_category
    except (AttributeError, TypeError):  # read-only until it is drawn, and then without tabs until their panels are
        return False
    return sidebar.active_panel_category == SidebarPanel.bl_category


class _TabChoice:
    """Tries again and again to choose the tab of a sidebar that is about to be drawn."""

    def __init__(self):
        self._timer, self._left = Timer(self._try), 0

    def start(self, seconds: float) -> None:
        self._left = PATIENCE
        self._timer.start(seconds)

    def _try(self) -> float | None:
        self._left -= 1
        area = _viewport(bpy.context)
        if area is None or not area.spaces.active.show_region_ui or _choose_tab(area):
            return None
        return SOON if self._left else None


tab_choice = _TabChoice()


class IMPRINT_OT_open_manual(bpy.types.Operator):
    """Open the manual: its site, or else the page that comes with the extension"""

    bl_idname = "imprint.open_manual"
    bl_label = "Manual"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return bpy.ops.wm.url_open(url=manual_address())


def manual_address() -> str:
    """The address of the manual."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    return manifest.get("website") or (ROOT / "README.md").as_uri()


CLASSES = (IMPRINT_OT_show_panel, IMPRINT_OT_open_manual, IMPRINT_AP_preferences)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Called when the extension is enabled."""
    _register()
    allocation.preferred = gpu_memory


def unregister() -> None:
    """Called when the extension is disabled."""
    allocation.preferred = allocation.no_preference
    _unregister()
