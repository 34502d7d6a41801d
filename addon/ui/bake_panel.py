# SPDX-License-Identifier: GPL-3.0-or-later
"""The main panel: the slots of the objects with their operators, the Bake button with what it will do or why it cannot, and the
result of the last bake."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import bpy
from bpy.props import IntProperty, StringProperty

from ..core.declarations.choices import Method, Space
from ..core.errors import BakeError, shorten_list
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import bake_jobs
from ..jobs.checks import Finding
from ..jobs.job import Job, by_material
from ..output import datablocks, map_names, materials, outputs
from ..scene import evaluation, object_checks, reading
from ..scene.mesh_elements import weights_problem
from . import bake_results, object_pairs
from .bake_results import high_objects, results
from .checks import draw_button, draw_fixable, findings
from .live import live
from .modal import QuickOperator
from .progress_display import display
from .properties import Chosen, ImprintSettings
from .texts import SidebarPanel, draw_paragraphs, label, labeled, message


class IMPRINT_UL_highs(bpy.types.UIList):
    """The slots for high objects."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_property) -> None:
        layout.prop(item, "object", text="", emboss=True)
        if item.called and item.find() is None:
            layout.label(text=item.title, icon="ERROR", translate=False)


class IMPRINT_OT_show_hidden(QuickOperator, bpy.types.Operator):
    """Show the hidden high objects in the viewport. Without others, they are selected"""

    bl_idname = "imprint.show_hidden"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}

    def apply(self, context: bpy.types.Context) -> str:
        chosen = context.scene.imprint.chosen(context)
        for obj in chosen.hidden(context):
            evaluation.show_object(context, obj)
            if not chosen.highs:
                obj.select_set(True)
        return ""


class IMPRINT_OT_remove_missing(bpy.types.Operator):
    """Remove a high object that was deleted from the slots, or from the pair of the low object"""

    bl_idname = "imprint.remove_missing"
    bl_label = "Remove"
    bl_options = {"REGISTER", "UNDO"}

    high: labeled(
        StringProperty, "High", "Name of the high object; empty for all that are missing", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        chosen = settings.chosen(context)
        for name in [self.high] if self.high else chosen.missing:
            obj = bpy.data.objects.get(name)
            for index in reversed([index for index, slot in enumerate(settings.highs) if slot.title == name]):
                settings.highs.remove(index)
            if chosen.pair is not None:
                chosen.pair.remove(name)
            object_pairs.free(obj)
        return {"FINISHED"}


class IMPRINT_OT_use_selection(bpy.types.Operator):
    """Fill the slots: the active object becomes the low object, the other selected objects with a surface the high objects"""

    bl_idname = "imprint.use_selection"
    bl_label = "Fill from Selection"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.active_object is not None and context.active_object.type == "MESH"

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        settings.low = context.active_object
        settings.highs.clear()
        for obj in context.view_layer.objects.selected:
            if obj != settings.low and object_checks.may_show(obj):
                settings.highs.add().object = obj
        return {"FINISHED"}


class IMPRINT_OT_high_add(bpy.types.Operator):
    """Add a slot for a high object"""

    bl_idname = "imprint.high_add"
    bl_label = "Add High Object"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        settings.highs.add()
        settings.active_high = len(settings.highs) - 1
        return {"FINISHED"}


class IMPRINT_OT_high_remove(bpy.types.Operator):
    """Remove a slot; its object stays in the scene"""

    bl_idname = "imprint.high_remove"
    bl_label = "Remove High Object"
    bl_options = {"REGISTER", "UNDO"}

    index: labeled(IntProperty, "Index", "Index of the slot, from 0; below 0 for the active slot", default=-1)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return len(context.scene.imprint.highs) > 0

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        settings.highs.remove(self.index if self.index >= 0 else settings.active_high)
        settings.active_high = max(0, min(settings.active_high, len(settings.highs) - 1))
        return {"FINISHED"}


def bake_problem(context: bpy.types.Context, chosen: Chosen) -> str:
    """Why the button cannot bake, in a sentence; empty if no problem is visible."""
    low, highs, values = chosen.low, chosen.highs, chosen.settings
    try:
        values.check()
    except BakeError as error:
        return str(error)
    reason = message(object_pairs.MISSING).format(repr(chosen.missing[0])) if chosen.missing else ""
    if not reason and low is not None and not highs and (waiting := chosen.hidden(context)):
        reason = describe_hidden(waiting)
    reason = reason or object_checks.problem(context, low, highs, chosen.cage, values.tracing.method)
    return reason or _material_problem(low, values) or weights_problem(low, values.tracing) or _clash(low, chosen.panel)


def _material_problem(low: bpy.types.Object, values: Settings) -> str:
    """Why the maps cannot be put into the materials of `low`; empty if they can, or are not."""
    try:
        if values.changes_materials:
            materials.check(low, can_be_off=not values.storing.connect_maps)
    except BakeError as error:
        return str(error)
    return ""


def _clash(low: bpy.types.Object, settings: ImprintSettings) -> str:
    """Why texture sets cannot have the names of the settings; empty if they can."""
    try:
        _filled(low, settings)
    except BakeError as error:
        return str(error)
    return ""


def describe_hidden(objects: Sequence[bpy.types.Object]) -> str:
    """That these objects are hidden, in a sentence."""
    text = message("{} is hidden.") if len(objects) == 1 else message("{} are hidden.")
    return text.format(shorten_list(repr(obj.name) for obj in objects))


def is_normal_only(settings: ImprintSettings) -> bool:
    """Whether the button bakes the normal map and no other map."""
    return settings.normal and not settings.to_settings().map.drawn_maps


def describe_bake(chosen: Chosen) -> str:
    """What the button will do, in a sentence."""
    low, highs, settings = chosen.low, chosen.highs, chosen.panel
    action = {
        Method.AUTO: message("Bakes {highs} onto {low}"),
        Method.FLATTEN: message("Flattens {highs} onto {low}"),
        Method.CAST: message("Casts rays from {low} to {highs}"),
    }[chosen.rays.method]
    space = {
        Space.TANGENT: message("tangent space"),
        Space.OBJECT: message("object space"),
        Space.WORLD: message("world space"),
    }[settings.space]
    objects = {
        "low": repr(low.name),
        "highs": message("its own modifiers") if low in highs else ", ".join(repr(high.name) for high in highs),
    }
    first = planned_images(low, settings)[0]
    target = message("over the image {}") if datablocks.get(first.name) else message("into a new image {}")
    parts = [
        space,
        f"{settings.width} x {settings.height}",
        target.format(repr(first.name)),
    ]
    replaced = outputs.replaced(first.name, [high.name for high in highs])
    if replaced:
        parts.append(message("which holds a map of {}").format(replaced))
    if first.file:
        parts.append(message("to the file {}").format(repr(first.file)))
    return f"{action.format(**objects)}: {', '.join(parts)}."


def count_images(low: bpy.types.Object, settings: ImprintSettings) -> str:
    """How many images the button fills, in a line: the box keeps its height, so that lists below it do not move."""
    return message("Images of this bake: {}").format(len(planned_images(low, settings)))


@dataclass(frozen=True)
class PlannedImage:
    """An image that a bake fills. file: the name of its file; empty without one."""

    name: str
    file: str

    @property
    def title(self) -> str:
        """The names of the image and the file."""
        return f"{self.name} ({self.file})" if self.file else self.name


def planned_images(low: bpy.types.Object, settings: ImprintSettings) -> list[PlannedImage]:
    """The images that a bake would fill: that of the report first, then the others. settings: valid."""
    return [image for filled in _filled(low, settings) for image in _images(filled)]


def _images(filled: Settings) -> list[PlannedImage]:
    """The images of one texture set."""
    by_map = map_names.settings_by_map(filled)
    first = map_names.first_map(filled.map)
    return [
        PlannedImage(of_map.storing.image, os.path.basename(bpy.path.abspath(map_names.output_for(of_map))))
        for of_map in [by_map.pop(first), *by_map.values()]
    ]


def _filled(low: bpy.types.Object, settings: ImprintSettings) -> list[Settings]:
    """The settings of each texture set, or of the whole low object, with names filled in. Raises BakeError for names that
    texture sets would share."""
    values = settings.to_settings()
    names = [job.material for job in by_material([Job(low, [])], values.storing)] if values.map.texture_sets else [""]
    return [bake_jobs.for_low(values, low.name, name) for name in names]


def swap_warning(low: bpy.types.Object, highs: list[bpy.types.Object]) -> str:
    """Why the objects may be the wrong ones, in a sentence; empty if they seem right."""
    if not object_checks.seem_swapped(low, highs):
        return ""
    return message(object_checks.SWAPPED).format(
        low=repr(low.name), highs=shorten_list(repr(high.name) for high in highs)
    )


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

        chosen = settings.chosen(context)
        problem = bake_problem(context, chosen)
        following = live.description
        if following:
            problem = ""  # Live does not depend on the selection
        box = layout.box()
        if following or problem:
            draw_fixable(box, context, following or problem, "ERROR" if problem else "INFO")
            if problem:
                draw_remedy(box, context, chosen)
        else:
            draw_paragraphs(box, context, [describe_bake(chosen)], "INFO")
            box.label(text=count_images(chosen.low, settings), translate=False)
            draw_paragraphs(box, context, [swap_warning(chosen.low, chosen.highs)], "ERROR")
            draw_hidden(box, context, chosen.hidden(context))
            found = findings.of(context, chosen.low, chosen.highs, chosen.settings, is_exported=bool(settings.export))
            draw_findings(box, context, found)
            box.operator("imprint.look_at_high", icon="VIEWZOOM")
            draw_paragraphs(box, context, findings.look_of(chosen.low, chosen.highs), "BLANK1")
        # The bar replaces the button: nothing moves under the mouse when a bake begins or ends.
        row = layout.row()
        row.scale_y = 1.6
        step = display.current
        if step is None:
            row.enabled = not problem
            if is_normal_only(settings):
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
            draw_fixable(layout.box(), context, live.message, "ERROR")
        reports = results.all_of(context)
        if reports:
            draw_result(layout, reports)


def draw_remedy(layout: bpy.types.UILayout, context: bpy.types.Context, chosen: Chosen) -> None:
    """A button for a high object that is missing, else one for those that are hidden."""
    if chosen.missing:
        layout.operator("imprint.remove_missing", icon="X").high = chosen.missing[0]
    elif chosen.hidden(context):
        layout.operator("imprint.show_hidden", icon="HIDE_OFF")


def draw_hidden(layout: bpy.types.UILayout, context: bpy.types.Context, hidden: Sequence[bpy.types.Object]) -> None:
    """That high objects are hidden, which a bake reads nevertheless, and a button that shows them."""
    if hidden:
        draw_paragraphs(layout, context, [describe_hidden(hidden)], "INFO")
        layout.operator("imprint.show_hidden", icon="HIDE_OFF")


def draw_findings(layout: bpy.types.UILayout, context: bpy.types.Context, found: Sequence[Finding]) -> None:
    """What is wrong with the low object for other programs, and a button that fixes it."""
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
        is_hidden = bake_results.hides_high(report)
        head.operator("imprint.show_high", text="", icon="HIDE_ON" if is_hidden else "HIDE_OFF", emboss=False)
    if image is None:
        column.label(text=message("The image was undone, renamed or deleted"), icon="INFO", translate=False)
    else:
        draw_numbers(column, reports)
    names = list(dict.fromkeys(name for report in reports for name in report.images))
    if len(names) > 1:
        draw_maps(box, names)
    if any(materials.takes_any(report.maps) for report in reports):
        layout.operator("imprint.connect_maps", icon="NODE_MATERIAL")
    layout.operator("imprint.export", icon="EXPORT")


def draw_numbers(layout: bpy.types.UILayout, reports: Sequence[Report]) -> None:
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
        is_open = image is not None and bake_results.is_image_open(image)
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
            draw_fixable(self.layout, context, warning, "ERROR")
        for report in reports:
            draw_paragraphs(self.layout, context, report.summary(reading.lengths_of(context.scene)), "DOT")


CLASSES = (
    IMPRINT_UL_highs,
    IMPRINT_OT_show_hidden,
    IMPRINT_OT_remove_missing,
    IMPRINT_OT_use_selection,
    IMPRINT_OT_high_add,
    IMPRINT_OT_high_remove,
    IMPRINT_PT_bake,
    IMPRINT_PT_report,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
