# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels about what was baked: the results of all low objects, and the report of the last bake of one."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import bpy

from ..core.report import Report
from ..core.sentences import LOOK, NOTE, WRONG
from ..jobs.part_state import Status
from ..output import materials
from ..scene import reading
from . import bake_results, object_pairs, results, signs
from .fix_buttons import ICONS, RIGHT, SIGNS, Told, draw_told, grouped
from .held_files import held_files
from .results import high_objects
from .texts import SidebarPanel, draw_paragraphs, message

MOST = 24
"""Results that the list shows: those with warnings first, so that none of these is left out before the others."""


class IMPRINT_PT_results(SidebarPanel, bpy.types.Panel):
    """What was baked: a row for each low object, with its first warning, and the maps of that of the panel."""

    bl_idname = "IMPRINT_PT_results"
    bl_label = "Results"
    bl_order = 3  # the last one: what it shows moves nothing else

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.has_any(context) or bool(results.batch().left_out or held_files.told)

    def draw(self, context: bpy.types.Context) -> None:
        if held_files.told:
            draw_paragraphs(self.layout.box(), context, held_files.told, "INFO")
        listed, left_out = results.of_scene(context), results.batch().left_out
        if left_out:
            _draw_left_out(self.layout.box(), context, left_out)
        if len(listed) > 1:
            _draw_list(self.layout, context, listed)
        reports = results.all_of(context)
        if reports:
            draw_result(self.layout, reports)
            _draw_sign(self.layout, context, reports[0].refs[0].find())


def _draw_sign(layout: bpy.types.UILayout, context: bpy.types.Context, low: bpy.types.Object) -> None:
    """What has changed since the last bake of a low object; nothing if nothing has."""
    found = signs.of_past(context, low)
    if found.status in {Status.CHANGED, Status.FAILED}:
        draw_paragraphs(layout, context, [found.text], found.icon)


def _draw_left_out(layout: bpy.types.UILayout, context: bpy.types.Context, left_out: Sequence[tuple[str, str]]) -> None:
    """What the last bake of pairs left out, and why: equal reasons once."""
    for each in _reasons(left_out):
        for low in each.lows:
            row = layout.row(align=True)
            button = row.operator("imprint.select_result", text=low, translate=False, icon=ICONS[WRONG])
            button.low = low
            mark = row.row()
            mark.alignment = "RIGHT"
            mark.label(text=message("not baked"), translate=False)
        draw_told(layout, context, each, is_below_row=bool(each.lows))


def _reasons(left_out: Iterable[tuple[str, str]]) -> list[Told]:
    """Why low objects were left out."""
    return grouped((low, replace(Told.of(reason), harm=WRONG)) for low, reason in left_out)


MOST_WRONG = 6
"""Sentences of the main panel after a bake of pairs, about those that were left out and those with warnings."""


def draw_batch(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Which pairs of the last bake of pairs are wrong, and why, in a box, the worst first. Nothing if none is, and after
    another bake."""
    batch = results.batch()
    warned = [
        (low.name, Told.of(told[0]))
        for low, reports in results.of_scene(context)
        if low.name in batch.baked and (told := results.warnings_of(reports)) and told[0].harm is not NOTE
    ]
    if not (batch.baked and (batch.left_out or warned)):
        return
    box, number = layout.box(), len(batch.baked) + len(batch.left_out)
    for text, count, told in (
        (message("Not baked: {} of {} low objects"), len(batch.left_out), _reasons(batch.left_out)),
        (message("With warnings: {} of {} low objects"), len(warned), grouped(warned)),
    ):
        if told:
            box.label(text=text.format(count, number), icon=ICONS[told[0].harm], translate=False)
            for each in told[:MOST_WRONG]:
                named = replace(each, text=_of_low(each), fixes=each.fixes if each.lows else ())
                draw_told(box, context, named, is_below_row=True)
            if len(told) > MOST_WRONG:
                more = message("And {} more in Results").format(len(told) - MOST_WRONG)
                box.label(text=more, icon="BLANK1", translate=False)


def _of_low(told: Told) -> str:
    """A sentence that names its low object."""
    low = told.lows[0] if len(told.lows) == 1 else ""
    return told.text if not low or repr(low) in told.text else f"{low}: {told.text}"


def _draw_list(
    layout: bpy.types.UILayout, context: bpy.types.Context, listed: Sequence[tuple[bpy.types.Object, list[Report]]]
) -> None:
    """What is wrong with several low objects, the worst first, and a row for each: its sign, the low object, the number of its
    maps, and the time; below it what is wrong with it alone."""
    box, current = layout.box(), context.scene.imprint.low or context.active_object
    worst = {low.name: results.warnings_of(reports)[:1] for low, reports in listed}
    told = grouped((low, Told.of(found[0])) for low, found in worst.items() if found and found[0].harm is not NOTE)
    alone = {each.lows[0]: each for each in told if len(each.lows) == 1}
    for each in [each for each in told if len(each.lows) > 1][:MOST_WRONG]:
        draw_told(box, context, each)
    ordered = sorted(listed, key=lambda result: SIGNS.index(sign(result[1])))
    for low, reports in ordered[:MOST]:
        row = box.row(align=True)
        button = row.operator(
            "imprint.select_result", text=low.name, translate=False, icon=sign(reports), depress=low == current
        )
        button.low = low.name
        maps = len({name for report in reports for name in report.images})
        number = row.row()
        number.alignment = "RIGHT"
        text = (message("1 map") if maps == 1 else message("{} maps")).format(maps) + f", {_seconds(reports)}"
        number.label(text=text, translate=False)
        row.label(text="", icon=signs.of_past(context, low).icon)
        if low.name in alone:
            draw_told(box, context, alone[low.name], is_below_row=True)
    if len(ordered) > MOST:
        box.label(text=message("And {} more without warnings").format(len(ordered) - MOST), translate=False)


def sign(reports: Sequence[Report]) -> str:
    """The icon of a result: that of its worst warning, or of one to look at if an image is gone."""
    told = results.warnings_of(reports)
    is_gone = any(name not in bpy.data.images for report in reports for name in report.images)
    found = {ICONS[text.harm] for text in told if text.harm is not NOTE} | ({ICONS[LOOK]} if is_gone else set())
    return next((icon for icon in SIGNS if icon in found), RIGHT)


def _seconds(reports: Sequence[Report]) -> str:
    return f"{sum(report.seconds['total'] for report in reports):.1f} s"


def draw_result(layout: bpy.types.UILayout, reports: Sequence[Report]) -> None:
    """The result of the last bake in a line, beside a small picture of the map, and a button for each map.

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
        is_hidden = bake_results.hides_high(report)
        head.operator("imprint.show_high", text="", icon="HIDE_ON" if is_hidden else "HIDE_OFF", emboss=False)
    if image is None:
        column.label(text=message("The image was undone, renamed or deleted"), icon="INFO", translate=False)
    else:
        draw_numbers(column, reports)
    names = list(dict.fromkeys([*(name for one in reports for name in one.images), *_of_live(report)]))
    draw_maps(box, names)
    if any(materials.takes_any(report.maps) for report in reports):
        layout.operator("imprint.connect_maps", icon="NODE_MATERIAL")
    layout.operator("imprint.one_material", icon="MATERIAL")
    layout.operator("imprint.export", icon="EXPORT")


def draw_numbers(layout: bpy.types.UILayout, reports: Sequence[Report], *, is_told: bool = False) -> None:
    """The number of warnings, or else the covered share, and the time. is_told: whether the warnings are told elsewhere."""
    number = sum(text.harm is not NOTE for text in results.warnings_of(reports))
    if number and not is_told:
        line = (message("1 warning") if number == 1 else message("{} warnings")).format(number)
    else:
        line = message("{} covered").format(f"{reports[0].coverage:.0%}")
    line += f", {_seconds(reports)}"
    layout.label(text=line, icon="BLANK1" if is_told else sign(reports), translate=False)


def _of_live(report: Report) -> list[str]:
    """The images of the low object that no report has, as those of Live."""
    pair = object_pairs.of(report.refs[0].find())
    return [] if pair is None else [one.image.name for one in pair.maps if one.image is not None]


def draw_maps(layout: bpy.types.UILayout, names: Iterable[str]) -> None:
    """A button for each of these images, which shows it. Those that are open in an editor are pressed."""
    column = layout.column(align=True)
    for name in names:
        image = bpy.data.images.get(name)
        row = column.row(align=True)
        row.enabled = image is not None
        is_open = image is not None and bake_results.is_image_open(image)
        button = row.operator(
            "imprint.show_map", text=name, translate=False, icon="IMAGE_DATA", depress=is_open, emboss=is_open
        )
        button.image = name


class IMPRINT_PT_report(SidebarPanel, bpy.types.Panel):
    """What the last bake did, and its warnings."""

    bl_idname = "IMPRINT_PT_report"
    bl_parent_id = "IMPRINT_PT_results"
    bl_label = "Report"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.of(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        reports = results.all_of(context)
        for text in results.warnings_of(reports):
            draw_told(self.layout, context, Told.of(text))
        for report in reports:
            draw_paragraphs(self.layout, context, report.summary(reading.lengths_of(context.scene)), "DOT")


CLASSES = (IMPRINT_PT_results, IMPRINT_PT_report)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
