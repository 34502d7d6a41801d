# SPDX-License-Identifier: GPL-3.0-or-later
"""The main panel: the objects, the Bake button, and the result of the last bake."""

from collections.abc import Iterable, Sequence

import bpy

from ...core.report import Report
from ...jobs.readiness import Finding
from ...output import map_images
from ...scene import scene_lengths
from ..bake_results import high_objects, results
from ..live.live_switch import live
from ..readiness.cure_operators import draw_button, draw_cured
from ..readiness.panel_findings import findings
from ..translations import label, message
from ..viewport import show_result
from ..viewport.progress_display import display
from . import bake_plan
from .sidebar import SidebarPanel, draw_paragraphs


class IMPRINT_UL_highs(bpy.types.UIList):
    """The slots for high objects."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_property) -> None:
        layout.prop(item, "object", text="", emboss=True)
        if item.called and item.find() is None:
            layout.label(text=item.title, icon="ERROR", translate=False)


class IMPRINT_PT_bake(SidebarPanel, bpy.types.Panel):
    """The objects to bake, and the Bake button."""

    bl_idname = "IMPRINT_PT_bake"
    bl_label = "Imprint"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.imprint
        column = layout.column()
        column.label(text=label("High"), translate=False)
        row = column.row()
        row.template_list("IMPRINT_UL_highs", "", settings, "highs", settings, "active_high", rows=2, maxrows=5)
        buttons = row.column(align=True)
        buttons.operator("imprint.high_add", text="", icon="ADD")
        buttons.operator("imprint.high_remove", text="", icon="REMOVE")
        column.prop(settings, "low")
        column.operator("imprint.use_selection", icon="RESTRICT_SELECT_OFF")

        low, highs = settings.chosen_objects(context)
        problem = bake_plan.problem(context, low, highs, settings)
        following = live.description
        if following:
            problem = ""  # Live does not depend on the selection
        box = layout.box()
        if following or problem:
            draw_cured(box, context, following or problem, "ERROR" if problem else "INFO")
            if problem:
                draw_remedy(box, context, low, highs)
        else:
            draw_paragraphs(box, context, [bake_plan.plan(low, highs, settings)], "INFO")
            box.label(text=bake_plan.count(low, settings), translate=False)
            draw_paragraphs(box, context, [bake_plan.warning(low, highs)], "ERROR")
            draw_hidden(box, context, settings.hidden(context, low, highs))
            found = findings.of(
                context, low, highs, settings.settings_for(low, highs), is_exported=bool(settings.export)
            )
            draw_findings(box, context, found)
        # The bar replaces the button: nothing moves under the mouse when a bake begins or ends.
        row = layout.row()
        row.scale_y = 1.6
        step = display.current
        if step is None:
            row.enabled = not problem
            if bake_plan.is_normal_only(settings):
                row.operator("imprint.bake", icon="RENDER_STILL")
            else:
                row.operator("imprint.bake", text=label("Bake Maps"), translate=False, icon="RENDER_STILL")
        else:
            row.progress(factor=step.done, text=display.short_text(), translate=False)
        row = layout.row()
        row.enabled = step is None and (live.is_on or not problem)
        row.operator("imprint.live", icon="PLAY", depress=live.is_on)
        row.prop(settings, "live_every_time")
        if live.is_on and live.message:
            draw_cured(layout.box(), context, live.message, "ERROR")
        reports = results.all_of(context)
        if reports:
            draw_result(layout, reports)


def draw_remedy(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    low: bpy.types.Object | None,
    highs: Sequence[bpy.types.Object],
) -> None:
    """A button for a high object that is missing, else one for those that are hidden."""
    settings = context.scene.imprint
    missing = settings.missing(context, low, highs)
    if missing:
        layout.operator("imprint.remove_missing", icon="X").high = missing[0]
    elif settings.hidden(context, low, highs):
        layout.operator("imprint.show_hidden", icon="HIDE_OFF")


def draw_hidden(layout: bpy.types.UILayout, context: bpy.types.Context, hidden: Sequence[bpy.types.Object]) -> None:
    """That high objects are hidden, which a bake reads nevertheless, and a button that shows them."""
    if hidden:
        draw_paragraphs(layout, context, [bake_plan.hidden(hidden)], "INFO")
        layout.operator("imprint.show_hidden", icon="HIDE_OFF")


def draw_findings(layout: bpy.types.UILayout, context: bpy.types.Context, found: Sequence[Finding]) -> None:
    """What is wrong with the low object for other programs, and a button that cures it."""
    for finding in found:
        text = message(finding.template).format(**finding.values)
        draw_paragraphs(layout, context, [text], "ERROR" if finding.harms else "INFO")
        draw_button(layout, finding.kind)


def draw_result(layout: bpy.types.UILayout, reports: Sequence[Report]) -> None:
    """The result of the last bake in a line, beside a small picture of the map, and a button for each of several maps.

    reports: of each texture set.
    """
    report = reports[0]
    box = layout.box()
    row = box.row()
    image = bpy.data.images.get(report.image)
    if image is not None:
        row.template_icon(row.icon(image), scale=2.6)
    column = row.column(align=True)
    head = column.row()
    head.label(text=report.image, translate=False)
    if high_objects(report):
        is_hidden = show_result.hides_high(report)
        head.operator("imprint.show_high", text="", icon="HIDE_ON" if is_hidden else "HIDE_OFF", emboss=False)
    if image is None:
        column.label(text=message("The image was undone, renamed or deleted"), icon="INFO", translate=False)
    else:
        draw_figures(column, reports)
    names = list(dict.fromkeys(name for report in reports for name in report.images))
    if len(names) > 1:
        draw_maps(box, names)
    if any(map_images.are_any(report.maps) for report in reports):
        layout.operator("imprint.connect_maps", icon="NODE_MATERIAL")
    layout.operator("imprint.export", icon="EXPORT")


def draw_figures(layout: bpy.types.UILayout, reports: Sequence[Report]) -> None:
    """The number of warnings, or else the covered share, and the time."""
    number = len(_warnings(reports))
    if number:
        line = (message("1 warning") if number == 1 else message("{} warnings")).format(number)
    else:
        line = message("{} covered").format(f"{reports[0].coverage:.0%}")
    line = f"{line}, {sum(report.seconds['total'] for report in reports):.1f} s"
    layout.label(text=line, icon="ERROR" if number else "CHECKMARK", translate=False)


def draw_maps(layout: bpy.types.UILayout, names: Iterable[str]) -> None:
    """A button for each of these images, which shows it. Those that are open in an editor are pressed."""
    column = layout.column(align=True)
    for name in names:
        image = bpy.data.images.get(name)
        row = column.row(align=True)
        row.enabled = image is not None
        is_open = image is not None and show_result.is_open(image)
        button = row.operator(
            "imprint.show_map", text=name, translate=False, icon="IMAGE_DATA", depress=is_open, emboss=is_open
        )
        button.image = name


def _warnings(reports: Sequence[Report]) -> list[str]:
    """The warnings of all reports and of the exported file, each of them once."""
    found = (warning for report in reports for warning in (*report.warnings, *report.export.get("warnings", ())))
    return list(dict.fromkeys(found))


class IMPRINT_PT_report(SidebarPanel, bpy.types.Panel):
    """What the last bake did, and its warnings."""

    bl_idname = "IMPRINT_PT_report"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Report"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.of(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        reports = results.all_of(context)
        for warning in _warnings(reports):
            draw_cured(self.layout, context, warning, "ERROR")
        for report in reports:
            draw_paragraphs(self.layout, context, report.summary(scene_lengths.of(context.scene)), "DOT")


CLASSES = (IMPRINT_UL_highs, IMPRINT_PT_bake, IMPRINT_PT_report)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
