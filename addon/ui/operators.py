# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that bake: they collect arguments, run the jobs, and report."""

import bpy
from bpy.props import CollectionProperty, IntProperty, StringProperty

from ..core import progress
from ..core.declarations.choices import Method
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import bake_jobs, sequence
from ..jobs.job import Job, jobs_by_name
from ..scene import object_refs, reading
from . import bake_results, modal, object_pairs
from .bake_results import results
from .live_switch import live
from .progress_display import display
from .properties import Chosen, Options
from .translations import LABEL


class _Bake(modal.MapOperator):
    """An operator that bakes maps; `task` returns their reports."""

    def finish(self, context: bpy.types.Context, result: list[Report]) -> None:
        lines = [line for report in result for line in report.summary(reading.lengths_of(context.scene))]
        self.show(context, lines, [warning for report in result for warning in report.warnings])
        results.remember(context, result)
        if self.options.is_invoke and context.window is not None and context.scene.imprint.show_result:
            bake_results.show_bake(context, result)


class _OnePair(_Bake, Options):
    """Bakes one low object, from the panel or from the arguments."""

    # Names are not remembered for the next call: the button bakes what the panel shows.
    low: StringProperty(
        name="Low",
        description="Name of the low object; empty for the slot or the active object",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )
    high: CollectionProperty(
        type=bpy.types.OperatorFileListElement,
        name="High",
        description='Names of the high objects, as [{"name": "sculpt"}]; empty for the slots or the selection',
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )
    cage: StringProperty(
        name="Cage",
        description="Name of the cage; empty for the slot, which only rays use",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task:
        job, settings = self.job(context)
        return (yield from bake_jobs.work(context, [job], settings, pace))

    def job(self, context: bpy.types.Context) -> tuple[Job, Settings]:
        """The objects and settings from the arguments, or from the panel where an argument is missing."""
        panel = context.scene.imprint
        chosen = panel.chosen(context, object_refs.by_name(self.low) if self.low else None)
        if self.high:  # a script that names the high objects makes another pair, with the settings of the scene
            chosen = Chosen(panel, chosen.low, [object_refs.by_name(item.name) for item in self.high])
        chosen.check(context)
        settings = self.to_settings(panel, chosen.rays, object_pairs.CHOSEN)
        cage = None if settings.tracing.method == Method.FLATTEN else chosen.rays.cage
        job = Job(chosen.low, chosen.highs, object_refs.by_name(self.cage) if self.cage else cage)
        job.is_exported = bool(panel.export)
        return job, settings


class IMPRINT_OT_bake(_OnePair, bpy.types.Operator):
    """Bake the detail of the high-poly objects into a normal map for the low-poly object"""

    bl_idname = "imprint.bake"
    bl_label = "Bake Normal Map"
    bl_options = {"REGISTER", "UNDO"}


class IMPRINT_OT_bake_sequence(_OnePair, bpy.types.Operator):
    """Bake each frame of the scene's range into a numbered file, for example for wrinkle maps"""

    bl_idname = "imprint.bake_sequence"
    bl_label = "Bake Sequence"
    bl_options = {"REGISTER", "UNDO"}

    first: IntProperty(
        name="First", description="First frame; below 0 for that of the scene", default=-1, translation_context=LABEL
    )
    last: IntProperty(
        name="Last", description="Last frame; below 0 for that of the scene", default=-1, translation_context=LABEL
    )

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task:
        job, settings = self.job(context)
        scene = context.scene
        first = self.first if self.first >= 0 else scene.frame_start
        last = self.last if self.last >= 0 else scene.frame_end
        return (yield from sequence.work(context, job, settings, range(first, last + 1), pace))


class IMPRINT_OT_live(modal.SlicedOperator, bpy.types.Operator):
    """Bake again whenever the high or low objects change, until it is switched off"""

    bl_idname = "imprint.live"
    bl_label = "Live"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task[None]:
        if live.is_on:
            yield from live.finishing()
            return
        job, settings = context.scene.imprint.chosen(context).job(context)
        yield from live.starting(context, job, settings, pace)


class IMPRINT_OT_bake_pairs(_Bake, bpy.types.Operator):
    """Bake each low object of the scene against the high objects with a matching name"""

    bl_idname = "imprint.bake_pairs"
    bl_label = "Bake Pairs by Name"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task:
        settings = context.scene.imprint
        jobs, problems = jobs_by_name(context, settings.suffixes())
        for problem in problems:
            self.report({"WARNING"}, problem)
        steps = bake_jobs.work(context, jobs, settings.to_settings(), pace, share_image=settings.share_image)
        return (yield from steps)


CLASSES = (IMPRINT_OT_bake, IMPRINT_OT_bake_sequence, IMPRINT_OT_live, IMPRINT_OT_bake_pairs)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
