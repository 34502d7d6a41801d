# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows the result of a bake: the map in an open Image Editor, and the low mesh with it in the 3D viewport."""

import bpy

from ...core.report import Report
from ...scene import visibility
from ..bake_results import high_objects


def image(context: bpy.types.Context, shown: bpy.types.Image) -> bool:
    """Show an image in an Image Editor, if one is open that is not pinned to another. Returns whether there was one."""
    editors = _editors(context)
    free = [editor for editor in editors if editor.image == shown or not editor.use_image_pin]
    # One that shows it already, so that no other picture is replaced.
    editor = next((editor for editor in free if editor.image == shown), next(iter(free), None))
    if editor is not None:
        editor.image = shown
    return editor is not None


def is_open(shown: bpy.types.Image) -> bool:
    """Whether an Image Editor shows an image."""
    return any(editor.image == shown for editor in _editors(bpy.context))


def _editors(context: bpy.types.Context) -> list[bpy.types.SpaceImageEditor]:
    """The open Image Editors."""
    areas = [area for window in context.window_manager.windows for area in window.screen.areas]
    return [area.spaces.active for area in areas if area.type == "IMAGE_EDITOR"]


def image_in_window(context: bpy.types.Context, shown: bpy.types.Image) -> None:
    """Show an image in an open Image Editor, or else in a new window, as Blender shows renders."""
    if image(context, shown):
        return
    before = set(context.window_manager.windows)
    bpy.ops.wm.window_new()
    window = next(window for window in context.window_manager.windows if window not in before)
    area = window.screen.areas[0]
    area.type = "IMAGE_EDITOR"
    editor, (width, height) = area.spaces.active, (max(1, side) for side in shown.size)
    editor.image = shown
    editor.zoom_percentage = 90.0 * min(area.width / width, area.height / height)


def bake(context: bpy.types.Context, reports: list[Report]) -> None:
    """Show the first map, and the low mesh with it: Material Preview instead of Solid, and the high objects hidden.

    No editor is opened. The next bake of the same low object uses its high objects although they are hidden.
    """
    first = bpy.data.images.get(reports[0].image)
    if first is not None:
        image(context, first)
    area = viewport(context)
    if area is None:
        return
    shading = area.spaces.active.shading
    if shading.type == "SOLID" and all(map(_is_in_material, reports)):
        shading.type = "MATERIAL"
    if shading.type in {"MATERIAL", "RENDERED"}:
        for report in reports:
            hide_high(context, report, True)


def _is_in_material(report: Report) -> bool:
    """Whether the bake put a map into the materials of its low object."""
    settings = report.settings
    return bool((settings.get("material") and settings.get("normal")) or settings.get("connect_maps"))


def hide_high(context: bpy.types.Context, report: Report, hide: bool) -> None:
    """Hide the high objects of a bake in the view layer, or show them again."""
    there = set(context.view_layer.objects.values())  # not by name: a linked and a local object may share one
    for obj in high_objects(report):
        if obj in there:
            obj.hide_set(hide)


def hides_high(report: Report) -> bool:
    """Whether no high object of a bake is visible."""
    return not any(visibility.is_visible(obj) for obj in high_objects(report))


def selection(context: bpy.types.Context) -> None:
    """Frame the selected faces in the viewport, with X-Ray so that nothing covers them."""
    area = viewport(context)
    if area is None:
        return
    shading = area.spaces.active.shading
    if shading.type == "SOLID":
        shading.show_xray = True
    region = next(region for region in area.regions if region.type == "WINDOW")
    with context.temp_override(area=area, region=region):
        bpy.ops.view3d.view_selected()


def viewport(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D viewport of the context, or the largest one of its window; None if no 3D viewport is open."""
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area
    areas = context.window.screen.areas if context.window is not None else ()
    areas = [area for area in areas if area.type == "VIEW_3D"]
    return max(areas, key=lambda area: area.width * area.height, default=None)
