# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws all panels in a sidebar as Blender opens it, of 280 pixels, in a language of the interface, for a look at texts that
are cut off. Not collected by pytest.

    blender --factory-startup --window-geometry 0 0 700 2200 --python tests/window/narrow_panels.py -- FOLDER [LOCALE]

Needs ImageMagick, and X11 (or Xvfb) with a screen of that size and of 96 dpi (Xvfb -dpi 96), or Blender draws at another
scale. The pictures are FOLDER/LOCALE-GROUP.png. The texts are translated before Blender gets them, so a Blender that was built
without languages will do.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.ui import texts  # noqa: E402


def speak(locale: str) -> None:
    """Make the add-on's texts those of a language. Call it before the modules of the interface are imported."""
    known = texts.read_translations(locale)

    def translated(kind: Callable) -> Callable:
        def make(**how):
            for item in (how["items"],) if isinstance(how.get("items"), list) else ():
                item[:] = [(one[0], known.get((texts.LABEL, one[1]), one[1]), *one[2:]) for one in item]
            name = how.get("name", "")
            return kind(**{**how, "name": known.get((texts.LABEL, name), name)})

        return make

    for name in ("Bool", "Int", "Float", "FloatVector", "String", "Enum", "Pointer", "Collection"):
        setattr(bpy.props, f"{name}Property", translated(getattr(bpy.props, f"{name}Property")))
    texts.label = lambda text: known.get((texts.LABEL, text), text)
    texts.message = lambda text: known.get((texts.SENTENCE, text), text)
    import addon

    for module in addon.modules():
        for cls in getattr(module, "CLASSES", ()):
            context = texts.OPERATOR if issubclass(cls, bpy.types.Operator) else texts.LABEL
            cls.bl_label = known.get((context, getattr(cls, "bl_label", "")), getattr(cls, "bl_label", ""))


GIVEN = globals().get("ARGS") or sys.argv[sys.argv.index("--") + 1 :]
FOLDER, LOCALE = Path(GIVEN[0]), GIVEN[1] if len(GIVEN) > 1 else "en"
if LOCALE != "en":
    speak(LOCALE)

import addon  # noqa: E402
from addon.ui import settings_panels  # noqa: E402
from addon.ui.setting_rows import Rows  # noqa: E402
from addon.ui.texts import SidebarPanel  # noqa: E402
from scripts.dev.manual import window as screen  # noqa: E402
from tests.support import window, zoo  # noqa: E402

GROUPS = {
    "bake": ("bake", "maps", "packing"),
    "map": ("map", "rays", "output", "more_settings"),
    "results": ("results", "report", "checks"),
    "more": ("view", "sequence", "levels", "convert"),
}
"""The panels of each picture."""


class OtherMaps(SidebarPanel):
    """The groups of maps that are closed at first."""

    bl_label = "Other Maps"

    def draw(self, context: bpy.types.Context) -> None:
        rows = Rows(context)
        for names in settings_panels.groups().values():
            settings_panels.draw_group(self.layout, context, rows, names)


def step() -> Iterator[float]:
    """Make the pictures; yields the seconds to wait."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    addon.register()
    with window.at_view():
        bpy.ops.screen.screen_full_area(use_hide_panels=True)
    yield 0.5
    _prepare()
    yield 0.5
    yield from _open()
    for group, panels in GROUPS.items():
        copies = [_copy(group, getattr(bpy.types, f"IMPRINT_PT_{name}")) for name in panels]
        if group == "bake":
            others = (OtherMaps, bpy.types.Panel)
            copies.append(type("IMPRINT_PT_others_narrow", others, {"bl_category": f"N {group}"}))
        for copy in copies:
            bpy.utils.register_class(copy)
        yield 1.0
        _sidebar().active_panel_category = f"N {group}"
        _, area, _ = window.view()
        area.tag_redraw()
        yield 3.0
        pixels = screen.crop(screen.box_of(_sidebar()))
        screen.save(FOLDER / f"{LOCALE}-{group}.png", screen.trimmed(pixels))
        for copy in reversed(copies):
            bpy.utils.unregister_class(copy)
    addon.unregister()


def _sidebar() -> bpy.types.Region:
    _, area, _ = window.view()
    return screen.region(area, "UI")


def _copy(group: str, original: type) -> type:
    """An open copy of a panel in the tab of its picture."""
    fields = {"bl_category": f"N {group}", "bl_options": set(), "bl_parent_id": "", "bl_order": 0}
    return screen.copy_of(original, **fields, bl_idname=f"{original.__name__}_narrow")


def _prepare() -> None:
    """A pair that was baked with several maps, another one by name, and all that opens further rows."""
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    bpy.context.view_layer.update()
    low, high = zoo.terrain("crate_low", n=8), zoo.terrain("crate_high", n=24, height=0.15)
    zoo.plane("barrel_low"), zoo.plane("barrel_high", 4)
    bpy.context.view_layer.update()
    window.select_only(low)
    settings = bpy.context.scene.imprint
    settings.low = low
    settings.highs.add().object = high
    settings.maps, settings.pack = {"AO", "CURVATURE", "THICKNESS", "ATTRIBUTE"}, "CUSTOM"
    settings.ao_limited = settings.limited = settings.thickness_limited = settings.curvature_limited = True
    settings.attribute = "UVMap"
    settings.width = settings.height = 128
    with window.at_view():
        bpy.ops.imprint.bake(method="CAST")
    bpy.context.scene.imprint_view.mode = "SPLIT"
    settings.storage, settings.depth, settings.udim, settings.square = "FILE", "8", True, False
    settings.output = "/tmp/maps/{name}.png"
    settings.convert_image = bpy.data.images["crate_low_normal"]
    settings.pack_red, settings.basis = "WIDENED_ROUGHNESS", "MIKKTSPACE_VERTEX"  # the longest choices
    bpy.context.scene.imprint_view.target = "substance-per-fragment"
    settings.from_space = "TANGENT"


def _open() -> Iterator[float]:
    """Open the sidebar, which has the width that Blender gives it."""
    _, area, _ = window.view()
    area.spaces.active.show_region_ui = True
    yield 1.0
    print(f"the sidebar has {_sidebar().width} pixels, at {bpy.context.preferences.system.ui_scale:.3f}", flush=True)


if __name__ == "__main__":
    window.start(step())
