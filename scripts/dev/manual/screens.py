# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures that show Blender's window: the steps of the first map, the views, and each panel by itself.

Each function is a generator. It yields a number of seconds for which Blender is to go on, or a picture: (name, pixels).
"""

from collections.abc import Generator, Iterator

import bpy
import numpy as np
from mathutils import Vector

from scripts.dev.manual import models, window

Action = float | tuple[str, np.ndarray]
PANEL_SCALE = 1.3
"""Blender's interface in the pictures of panels, larger than usual."""
EDGE, TOP = 8, 500
"""Left margin of the sidebar, and height of its part down to the box below Live, in pixels at a scale of 1."""
BELOW = {"IMPRINT_PT_maps": "IMPRINT_PT_packing"}
"""Panels with a panel below them that is shown as well."""
PANELS = ("bake", "report", "checks", "view", "map", "maps", "output", "rays", "sequence", "convert", "levels")
"""The panels that have a picture of their own."""
TABS = 26
"""Width of the sidebar's column of tabs at a scale of 1, in pixels."""


def _prepare() -> Iterator[Action]:
    """The carved monkey and its low mesh, seen from the front left, with the sidebar open."""
    models.clear()
    high, low = models.monkeys()
    _, area, _ = window.viewport()
    space = area.spaces.active
    space.shading.type = "SOLID"
    space.show_region_ui, space.show_region_toolbar = True, False
    overlay = space.overlay
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = overlay.show_cursor = overlay.show_text = False
    space.show_gizmo_navigate = False
    for obj in (high, low):
        for collection in obj.users_collection:
            collection.objects.unlink(obj)
        bpy.context.scene.collection.objects.link(obj)  # one below the other in the Outliner
        obj.select_set(True)
    bpy.context.view_layer.objects.active = low
    space.region_3d.view_perspective = "PERSP"
    space.region_3d.view_rotation = (0.7845, 0.5736, -0.1368, -0.1924)
    yield 0.5
    window.region(area, "UI").active_panel_category = "Imprint"
    yield 0.5
    _frame()


def _frame() -> None:
    """Fill the viewport with what is selected."""
    _, area, _ = window.viewport()
    with window.override():
        bpy.ops.view3d.view_selected()
    area.spaces.active.region_3d.view_distance *= 0.8


def steps() -> Iterator[Action]:
    """docs/quick-start.md: from the selection to the map."""
    yield from _prepare()
    _, area, _ = window.viewport()
    settings, space = bpy.context.scene.imprint, area.spaces.active
    settings.samples = "4"
    space.show_region_ui = False
    yield 0.5
    yield "step-1-select", _viewport_and_outliner()
    space.show_region_ui = True
    yield 0.5
    yield "step-2-panel", _top_of_sidebar()
    _make_room()
    settings.samples = "16"  # slow enough for a picture of its middle
    with window.override():
        bpy.ops.imprint.bake("INVOKE_DEFAULT")
    while not _is_half_done():
        yield 0.1
    yield "step-3-bake", window.crop(window.box_of(area))
    yield from window.wait()
    settings.samples = "4"
    space.shading.type = "MATERIAL"
    space.shading.studio_light = "city.exr"  # shows detail better than the usual one
    space.shading.type = "SOLID"
    with window.override():
        bpy.ops.imprint.bake("INVOKE_DEFAULT")
    yield from window.wait()
    for obj in bpy.data.objects:
        obj.select_set(False)
    yield 8.0  # for the material's shaders and the small picture
    yield "step-4-result", window.crop(window.box_of(area))
    area.spaces.active.region_3d.view_distance /= 1.35
    bpy.context.scene.imprint_view.split = 0.365
    bpy.context.scene.imprint_view.mode = "SPLIT"
    yield from window.wait()
    yield 1.0
    yield "step-5-split", window.crop(window.box_of(area))
    bpy.context.scene.imprint_view.mode = "OFF"


def _is_half_done() -> bool:
    """Whether the bake that is going on shows something to look at."""
    from addon.ui.progress_display import display

    step = display.current
    return step is None or step.done > 0.4


def _top_of_sidebar() -> np.ndarray:
    """The sidebar down to the box below the button and Live."""
    _, area, _ = window.viewport()
    left, bottom, width, height = window.box_of(window.region(area, "UI"))
    return window.crop((left + EDGE, bottom + height - TOP, width - EDGE, TOP))


def _viewport_and_outliner() -> np.ndarray:
    """The viewport, and the Outliner and the properties on its right."""
    _, area, _ = window.viewport()
    left, bottom, width, height = window.box_of(area)
    outliner = window.largest("OUTLINER")
    return window.crop((left, bottom, outliner.x + outliner.width - left, height))


def views() -> Iterator[Action]:
    """docs/panels.md: what View shows, and the shells of Show Cage."""
    yield from _prepare()
    _, area, _ = window.viewport()
    area.spaces.active.show_region_ui = False
    yield 0.5
    _frame()
    area.spaces.active.region_3d.view_distance *= 1.15  # room for the legend
    with window.override():
        bpy.ops.imprint.bake(width=2048, height=2048, samples="1")  # more differ from the center's normal
    shown = bpy.context.scene.imprint_view
    for mode, name in (
        ("MAP", "view-map"),
        ("SPLIT", "view-split"),
        ("DEVIATION", "view-deviation"),
        ("BARE_DEVIATION", "view-without-map"),
    ):
        shown.mode, shown.limit, shown.split = mode, 20.0, 0.455
        yield from window.wait()
        yield 1.5
        yield name, _viewport_alone()
    shown.mode, shown.target, shown.limit = "DEVIATION", "godot", 5.0
    yield from window.wait()
    yield 1.5
    yield "view-target", _viewport_alone()
    shown.mode, shown.target = "OFF", "OWN"
    bpy.data.objects["monkey_high"].hide_set(True)
    with window.override():
        bpy.ops.imprint.show_cage()
    yield 1.0
    yield "cage", _viewport_alone()
    with window.override():
        bpy.ops.imprint.show_cage()


def _make_room() -> None:
    """Move what is shown out from under the sidebar."""
    _, area, _ = window.viewport()
    region = area.spaces.active.region_3d
    region.view_distance *= 1.12
    region.view_location += region.view_rotation @ Vector((0.09 * region.view_distance, 0, 0))


def _viewport_alone() -> np.ndarray:
    """The viewport without its headers."""
    _, area, _ = window.viewport()
    left, bottom, width, height = window.box_of(window.region(area, "WINDOW"))
    header = sum(window.region(area, kind).height for kind in ("HEADER", "TOOL_HEADER"))
    return window.crop((left, bottom, width, height - header))


def panels() -> Iterator[Action]:
    """docs/panels.md: each panel by itself, drawn by a copy of it in a tab of its own. Needs a window 1600 pixels high."""
    yield from _prepare()
    preferences = bpy.context.preferences
    preferences.view.ui_scale, preferences.system.use_region_overlap = PANEL_SCALE, False
    yield 0.5
    settings, shown = bpy.context.scene.imprint, bpy.context.scene.imprint_view
    settings.maps, settings.pack, settings.ao_limited = {"AO", "CURVATURE", "BASE_COLOR"}, "GLTF", True
    with window.override():
        bpy.ops.imprint.bake(width=1024, height=1024, rays=16)  # quickly
    for name in ("crate_low", "crate_high", "crate_high_2", "barrel_low", "barrel_high"):
        models.add(name, bpy.data.objects["monkey_low"].data).hide_set(True)  # a mesh that can be baked
    for name in PANELS:
        copies = _copies(f"IMPRINT_PT_{name}")
        if name == "output":
            settings.storage, settings.output, settings.export = "FILE", "//maps/{low}.png", "//{low}.glb"
        if name == "convert":
            settings.storage, settings.output, settings.export = "PACK", "", ""
            settings.convert_image = bpy.data.images["monkey_low_normal"]
        if name == "view":
            shown.mode, shown.target = "DEVIATION", "unreal"
            yield from window.wait()
        yield f"panel-{name}", (yield from _picture(copies))
        shown.mode, shown.target = "OFF", "OWN"
    preferences.view.ui_scale, preferences.system.use_region_overlap = 1.0, True
    settings.convert_image = None
    settings.maps, settings.pack, settings.ao_limited = set(), "NONE", False


def findings() -> Iterator[Action]:
    """docs/panels.md: the main panel with what is found before a bake. Needs a window 1600 pixels high."""
    yield from _prepare()
    preferences = bpy.context.preferences
    preferences.view.ui_scale, preferences.system.use_region_overlap = PANEL_SCALE, False
    yield 0.5
    settings, low = bpy.context.scene.imprint, bpy.context.view_layer.objects.active
    layers = low.data.uv_layers
    settings.green, settings.uv_layer = "-Y", layers.active.name
    layers.active = layers.new(name="Lightmap")
    low.data.polygons.foreach_set("use_smooth", np.zeros(len(low.data.polygons), bool))
    low.data.update()
    yield "panel-findings", (yield from _picture(_copies("IMPRINT_PT_bake")))
    preferences.view.ui_scale, preferences.system.use_region_overlap = 1.0, True
    settings.green, settings.uv_layer = "+Y", ""


def _picture(copies: list[type]) -> Generator[float, None, np.ndarray]:
    """What the sidebar shows of these panels, which are removed again."""
    for copy in copies:
        bpy.utils.register_class(copy)
    yield 0.5
    _, area, _ = window.viewport()
    sidebar = window.region(area, "UI")
    sidebar.active_panel_category = copies[0].bl_category
    yield 2.5  # the panel opens, and the small picture is made
    left, bottom, width, height = window.box_of(sidebar)
    header = sum(window.region(area, kind).height for kind in ("HEADER", "TOOL_HEADER"))
    tabs = round(TABS * PANEL_SCALE)
    pixels = window.crop((left, bottom, width - tabs, min(height, area.height - header)))
    for copy in reversed(copies):
        bpy.utils.unregister_class(copy)
    return window.trimmed(pixels)


def _copies(idname: str) -> list[type]:
    """Copies of a panel and of those below it, open, in a tab that holds nothing else."""
    original = getattr(bpy.types, idname)
    category = f"Imprint {original.bl_label}" if original.bl_label != "Imprint" else "Imprint "
    fields = {"bl_idname": f"{idname}_picture", "bl_category": category, "bl_options": set(), "bl_parent_id": ""}
    copies = [window.copy_of(original, **fields)]
    if idname in BELOW:
        below = getattr(bpy.types, BELOW[idname])
        fields = {"bl_idname": f"{BELOW[idname]}_picture", "bl_category": category, "bl_options": set()}
        copies.append(window.copy_of(below, **fields, bl_parent_id=copies[0].bl_idname))
    return copies
