# SPDX-License-Identifier: GPL-3.0-or-later
"""What the main panel shows of sets: their list, the parts of the active one, its textures, and what will be baked.

Nothing above the Bake button changes its height with what is chosen or baked, so that the button stays where it is.
"""

import bpy
from bpy.props import PointerProperty

from ..core import naming
from ..core.errors import BakeError, shorten_list
from ..jobs import fixes
from ..jobs.part_state import Status
from ..scene import object_checks
from . import object_pairs, set_lists, set_operators, sets, signs
from .callbacks import registering, until_change
from .findings import findings
from .fix_buttons import draw_button, draw_fixable, draw_list, draw_packing
from .planned_images import PlannedImage, draw_images, of_texture
from .preferences import flamenco_address
from .progress_display import OF_SETS
from .sets import ImprintSet
from .setting_rows import Rows
from .texts import LABEL, SidebarPanel, draw_paragraphs, draw_props, label, labeled, message

SETS, PARTS = 3, 6
"""The rows of the lists."""
MOST_SHOWN = 16
"""The materials of a set that the panel lists."""


def _may_be_picked(scene: bpy.types.Scene, obj: bpy.types.Object) -> bool:
    return object_pairs.may_be_high(scene, obj) and obj != set_lists.chosen_low(bpy.context)


def _add_picked(scene: bpy.types.Scene, context: bpy.types.Context) -> None:
    """Make what was picked a high object of the active part, and empty the field again."""
    picked, low = scene.imprint_picked, set_lists.chosen_low(context)
    if picked is not None:
        scene.imprint_picked = None
        if low is not None:
            set_operators.add_highs(context, low, [picked])


class IMPRINT_MT_sets(bpy.types.Menu):
    """What is done with sets now and then."""

    bl_idname = "IMPRINT_MT_sets"
    bl_label = "Sets"
    bl_translation_context = LABEL

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator(OF_SETS, text=label("Bake All Sets"), translate=False, icon="RENDER_STILL")
        layout.operator("imprint.queue_add", text=label("Bake All in Queue"), translate=False, icon="TIME").all = True
        layout.separator()
        layout.operator("imprint.set_duplicate", icon="DUPLICATE")
        layout.operator("imprint.set_move", text=label("Move Up"), translate=False, icon="TRIA_UP").direction = "UP"
        layout.operator(
            "imprint.set_move", text=label("Move Down"), translate=False, icon="TRIA_DOWN"
        ).direction = "DOWN"
        _draw_own(layout, sets.active(context))
        layout.separator()
        text = label("Set of All Pairs by Name")
        layout.operator("imprint.set_add", text=text, translate=False, icon="OUTLINER_OB_FONT").by_name = True
        layout.separator()
        layout.operator("imprint.sets_to_job_file", icon="EXPORT")
        layout.operator("imprint.sets_from_job_file", icon="IMPORT")
        if flamenco_address(context):
            layout.operator("imprint.send_to_flamenco", icon="EXPORT")


def _draw_own(layout: bpy.types.UILayout, one: ImprintSet | None) -> None:
    """The entry that gives all settings that are the set's own back to the scene."""
    row = layout.row()
    row.enabled = one is not None and bool(one.own.names_of_own())
    text = label("Use the Scene's Settings")
    row.operator("imprint.set_own", text=text, translate=False, icon="LOOP_BACK").setting = ""


class IMPRINT_MT_part_highs(bpy.types.Menu):
    """Removes a high object from the active part."""

    bl_idname = "IMPRINT_MT_part_highs"
    bl_label = "Remove High"
    bl_translation_context = LABEL

    def draw(self, context: bpy.types.Context) -> None:
        low = set_lists.chosen_low(context)
        for high in set_lists.part_of(context, sets.active(context), low).highs if low is not None else ():
            button = self.layout.operator("imprint.set_high_remove", text=high, translate=False, icon="REMOVE")
            button.low, button.high = low.name, high


class IMPRINT_PT_set_source(SidebarPanel, bpy.types.Panel):
    """Where the parts of the active set come from."""

    bl_idname = "IMPRINT_PT_set_source"
    bl_label = "Source"
    bl_options = {"INSTANCED"}
    bl_ui_units_x = 12

    def draw(self, context: bpy.types.Context) -> None:
        layout, one = self.layout, sets.active(context)
        if one is None:
            return
        layout.prop(one, "source", expand=True)
        if one.source == "COLLECTION":
            layout.prop(one, "collection", text="")
        row = layout.row(align=True)
        row.active = one.source != "COLLECTION"
        draw_props(row.column(), context.scene.imprint, "low_suffix", "high_suffix", "cage_suffix")


def draw_lists(layout: bpy.types.UILayout, context: bpy.types.Context, rows: Rows) -> None:
    """The sets, and the parts and textures of the active one."""
    scene, one = context.scene, rows.set
    row = layout.row()
    row.template_list(
        "IMPRINT_UL_sets", "", scene, "imprint_sets", scene.imprint, "active_set", rows=SETS, maxrows=SETS
    )
    buttons = row.column(align=True)
    buttons.operator("imprint.set_add", text="", icon="ADD")
    buttons.operator("imprint.set_remove", text="", icon="REMOVE")
    buttons.menu("IMPRINT_MT_sets", text="", icon="DOWNARROW_HLT")
    if one is None:
        draw_paragraphs(layout, context, [message("Select the objects of a prop, and press the plus sign.")], "INFO")
        return
    _draw_parts(layout, context, one)
    _draw_part(layout.column(align=True), context, one)
    layout.row(align=True).prop(one, "textures", expand=True)
    row = layout.row()
    row.enabled = one.textures != "PART"
    draw_packing(row)


def _draw_parts(layout: bpy.types.UILayout, context: bpy.types.Context, one: ImprintSet) -> None:
    """The list of parts."""
    row, is_own = layout.row(), one.source == "PARTS"
    owner, name = set_lists.listed(context, one)
    row.template_list("IMPRINT_UL_parts", one.source, owner, name, one, "active_part", rows=PARTS, maxrows=PARTS)
    buttons = row.column(align=True)
    own = buttons.column(align=True)
    own.enabled = is_own
    own.operator("imprint.set_part_add", text="", icon="ADD")
    own.operator("imprint.set_part_remove", text="", icon="REMOVE")
    buttons.popover("IMPRINT_PT_set_source", text="", icon="OUTLINER_COLLECTION" if not is_own else "PREFERENCES")
    low = set_lists.chosen_low(context)
    select = buttons.column(align=True)
    select.enabled = low is not None
    select.operator("imprint.select_result", text="", icon="RESTRICT_SELECT_OFF").low = (
        low.name if low is not None else ""
    )


def _draw_part(layout: bpy.types.UILayout, context: bpy.types.Context, one: ImprintSet) -> None:
    """The high objects of the active part, and what it has for itself. Four rows, with or without a part."""
    low = set_lists.chosen_low(context)
    is_changeable = low is not None and low.is_editable
    highs = set_lists.part_of(context, one, low).highs if low is not None else ()
    row = layout.row(align=True)
    row.enabled = is_changeable and one.source != "NAMES"
    row.menu(
        "IMPRINT_MT_part_highs", text=shorten_list(highs, 1) if highs else message("No high object"), translate=False
    )
    row.prop(context.scene, "imprint_picked", text="")
    row.operator("imprint.set_high_add", text="", icon="ADD").low = low.name if low is not None else ""
    row = layout.row(align=True)
    row.enabled = is_changeable
    if low is None:
        row.label(text=message("No part is chosen"), translate=False)
    else:
        row.active = one.textures == "PART"
        row.prop(low, "imprint_size")
    # A row each: beside one another, their names are cut.
    for owner, name in ((low, "imprint_distance"), (object_pairs.of(low) if low is not None else None, "cage")):
        row = layout.row(align=True)
        row.enabled = is_changeable
        if owner is None:
            row.label(text="")
        else:
            row.prop(owner, name)


def draw_changed(layout: bpy.types.UILayout, one: ImprintSet, *, enabled: bool) -> None:
    """The button that bakes what has changed, where Live is for a selection."""
    row = layout.row(align=True)
    row.enabled = enabled
    button = row.operator(OF_SETS, text=label("Bake Changed"), translate=False, icon="FILE_REFRESH")
    button.name, button.changed = one.name, True
    row.operator("imprint.queue_add", icon="TIME").name = one.name


def problem(context: bpy.types.Context, rows: Rows) -> str:
    """Why the active set cannot be baked, in a sentence; empty if no reason is known."""
    return set_lists.problem(context, rows.set) or _settings_problem(rows)


def _settings_problem(rows: Rows) -> str:
    try:
        rows.settings.check()
    except BakeError as error:
        return str(error)
    return message("The files of the bake go beside the .blend file: save it first.") if rows.is_unsaved else ""


def draw_box(box: bpy.types.UILayout, context: bpy.types.Context, rows: Rows, problem: str) -> None:
    """What the button will do, or why it cannot, and the images behind a fold."""
    one = rows.set
    if problem:
        draw_fixable(box, context, problem, "ERROR")
        if rows.is_unsaved:
            box.operator("wm.save_mainfile", icon="FILE_TICK")
        return
    number = len(set_lists.uids(context, one))
    draw_paragraphs(box, context, [describe(rows, number)], "BLANK1")
    sign = signs.of_set(context, one)
    draw_paragraphs(box, context, [signs.waiting(context, one) or sign.text], sign.icon)
    low = set_lists.chosen_low(context)
    if low is not None and low.imprint_is_baked:
        problem, own = set_lists.part_of(context, one, low).problem, signs.of(context, low)
        draw_fixable(box, context, problem, "ERROR", low.name)
        if not problem and number > 1 and own.status in {Status.CHANGED, Status.FAILED}:
            draw_paragraphs(box, context, [f"{low.name}: {own.text}"], own.icon)
        if object_checks.lacks_uvs(low):
            draw_button(box, fixes.UNWRAP, low.name)
    draw_list(box, context, findings.of_set(context, one))
    header, body = box.panel("imprint_set_images", default_closed=True)
    titles = textures(context, one)
    images = first_images(context, rows, titles)
    header.label(text=message("Images of this bake: {}").format(len(images) * len(titles)), translate=False)
    if body is None:
        return
    if one.textures == "MATERIAL":
        column = body.column(align=True)
        for title in titles[:MOST_SHOWN]:
            row = column.row(align=True)
            row.label(text=title, icon="MATERIAL", translate=False)
            if (material := bpy.data.materials.get(title)) is not None:
                row.prop(material, "imprint_size", text="")
    draw_images(body, images)


def textures(context: bpy.types.Context, one: ImprintSet) -> list[str]:
    """What the images of a set are named after: materials, parts, or the set."""
    if one.textures == "ONE":
        return [one.name]

    def find() -> list[str]:
        lows = sets.lows(context, one)
        if one.textures == "PART":
            return [low.name for low in lows]
        slots = (slot.material for low in lows for slot in low.material_slots)
        return list(dict.fromkeys(naming.of_material(material) for material in slots if material is not None)) or [
            one.name
        ]

    return until_change.get(f"textures of {one.name}", (one.source, one.textures, len(one.parts)), find)


def first_images(context: bpy.types.Context, rows: Rows, titles: list[str]) -> list[PlannedImage]:
    """The images of the first part, or of the first material."""
    one = rows.set
    if not titles:
        return []
    shared = one.name if one.textures != "PART" else ""
    material = titles[0] if one.textures == "MATERIAL" else ""
    return of_texture(rows.settings, titles[0], shared, material)


def describe(rows: Rows, number: int) -> str:
    """What the button will do, in a sentence."""
    action = message("Bakes 1 part") if number == 1 else message("Bakes {} parts").format(number)
    into = {
        "PART": message("an image for each part"),
        "MATERIAL": message("an image for each material"),
        "ONE": message("one image for all"),
    }[rows.set.textures]
    return f"{action}: {rows['width']} x {rows['height']}, {into}."


CLASSES = (IMPRINT_MT_sets, IMPRINT_MT_part_highs, IMPRINT_PT_set_source)
register, unregister = registering(
    CLASSES,
    properties={
        "Scene.imprint_picked": labeled(
            PointerProperty,
            "Add High",
            "Pick a high object for the chosen part, or drop one here",
            type=bpy.types.Object,
            poll=_may_be_picked,
            update=_add_picked,
            options={"SKIP_SAVE"},
        )
    },
)
