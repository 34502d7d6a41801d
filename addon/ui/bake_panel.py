# SPDX-License-Identifier: GPL-3.0-or-later
"""The main panel: the slots of the objects with their operators, size and samples, and the Bake button with what it will do,
or why it cannot."""

from collections.abc import Sequence

import bpy
from bpy.props import FloatProperty, IntProperty, StringProperty

from ..core.declarations.choices import Method, Space
from ..core.declarations.map_settings import MAX_SIZE
from ..core.errors import BakeError, named, shorten_list
from ..core.naming import ATLAS
from ..core.sentences import LOOK, NOTE, WRONG
from ..core.settings import Settings
from ..jobs import fixes
from ..jobs.job import check_materials, covers_detail
from ..output import datablocks, outputs
from ..scene import evaluation, object_checks
from ..scene.mesh_elements import weights_problem
from . import bake_queue, object_pairs, results, sets, sets_panel, several
from .callbacks import until_change
from .findings import findings
from .fix_buttons import ICONS, RIGHT, Told, draw_button, draw_fixable, draw_list, draw_packing
from .live import live
from .modal import QuickOperator
from .planned_images import count_images, filled, planned_images
from .progress_display import MAIN, OF_SETS, display
from .properties import Chosen, ImprintSettings
from .results_panel import draw_batch, draw_numbers
from .setting_rows import Rows, is_beside_unsaved
from .texts import LABEL, SidebarPanel, draw_paragraphs, label, labeled, message, split_layout


class IMPRINT_UL_highs(bpy.types.UIList):
    """The slots for high objects."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_property) -> None:
        layout.prop(item, "object", text="", emboss=True)
        if item.called and item.find() is None:
            layout.label(text=item.title, icon="ERROR", translate=False)


class IMPRINT_OT_show_hidden(QuickOperator, bpy.types.Operator):
    """Show the hidden high objects in the viewport"""

    bl_idname = "imprint.show_hidden"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}

    def apply(self, context: bpy.types.Context) -> str:
        for obj in context.scene.imprint.chosen(context).hidden(context):
            evaluation.show_object(context, obj)
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


COMMON_SIZES = (512, 1024, 2048, 4096, 8192)


class IMPRINT_OT_resize(bpy.types.Operator):
    """Change the size of the map; a map that is not square keeps its shape"""

    bl_idname = "imprint.resize"
    bl_label = "Resize Map"
    bl_options = {"REGISTER", "UNDO"}

    side: labeled(IntProperty, "Side", "Texels along the longer side; 0 to scale", default=0, min=0, max=MAX_SIZE)
    factor: labeled(FloatProperty, "Factor", "By how much both sides are scaled", default=1.0, min=0.0, max=64.0)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = sets.whole(context)
        factor = self.side / max(settings.width, settings.height) if self.side else self.factor
        # The properties keep each side within its limits.
        settings.width, settings.height = (round(side * factor) for side in (settings.width, settings.height))
        return {"FINISHED"}


class IMPRINT_MT_size(bpy.types.Menu):
    """Common sizes of maps."""

    bl_idname = "IMPRINT_MT_size"
    bl_label = "Size"
    bl_translation_context = LABEL

    def draw(self, _context: bpy.types.Context) -> None:
        for side in COMMON_SIZES:
            self.layout.operator("imprint.resize", text=str(side), translate=False).side = side
        self.layout.separator()
        for text, factor in ((label("Double"), 2.0), (label("Halve"), 0.5)):
            self.layout.operator("imprint.resize", text=text, translate=False).factor = factor


def draw_size(layout: bpy.types.UILayout, rows: Rows) -> None:
    """The size in a panel, with its menu."""
    is_square = rows["square"] and rows["width"] == rows["height"]
    column = layout.column(align=True)
    row = column.row(align=True)
    row.prop(*rows.at_head("size" if is_square else "width"))
    row.prop(*rows.at_head("square"), text="", icon="LINKED" if is_square else "UNLINKED")
    row.menu(IMPRINT_MT_size.bl_idname, text="", icon="DOWNARROW_HLT")
    rows.pin(row, "size")
    if not is_square:
        column.prop(*rows.at_head("height"))


MOST_CHECKED = 4
"""Of several low objects, those of which more than UV maps is checked at each redraw. The bake checks all."""


def problems(
    context: bpy.types.Context, all_chosen: Sequence[Chosen], more: Sequence[bpy.types.Object]
) -> dict[bpy.types.Object | None, str]:
    """Why low objects cannot be baked, in sentences. more: of which UV maps alone are checked."""
    found = {chosen.low: bake_problem(context, chosen) for chosen in all_chosen}
    for low in filter(object_checks.lacks_uvs, more):
        chosen = context.scene.imprint.alone(context, low)
        found[low] = object_checks.problem(context, low, chosen.highs, chosen.cage, chosen.rays.method)
    return {low: reason for low, reason in found.items() if reason}


def bake_problem(context: bpy.types.Context, chosen: Chosen) -> str:
    """Why the button cannot bake, in a sentence; empty if no problem is visible."""
    low, highs, values = chosen.low, chosen.highs, chosen.settings
    try:
        values.check()
    except BakeError as error:
        return str(error)
    reason = _missing(chosen.missing[0]) if chosen.missing else ""
    reason = reason or object_checks.problem(context, low, highs, chosen.cage, values.tracing.method)
    if not reason and _is_unsaved(chosen):
        reason = message("The files of the bake go beside the .blend file: save it first.")
    reason = reason or _material_problem(low, values) or weights_problem(low, values.tracing) or _clash(low, values)
    return reason or covers_detail(low, highs, [image.name for image in planned_images(low, values)])


def _missing(name: str) -> str:
    """What is the matter with a high object that is missing, in a sentence."""
    return message(object_pairs.why_missing(name)).format(repr(name))


def _is_unsaved(chosen: Chosen) -> bool:
    """Whether the maps go beside a .blend file that was never saved."""
    return is_beside_unsaved(chosen.panel.storage, chosen.panel.output)


def _material_problem(low: bpy.types.Object, values: Settings) -> str:
    """Why the maps cannot be put into the materials of `low`; empty if they can, or are not."""
    try:
        check_materials(low, values)
    except BakeError as error:
        return str(error)
    return ""


def _clash(low: bpy.types.Object, settings: Settings) -> str:
    """Why texture sets cannot have the names of the settings; empty if they can."""
    try:
        filled(low, settings)
    except BakeError as error:
        return str(error)
    return ""


def describe_hidden(objects: Sequence[bpy.types.Object]) -> str:
    """That these objects are hidden, in a sentence."""
    text = message("{} is hidden.") if len(objects) == 1 else message("{} are hidden.")
    return text.format(shorten_list(repr(obj.name) for obj in objects))


def is_normal_only(settings: Settings) -> bool:
    """Whether the button bakes the normal map and no other map."""
    return settings.map.normal and not settings.map.drawn_maps


def describe_bake(chosen: Chosen) -> str:
    """What the button will do, in a sentence."""
    low, highs, settings = chosen.low, chosen.highs, chosen.panel
    action = {
        Method.AUTO: message("Bakes {highs} onto {low}"),
        Method.FLATTEN: message("Flattens {highs} onto {low}"),
        Method.CAST: message("Casts rays from {low} to {highs}"),
    }[chosen.rays.method]
    if object_checks.shows_own_surface(low, highs):
        action = message("Bakes the materials and the shape of {low} itself")
    space = {
        Space.TANGENT: message("tangent space"),
        Space.OBJECT: message("object space"),
        Space.WORLD: message("world space"),
    }[settings.space]
    objects = {
        "low": repr(low.name),
        "highs": message("its own modifiers") if low in highs else named(high.name for high in highs),
    }
    first = planned_images(low, chosen.settings)[0]
    target = message("over the image {}") if datablocks.get(first.name) else message("into a new image {}")
    parts = [
        space,
        f"{settings.width} x {settings.height}",
        target.format(repr(first.name)),
    ]
    replaced = outputs.replaced(first.name, [high.name for high in highs])
    if replaced:
        parts.append(message("which holds a map of {}").format(replaced))
    if first.path:
        parts.append(message("to the file {}").format(repr(first.path)))
    return f"{action.format(**objects)}: {', '.join(parts)}."


def describe_several(context: bpy.types.Context, lows: Sequence[bpy.types.Object]) -> str:
    """What the button will do with several low objects, in a sentence."""
    settings = context.scene.imprint

    def are_own() -> bool:
        return all(object_checks.shows_own_surface(low, settings.alone(context, low).highs) for low in lows)

    if until_change.get("own surfaces", tuple(low.session_uid for low in lows), are_own):
        action = message("Bakes the materials and the shape of {} objects, each onto itself")
    else:
        action = message("Bakes {} objects, each onto itself or with the detail of its pair")
    first = planned_images(lows[0], settings.to_settings(), ATLAS if settings.share_image else "")[0]
    into = message("into one image {}") if settings.share_image else message("into images such as {}")
    size = f"{settings.width} x {settings.height}"
    return f"{action.format(len(lows))}: {size}, {into.format(repr(first.name))}."


class IMPRINT_PT_bake(SidebarPanel, bpy.types.Panel):
    """The objects to bake, what the button takes from them, and the button. All above the button keeps its height."""

    bl_idname = "IMPRINT_PT_bake"
    bl_label = "Imprint"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings, rows = self.layout, context.scene.imprint, Rows(context)
        row = layout.row()
        row.enabled = display.current is None and not live.is_on
        row.row(align=True).prop(settings, "bakes", expand=True)
        if settings.bakes != "SETS":  # with sets, it is beside their list
            row.operator("imprint.set_add", text="", icon="ADD")
        if settings.bakes == "SETS" and not live.is_on:
            _draw_set(layout, context, rows)
        else:
            self.draw_selection(layout, context, rows)

    def draw_selection(self, layout: bpy.types.UILayout, context: bpy.types.Context, rows: Rows) -> None:
        """The slots and the button for what is selected."""
        settings = context.scene.imprint
        lows = several.lows(context, settings)
        all_chosen = [settings.alone(context, low) for low in lows[:MOST_CHECKED]] or [settings.chosen(context)]
        chosen = all_chosen[0]  # of the active object
        # Live does not depend on the selection.
        reasons = {} if live.is_on else problems(context, all_chosen, lows[MOST_CHECKED:])
        problem = next(iter(reasons.values()), "") if len(reasons) == max(1, len(lows)) else ""
        is_planned = not (live.is_on or problem or chosen.low in reasons)
        told = findings.told(context, chosen) if is_planned else []
        column = layout.column()
        column.enabled = display.current is None and not live.is_on
        _draw_slots(column, settings, _sign(problem, told))
        _draw_settings(layout, rows)
        _draw_button(layout, MAIN, chosen.settings, enabled=not problem)
        row = layout.row()
        row.enabled = display.current is None and (live.is_on or not problem)
        row.operator("imprint.live", icon="PLAY", depress=live.is_on)
        row.prop(settings, "live_every_time")
        if lows and not live.is_on:
            _draw_several(layout.box(), context, lows, all_chosen[0], reasons)
        else:
            _draw_plan(layout.box(), context, chosen, problem, told)
        draw_batch(layout, context)
        if live.is_on and live.message:
            draw_fixable(layout.box(), context, live.message, "ERROR")
        elif live.session is not None and live.session.differences:
            draw_paragraphs(layout.box(), context, live.session.differences, "INFO")


def _draw_set(layout: bpy.types.UILayout, context: bpy.types.Context, rows: Rows) -> None:
    """The sets, and the buttons that bake the active one."""
    column = layout.column()
    column.enabled = display.current is None
    sets_panel.draw_lists(column, context, rows)
    if rows.set is None:
        return
    problem = sets_panel.problem(context, rows)
    _draw_settings(layout, rows)
    button = _draw_button(layout, OF_SETS, rows.settings, enabled=not problem)
    if button is not None:
        button.name = rows.set.name
    sets_panel.draw_changed(layout, rows.set, enabled=display.current is None and not problem)
    sets_panel.draw_box(layout.box(), context, rows, problem)
    bake_queue.draw(layout, context)


NARROW = 0.24
"""The share of the name of a setting whose values are long."""


def _draw_settings(layout: bpy.types.UILayout, rows: Rows) -> None:
    """The settings that each bake needs."""
    column = split_layout(layout.column())
    column.enabled = display.current is None
    row = column.row(align=True).split(factor=NARROW, align=True)
    row.use_property_split = False
    name = row.row()
    name.alignment = "RIGHT"
    name.label(text=label("Engine"), translate=False)
    row = row.row(align=True)
    row.prop(*rows.at_head("engine"), text="")
    row.popover(panel="IMPRINT_PT_presets", icon="PRESET", text="")
    rows.pin(row, "engine")
    draw_size(column, rows)
    row = rows.row(column)
    row.prop(*rows.at_head("samples"))
    rows.pin(row, "samples")


def _draw_button(
    layout: bpy.types.UILayout, operator: str, settings: Settings, *, enabled: bool
) -> bpy.types.OperatorProperties | None:
    """The button that bakes. Returns its properties, or None for the bar in its place."""
    row = layout.row()
    row.scale_y = 1.6
    text = label("Bake Normal Map") if is_normal_only(settings) else label("Bake Maps")
    return display.draw_operator(row, operator, enabled=enabled, text=text, translate=False, icon="RENDER_STILL")


def _sign(problem: str, told: Sequence[Told]) -> str:
    """The icon of a pair: whether it can be baked, and will look right."""
    if problem:
        return ICONS[WRONG]
    return ICONS[told[0].harm] if told and told[0].harm is not NOTE else RIGHT


def _draw_slots(layout: bpy.types.UILayout, settings: ImprintSettings, sign: str) -> None:
    """The objects, and the sign of their pair."""
    layout.label(text=label("High"), translate=False)
    row = layout.row()
    row.template_list("IMPRINT_UL_highs", "", settings, "highs", settings, "active_high", rows=2, maxrows=5)
    buttons = row.column(align=True)
    buttons.operator("imprint.high_add", text="", icon="ADD")
    buttons.operator("imprint.high_remove", text="", icon="REMOVE")
    layout.prop(settings, "low")
    row = layout.row()
    row.operator("imprint.use_selection", icon="RESTRICT_SELECT_OFF")
    row.label(text="", icon=sign)


MOST_NOTES = 3
"""Low objects that cannot be baked, of several, that the panel names."""


def _draw_plan(
    box: bpy.types.UILayout,
    context: bpy.types.Context,
    chosen: Chosen,
    problem: str,
    told: Sequence[Told],
) -> None:
    """What the button will do, or why it cannot, with buttons for what fixes it."""
    if live.is_on:
        draw_fixable(box, context, live.description, "BLANK1")
    elif problem:
        draw_fixable(box, context, problem, "ERROR")
        draw_remedy(box, context, chosen)
    else:
        draw_paragraphs(box, context, [describe_bake(chosen)], "BLANK1")
        box.label(text=count_images(chosen.low, chosen.settings), translate=False)
        draw_asset(box, chosen)
        _draw_left_out(box, context, chosen)
        _draw_switch(box, context, chosen)
        _draw_state(box, context, chosen)
        draw_list(box, context, told)
        box.operator("imprint.look_at_high", icon="VIEWZOOM")
        draw_paragraphs(box, context, findings.look_of(chosen.low, chosen.highs), "BLANK1")


def _draw_several(
    box: bpy.types.UILayout,
    context: bpy.types.Context,
    lows: Sequence[bpy.types.Object],
    first: Chosen,
    reasons: dict[bpy.types.Object, str],
) -> None:
    """What the button will do with several low objects, and why it cannot with some."""
    settings = context.scene.imprint
    if len(reasons) < len(lows):
        draw_paragraphs(box, context, [describe_several(context, lows)], "BLANK1")
    for low, reason in list(reasons.items())[:MOST_NOTES]:
        draw_fixable(box, context, reason, "ERROR", low.name)
        if object_checks.lacks_uvs(low):
            draw_button(box, fixes.UNWRAP, low.name)
    fine = [low for low in lows if low not in reasons]
    draw_list(box, context, findings.of_several(context, str([low.session_uid for low in fine]), lambda: fine))
    if reasons and _is_unsaved(first):
        box.operator("wm.save_mainfile", icon="FILE_TICK")
    box.prop(settings, "share_image")
    if settings.share_image:
        draw_packing(box, selected=True)


def _draw_left_out(box: bpy.types.UILayout, context: bpy.types.Context, chosen: Chosen) -> None:
    """Which selected objects are left out since they are low ones, too. A set takes all."""
    lows = several.others(context, chosen.panel, chosen.low) if chosen.panel.low is None else []
    if lows:
        text = message("Left out, since a name or a pair calls them low: {}").format(named(low.name for low in lows))
        draw_paragraphs(box, context, [text], ICONS[LOOK])


def _draw_switch(box: bpy.types.UILayout, context: bpy.types.Context, chosen: Chosen) -> None:
    """Where several objects with UV maps are selected and nothing but their place makes them a pair, a button that bakes each
    for itself."""
    objects = several.candidates(context, chosen.panel)
    if objects and chosen.low not in chosen.highs and not any(map(object_checks.lacks_uvs, objects)):
        row = box.row()
        row.enabled = display.current is None
        row.operator(MAIN, text=label("Each Onto Itself"), translate=False, icon="RENDER_STILL").each = True


def draw_remedy(layout: bpy.types.UILayout, context: bpy.types.Context, chosen: Chosen) -> None:
    """A button for a high object that is missing, a low object without UVs, a file that was never saved, or objects that are
    hidden."""
    if chosen.missing:
        layout.operator("imprint.remove_missing", icon="X").high = chosen.missing[0]
    elif object_checks.lacks_uvs(chosen.low):
        draw_button(layout, fixes.UNWRAP, chosen.low.name)
        draw_asset(layout, chosen)
    elif _is_unsaved(chosen):
        layout.operator("wm.save_mainfile", icon="FILE_TICK")
    elif chosen.hidden(context):
        layout.operator("imprint.show_hidden", icon="HIDE_OFF")


def draw_asset(layout: bpy.types.UILayout, chosen: Chosen) -> None:
    """For an object alone, a button that takes it for a high object and makes the low one. With modifiers that add detail and a
    UV map it is a low object already."""
    is_low = object_checks.own_highs(chosen.low) and not object_checks.lacks_uvs(chosen.low)
    if chosen.low.select_get() and list(chosen.highs) == [chosen.low] and not is_low:
        display.draw_operator(layout, "imprint.make_asset", enabled=True, icon="MESH_ICOSPHERE")


def _draw_state(layout: bpy.types.UILayout, context: bpy.types.Context, chosen: Chosen) -> None:
    """What the last bake has made, and that high objects are hidden, which a bake reads nevertheless. Two rows in any case, so
    that nothing below moves when a bake is done, which hides the high objects."""
    reports, hidden = results.all_of(context, chosen.low), chosen.hidden(context)
    row = layout.row(align=True)
    if reports:
        draw_numbers(row, reports, is_told=True)
    else:
        row.label(text=message("Never baked"), icon="RADIOBUT_OFF", translate=False)
    for operator, icon, is_enabled in (
        ("imprint.show_hidden", "HIDE_ON" if hidden else "HIDE_OFF", bool(hidden)),
        ("imprint.show_map", "IMAGE_DATA", bool(reports)),
        ("imprint.export", "EXPORT", bool(reports)),
    ):
        part = row.row(align=True)
        part.enabled = is_enabled
        part.operator(operator, text="", icon=icon)
    if hidden:
        draw_paragraphs(layout, context, [describe_hidden(hidden)], ICONS[NOTE])
    else:
        layout.label(text="")


CLASSES = (
    IMPRINT_UL_highs,
    IMPRINT_OT_show_hidden,
    IMPRINT_OT_remove_missing,
    IMPRINT_OT_use_selection,
    IMPRINT_OT_high_add,
    IMPRINT_OT_high_remove,
    IMPRINT_MT_size,
    IMPRINT_OT_resize,
    IMPRINT_PT_bake,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
