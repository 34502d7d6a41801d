# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Pairs by Name: bakes of many low objects, their common UV map, and the button that sends a job file to a farm."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from .. import flamenco
from ..core import naming
from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..jobs import atlas
from ..jobs.job import jobs_by_name
from ..scene import object_checks
from . import modal, object_pairs
from .bake_operators import BakeOperator, bake_several
from .fix_buttons import draw_fixable
from .modal import QuickOperator
from .preferences import flamenco_address
from .progress_display import SettingsPanel, display
from .texts import draw_paragraphs, labeled, message, tooltip


class IMPRINT_OT_bake_pairs(BakeOperator, bpy.types.Operator):
    """Bake each low object of the scene against the high objects with a matching name. Leaves out what cannot be baked"""

    bl_idname = "imprint.bake_pairs"
    bl_label = "Bake Pairs by Name"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        settings = context.scene.imprint
        all_jobs, problems = jobs_by_name(context, settings.suffixes())
        jobs = [object_pairs.with_own(job) for job in all_jobs if job.low.imprint_is_baked]
        if not jobs:
            raise BakeError("No pair is checked: check those to bake in the list of pairs.")
        return (yield from bake_several(context, jobs, settings.to_settings(), pace, [("", one) for one in problems]))


class IMPRINT_OT_pack_uvs(QuickOperator, bpy.types.Operator):
    """Give the checked low objects a UV map in which the islands of all lie side by side, at one texel density"""

    bl_idname = "imprint.pack_uvs"
    bl_label = "Pack UV Maps"
    bl_options = {"REGISTER", "UNDO"}

    selected: labeled(
        BoolProperty,
        "Selected",
        "Pack the selected objects that are baked each for itself, and not the low objects of pairs",
        options={"SKIP_SAVE"},
    )

    def apply(self, context: bpy.types.Context) -> str:
        settings = context.scene.imprint
        if self.selected:
            lows = [chosen.low for chosen in settings.all_chosen(context, is_each=True) if chosen.low]
        else:
            jobs, _ = jobs_by_name(context, settings.suffixes())
            lows = [job.low for job in jobs if job.low.imprint_is_baked]
        if not lows:
            raise BakeError("No pair is checked: check those to bake in the list of pairs.")
        return atlas.pack(lows, settings.to_settings())


class IMPRINT_OT_send_to_flamenco(modal.FileOperator, bpy.types.Operator):
    """Send a job file to the Flamenco Manager in the add-on's preferences. All its machines must see the file"""

    bl_idname = "imprint.send_to_flamenco"
    bl_label = "Send to Flamenco"

    filepath: labeled(
        StringProperty,
        "Job File",
        "Job file with the bakes, .toml or .json",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    filter_glob: modal.file_filter("*.toml;*.json")
    shards: labeled(
        IntProperty, "Parts", "Number of parts of about the same cost, each a task", default=16, min=1, max=1000
    )

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not bpy.app.online_access:
            cls.poll_message_set(tooltip("Allow online access in Blender's preferences first"))
            return False
        return True

    def apply(self, context: bpy.types.Context) -> str:
        path = Path(bpy.path.abspath(self.filepath)).absolute()
        job = flamenco.Job(path.stem, {"jobs": str(path), "shards": self.shards})
        if not path.is_file():
            raise BakeError(f"There is no file {str(path)!r}: choose a job file.")
        return f"Sent: {flamenco.submit(flamenco_address(context), job)}"


def _draw_pair(layout: bpy.types.UILayout, context: bpy.types.Context, pair: naming.Pair) -> None:
    objects, settings = object_checks.by_name(context.view_layer.objects), context.scene.imprint
    low, highs, cage = objects[pair.low], [objects[name] for name in pair.highs], objects.get(pair.cage or "")
    layout.prop(low, "imprint_is_baked", text=pair.low, translate=False)
    column = layout.column()
    column.active = low.imprint_is_baked
    draw_paragraphs(column, context, [", ".join(pair.highs)], "BLANK1")
    row = column.row(align=True)
    size = row.row(align=True)
    size.active = not settings.share_image
    size.prop(low, "imprint_size", text="")
    distance = row.row(align=True)
    distance.active = settings.method != Method.FLATTEN
    distance.prop(low, "imprint_distance", text="")
    reason = object_checks.problem(context, low, highs, cage, settings.method)
    if reason and low.imprint_is_baked:
        draw_fixable(column, context, reason, "ERROR", pair.low)


class IMPRINT_PT_pairs(SettingsPanel, bpy.types.Panel):
    """Bakes many low objects at once: pairs of objects by name."""

    bl_idname = "IMPRINT_PT_pairs"
    bl_label = "Pairs by Name"
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}

    def draw_settings(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        settings = context.scene.imprint
        row = layout.row(align=True)
        for name in ("low_suffix", "high_suffix", "cage_suffix"):
            row.prop(settings, name, text="")
        try:
            pairs, problems = settings.pairs_by_name(context)
        except BakeError as error:
            pairs, problems = [], [str(error)]
        box = layout.box()
        for pair in pairs:
            _draw_pair(box, context, pair)
        draw_paragraphs(box, context, problems, "ERROR")
        if not pairs and not problems:
            draw_paragraphs(box, context, [message("No object name ends with one of these suffixes.")], "INFO")
        layout.prop(settings, "share_image")
        if settings.share_image:
            layout.operator("imprint.pack_uvs", icon="GROUP_UVS")
        if flamenco_address(context):
            layout.operator("imprint.send_to_flamenco", icon="EXPORT")

    def draw_button(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        try:
            is_enabled = bool(context.scene.imprint.pairs_by_name(context)[0])
        except BakeError:  # the box says it
            is_enabled = False
        display.draw_operator(layout, "imprint.bake_pairs", enabled=is_enabled, icon="RENDER_STILL")


CLASSES = (IMPRINT_OT_bake_pairs, IMPRINT_OT_pack_uvs, IMPRINT_OT_send_to_flamenco, IMPRINT_PT_pairs)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
