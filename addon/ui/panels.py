# SPDX-License-Identifier: GPL-3.0-or-later
"""The "Imprint" tab of the 3D viewport's sidebar. It draws properties and messages, and decides nothing."""

import textwrap
from functools import lru_cache

import bpy

from ..core import name_matching
from ..core.errors import BakeError
from ..core.report import Report
from ..output import image_writer
from ..scene import bake_objects
from . import live_mode, map_size, results
from .presets import IMPRINT_PT_conventions
from .properties import ImprintSettings
from .viewport import cage_overlay, progress_display, show_result


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Imprint"
    bl_order = 1  # below the checks of the last bake


class IMPRINT_UL_highs(bpy.types.UIList):
    """The slots for high objects."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_property) -> None:
        layout.prop(item, "object", text="", emboss=True)


class IMPRINT_PT_bake(_Panel, bpy.types.Panel):
    """What is baked, and the button."""

    bl_idname = "IMPRINT_PT_bake"
    bl_label = "Imprint"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.imprint
        column = layout.column()
        column.label(text="High")
        row = column.row()
        row.template_list("IMPRINT_UL_highs", "", settings, "highs", settings, "active_high", rows=2, maxrows=5)
        buttons = row.column(align=True)
        buttons.operator("imprint.high_add", text="", icon="ADD")
        buttons.operator("imprint.high_remove", text="", icon="REMOVE")
        column.prop(settings, "low")
        column.operator("imprint.use_selection", icon="RESTRICT_SELECT_OFF")

        low, highs = settings.subjects(context)
        problem = _problem(context, low, highs, settings)
        following = live_mode.words()
        if following:
            problem = ""  # the selection may be what it likes
        lines = [following or problem] if following or problem else _plan(low, highs, settings)
        paragraphs(layout.box(), context, lines, "ERROR" if problem else "INFO")
        # The bar takes the button's place: nothing moves under the mouse when a bake begins or ends.
        row = layout.row()
        row.scale_y = 1.6
        step = progress_display.current()
        if step is None:
            row.enabled = not problem
            row.operator("imprint.bake", icon="RENDER_STILL")
        else:
            row.progress(factor=step.done, text=progress_display.short(step))
        row = layout.row()
        is_live = live_mode.session() is not None
        row.enabled = step is None and (is_live or not problem)
        row.operator("imprint.live", icon="PLAY", depress=is_live)
        row.prop(settings, "live_every_time")
        if is_live and live_mode.message:
            paragraphs(layout.box(), context, [live_mode.message], "ERROR")
        report = results.of(context)
        if report is not None:
            _draw_result(layout, report)


def _draw_result(layout: bpy.types.UILayout, report: Report) -> None:
    """What came out of the last bake in a line, beside a small picture of it."""
    row = layout.box().row()
    image = bpy.data.images.get(report.image)
    if image is not None:
        row.template_icon(row.icon(image), scale=2.6)
    column = row.column(align=True)
    head = column.row()
    head.label(text=report.image)
    if results.high_objects(report):
        is_hidden = show_result.hides_high(report)
        head.operator("imprint.show_high", text="", icon="HIDE_ON" if is_hidden else "HIDE_OFF", emboss=False)
    if image is None:  # nothing came of it in the end
        column.label(text="Undone, renamed or deleted", icon="INFO")
        return
    number = len(report.warnings)
    line = f"{number} {'warning' if number == 1 else 'warnings'}" if number else f"{report.coverage:.0%} covered"
    column.label(text=f"{line}, {report.seconds['total']:.1f} s", icon="ERROR" if number else "CHECKMARK")


class IMPRINT_PT_report(_Panel, bpy.types.Panel):
    """What the last bake did, in words."""

    bl_idname = "IMPRINT_PT_report"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Report"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 0  # above the checks

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.of(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        report = results.of(context)
        paragraphs(self.layout, context, report.warnings, "ERROR")
        paragraphs(self.layout, context, report.summary(), "DOT")


class IMPRINT_PT_map(_Panel, bpy.types.Panel):
    """What the map is like."""

    bl_idname = "IMPRINT_PT_map"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Map"

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        IMPRINT_PT_conventions.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.imprint
        layout.prop(settings, "method")
        layout.prop(settings, "space")
        if settings.space == "TANGENT":
            layout.prop(settings, "basis")
        low, _ = settings.subjects(context)
        if low is not None and low.type == "MESH":
            layout.prop_search(settings, "uv_layer", low.data, "uv_layers", icon="GROUP_UVS")
        map_size.draw(layout, settings)
        layout.prop(settings, "samples")
        column = layout.column(align=True)
        column.prop(settings, "margin_type")
        row = column.row(align=True)
        row.active = not settings.unlimited
        row.prop(settings, "margin")
        column.prop(settings, "unlimited")
        column.prop(settings, "mips", text="Clean Mips")
        layout.prop(settings, "modifiers")
        column = layout.column(align=True)
        column.prop(settings, "limited")
        if settings.limited:
            column.prop(settings, "limit")


class IMPRINT_PT_channels(_Panel, bpy.types.Panel):
    """What each channel holds; the presets in the map's header set it."""

    bl_idname = "IMPRINT_PT_channels"
    bl_parent_id = "IMPRINT_PT_map"
    bl_label = "Channels"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column(align=True)
        for name in ("red", "green", "blue"):
            column.prop(context.scene.imprint, name)


class IMPRINT_PT_output(_Panel, bpy.types.Panel):
    """Where the map goes."""

    bl_idname = "IMPRINT_PT_output"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Output"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.imprint
        layout.prop_search(settings, "image", bpy.data, "images")
        layout.prop(settings, "depth", expand=True)
        if settings.depth == "8":
            layout.prop(settings, "dither")
        layout.prop(settings, "udim")
        if settings.udim:
            layout.prop(settings, "tiles")
        layout.column().prop(settings, "maps")
        layout.prop(settings, "storage")
        if settings.storage == "FILE":
            layout.prop(settings, "output")
        layout.prop(settings, "material")
        row = layout.row()
        row.enabled = settings.material
        row.prop(settings, "single_user")
        layout.prop(settings, "show_result")


class IMPRINT_PT_rays(_Panel, bpy.types.Panel):
    """Where rays start and end."""

    bl_idname = "IMPRINT_PT_rays"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Rays"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene.imprint.method != "FLATTEN"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.imprint
        found = context.window_manager.imprint_found
        layout.prop(settings, "cage")
        layout.prop(settings, "measure")
        column = layout.column(align=True)
        if settings.measure:
            column.enabled = False
            column.prop(found, "extrusion")
            column.prop(found, "max_distance")
            layout.operator("imprint.freeze_distances", icon="FREEZE")
        else:
            column.prop(settings, "extrusion")
            column.prop(settings, "max_distance")
        layout.operator("imprint.show_cage", icon="MESH_UVSPHERE", depress=cage_overlay.is_on())
        layout.prop(settings, "directions")
        layout.prop(settings, "facing_only")
        layout.prop(settings, "missed")
        layout.prop(settings, "mask")


class IMPRINT_PT_pairs(_Panel, bpy.types.Panel):
    """Many at once, by name."""

    bl_idname = "IMPRINT_PT_pairs"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Pairs by Name"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.imprint
        row = layout.row(align=True)
        for name in ("low_suffix", "high_suffix", "cage_suffix"):
            row.prop(settings, name, text="")
        try:
            found, problems = _pairs(tuple(context.view_layer.objects.keys()), settings.suffixes())
        except BakeError as error:
            found, problems = [], [str(error)]
        box = layout.box()
        paragraphs(box, context, [f"{pair.low}: {', '.join(pair.highs)}" for pair in found], "CHECKMARK")
        paragraphs(box, context, problems, "ERROR")
        if not found and not problems:
            paragraphs(box, context, ["No object has one of these endings."], "INFO")
        layout.prop(settings, "share_image")
        row = layout.row()
        row.enabled = bool(found)
        row.operator("imprint.bake_pairs", icon="RENDER_STILL")


class IMPRINT_PT_sequence(_Panel, bpy.types.Panel):
    """A map for each frame."""

    bl_idname = "IMPRINT_PT_sequence"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Sequence"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.prop(context.scene, "frame_start", text="First")
        row.prop(context.scene, "frame_end", text="Last")
        row = layout.row()
        row.enabled = context.scene.imprint.storage == "FILE"
        row.operator("imprint.bake_sequence", icon="RENDER_ANIMATION")
        if not row.enabled:
            paragraphs(layout, context, ["A sequence is files: store the map in a file."], "INFO")


@lru_cache(maxsize=1)
def _pairs(names: tuple[str, ...], suffixes: name_matching.Suffixes) -> tuple[list[name_matching.Pair], list[str]]:
    """As name_matching.match, which looks at each name: not at each redraw, but where a name or an ending has changed."""
    return name_matching.match(names, suffixes)


def _problem(
    context: bpy.types.Context,
    low: bpy.types.Object | None,
    highs: list[bpy.types.Object],
    settings: ImprintSettings,
) -> str:
    """What is missing, in words; empty when nothing shows."""
    try:
        settings.to_settings().check()
    except BakeError as error:
        return str(error)
    return bake_objects.problem(context, low, highs, settings.cage_for(settings.method), settings.method)


def _plan(low: bpy.types.Object, highs: list[bpy.types.Object], settings: ImprintSettings) -> list[str]:
    """What a press of the button will do, in words."""
    source = "its own modifiers" if low in highs else ", ".join(repr(high.name) for high in highs)
    name = image_writer.name_for(low.name, settings.to_settings())
    known = "over the image" if bpy.data.images.get(name) else "into a new image"
    other = image_writer.replaced(name, [high.name for high in highs])
    over = f", which holds a map of {other}" if other else ""
    how = {"AUTO": "Bakes", "FLATTEN": "Flattens", "CAST": "Casts rays from"}[settings.method]
    onto = f"{low.name!r} to {source}" if settings.method == "CAST" else f"{source} onto {low.name!r}"
    lines = [
        f"{how} {onto}: {settings.space.lower()} space, {settings.width} x {settings.height}, {known} {name!r}{over}."
    ]
    if _is_swapped(low, highs):
        lines.append(f"{low.name!r} has more faces than {source}: the low object is the active one, selected last.")
    return lines


def _is_swapped(low: bpy.types.Object, highs: list[bpy.types.Object]) -> bool:
    """Whether high and low look like each other's. What modifiers and instances add is not known without evaluating them."""
    if low in highs or any(high.type != "MESH" or high.modifiers or high.mode == "SCULPT" for high in highs):
        return False
    return len(low.data.polygons) > sum(len(high.data.polygons) for high in highs)


def paragraphs(layout: bpy.types.UILayout, context: bpy.types.Context, lines: list[str], icon: str) -> None:
    """Lines wrapped to the width of the sidebar; Blender's labels do not wrap by themselves."""
    width = max(20, int(context.region.width / (7.0 * context.preferences.system.ui_scale)) - 6)
    column = layout.column(align=True)
    for line in lines:
        for number, part in enumerate(textwrap.wrap(line, width)):
            column.label(text=part, icon="BLANK1" if number else icon)


CLASSES = (
    IMPRINT_UL_highs,
    IMPRINT_PT_bake,
    IMPRINT_PT_report,
    IMPRINT_PT_map,
    IMPRINT_PT_channels,
    IMPRINT_PT_output,
    IMPRINT_PT_rays,
    IMPRINT_PT_pairs,
    IMPRINT_PT_sequence,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
