# SPDX-License-Identifier: GPL-3.0-or-later
"""The buttons Bake Maps and Live, and what operators that bake share."""

import bpy
from bpy.props import CollectionProperty, StringProperty

from ..core.declarations.choices import Method
from ..core.progress import Pace, Task
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import bake_jobs
from ..jobs.job import Job, Wants
from ..scene import reading
from ..scene.object_checks import object_by_name
from . import bake_results, modal, object_pairs, results
from .live import live
from .properties import Chosen, Options
from .texts import labeled


class BakeOperator(modal.MapOperator):
    """An operator that bakes maps; `task` returns their reports."""

    def finish(self, context: bpy.types.Context, result: list[Report]) -> None:
        lines = [line for report in result for line in report.summary(reading.lengths_of(context.scene))]
        self.show(context, lines, [warning for report in result for warning in report.warnings])
        results.remember(result)
        if self.options.is_invoke and context.window is not None and context.scene.imprint.show_result:
            bake_results.show_bake(context, result)


class OnePairOperator(BakeOperator, Options):
    """Bakes one low object, from the panel or from the arguments."""

    # Names are not remembered for the next call: the button bakes what the panel shows.
    low: labeled(
        StringProperty, "Low", "Name of the low object; empty for the slot or the active object", options={"SKIP_SAVE"}
    )
    high: labeled(
        CollectionProperty,
        "High",
        'Names of the high objects, as [{"name": "sculpt"}]; empty for the slots or the selection',
        type=bpy.types.OperatorFileListElement,
        options={"SKIP_SAVE"},
    )
    cage: labeled(
        StringProperty, "Cage", "Name of the cage; empty for the slot, which only rays use", options={"SKIP_SAVE"}
    )

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        job, settings, wants = self.request(context)
        return (yield from bake_jobs.work(context, [job], settings, pace, wants=wants))

    def request(self, context: bpy.types.Context) -> tuple[Job, Settings, Wants]:
        """The objects and settings from the arguments, or from the panel where an argument is missing."""
        panel = context.scene.imprint
        chosen = panel.chosen(context, object_by_name(self.low) if self.low else None)
        if self.high:  # a script that names the high objects makes another pair, with the settings of the scene
            chosen = Chosen(panel, chosen.low, [object_by_name(item.name) for item in self.high])
        chosen.check(context)
        settings = self.to_settings(panel, chosen.rays, object_pairs.CHOSEN)
        cage = None if settings.tracing.method == Method.FLATTEN else chosen.rays.cage
        job = Job(chosen.low, chosen.highs, object_by_name(self.cage) if self.cage else cage)
        return job, settings, Wants(exported=bool(panel.export))


class IMPRINT_OT_bake(OnePairOperator, bpy.types.Operator):
    """Bake the detail of the high-poly objects into a normal map for the low-poly object"""

    bl_idname = "imprint.bake"
    bl_label = "Bake Maps"
    bl_options = {"REGISTER", "UNDO"}


class IMPRINT_OT_live(modal.WaitingOperator, modal.SlicedOperator, bpy.types.Operator):
    """Bake again whenever the high or low objects change, until it is switched off"""

    bl_idname = "imprint.live"
    bl_label = "Live"
    bl_options = {"UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[None]:
        if live.is_on:
            yield from live.finishing()
            return
        job, settings = context.scene.imprint.chosen(context).job(context)
        yield from live.starting(context, job, settings, pace)


CLASSES = (IMPRINT_OT_bake, IMPRINT_OT_live)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
