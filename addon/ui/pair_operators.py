# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators on pairs by name and on what they share: bakes, a common UV map, and a job file for a farm."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from .. import flamenco
from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..jobs import atlas
from ..jobs.job import jobs_by_name
from . import modal, object_pairs, sets
from .bake_operators import BakeOperator, bake_several
from .modal import SlicedOperator, WaitingOperator
from .preferences import flamenco_address
from .texts import labeled, tooltip


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
            raise BakeError("No pair is switched on: switch on low objects in a set of pairs by name.")
        return (yield from bake_several(context, jobs, settings.to_settings(), pace, [("", one) for one in problems]))


class IMPRINT_OT_pack_uvs(WaitingOperator, SlicedOperator, bpy.types.Operator):
    """Make a UV map for the parts that are switched on: the islands of all lie side by side, at one texel density"""

    bl_idname = "imprint.pack_uvs"
    bl_label = "Pack UV Maps"
    bl_options = {"REGISTER", "UNDO"}

    selected: labeled(
        BoolProperty,
        "Selected",
        "Pack the selected objects that are baked each for itself, and not the low objects of a set or of pairs",
        options={"SKIP_SAVE"},
    )
    anew: labeled(
        BoolProperty, "Anew", "Pack all of them again, also those that have a place already", options={"SKIP_SAVE"}
    )

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[str]:
        panel, one = context.scene.imprint, sets.active(context)
        settings = panel.to_settings()
        if self.selected:
            lows = [chosen.low for chosen in panel.all_chosen(context, is_each=True) if chosen.low]
        elif one is not None:
            lows, settings = sets.lows(context, one), one.settings
        else:
            jobs, _ = jobs_by_name(context, panel.suffixes())
            lows = [job.low for job in jobs]
        on = [low for low in lows if self.selected or low.imprint_is_baked]
        if not on:
            raise BakeError("No low object is switched on: switch on those to pack.")
        staying = [low for low in lows if low not in on and atlas.LAYER in low.data.uv_layers]
        coming = [low for low in on if self.anew or atlas.LAYER not in low.data.uv_layers]
        only = coming if staying else None  # those that are off keep their places
        work = atlas.work([*on, *staying], settings, only=only, is_anew=self.anew and not staying)
        return (yield from work)

    def finish(self, context: bpy.types.Context, result: str) -> None:
        self.report({"INFO"}, result)


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


CLASSES = (IMPRINT_OT_bake_pairs, IMPRINT_OT_pack_uvs, IMPRINT_OT_send_to_flamenco)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
