# SPDX-License-Identifier: GPL-3.0-or-later
"""The buttons Bake Maps and Live, and what operators that bake share."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
from bpy.props import BoolProperty, CollectionProperty, StringProperty

from ..core import naming
from ..core.declarations.choices import Method, Storage
from ..core.errors import BakeError, shorten_list
from ..core.progress import Pace, Progress, Task, relay
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import bake_jobs, weights
from ..jobs.job import Job, Wants
from ..scene import object_checks, reading
from ..scene.object_checks import object_by_name
from . import bake_results, modal, object_pairs, results
from .live import live
from .properties import Chosen, Options
from .results import Batch
from .texts import labeled, message


@dataclass(frozen=True)
class Several:
    """The result of a bake of several low objects.

    Attributes:
        left_out: What was not baked, as results.Batch has it.
        parts: The number of parts that were asked for, of which some may be left alone; 0 if that need not be told.
    """

    reports: list[Report]
    left_out: list[tuple[str, str]]
    parts: int = 0

    @property
    def told(self) -> str:
        """What was baked, in a line without a full stop; empty if the number of parts is not known."""
        lows = list(dict.fromkeys(report.low for report in self.reports))
        if not self.parts:
            return ""
        if not lows:
            return message("Nothing has changed: all maps show the scene as it is")
        return message("Baked {} of {} parts: {}").format(len(lows), self.parts, shorten_list(lows))


class BakeOperator(modal.MapOperator):
    """An operator that bakes maps; `task` returns their reports, or Several."""

    def finish(self, context: bpy.types.Context, result: list[Report] | Several) -> None:
        one = result if isinstance(result, Several) else Several(result, [])
        reports = one.reports
        lines = [line for report in reports for line in report.summary(reading.lengths_of(context.scene))]
        warnings = [warning for report in reports for warning in report.warnings]
        self.show(context, lines, warnings, head=one.told, left_out=[reason for _, reason in one.left_out])
        results.remember(reports)
        if reports and self.options.is_invoke and context.window is not None and context.scene.imprint.show_result:
            bake_results.show_bake(context, reports)
        if isinstance(result, Several):
            results.keep_batch(Batch(result.left_out, sorted({report.low for report in reports})))


def bake_several(
    context: bpy.types.Context,
    jobs: Sequence[Job],
    settings: Settings,
    pace: Pace,
    left_out: Sequence[tuple[str, str]] = (),
) -> Task[Several]:
    """Bake several low objects: into one image, or one for each material, if the panel has it set, which is whole or is not
    baked; or into one each, without those that cannot be baked.

    left_out: what is known of these.
    """
    done, shares = Several([], [*left_out]), context.scene.imprint.share_image
    if not shares:
        jobs = _ready(context, jobs, weights.settings_by_job(jobs, settings), done.left_out)

    def noted(step: Progress) -> Progress:
        done.reports.extend([step.report] if step.report else [])
        done.left_out.extend([step.failure] if step.failure else [])
        return step

    try:
        steps = bake_jobs.work(context, jobs, settings, pace, share_image=shares, goes_on=not shares)
        yield from relay(steps, noted)
    except (GeneratorExit, BakeError):  # the maps that are done stay
        results.remember(done.reports)
        raise
    return done


def _is_for_several(settings: Settings) -> bool:
    """Whether images and files are named alike for all low objects, so that maps of another one may be there and must stay."""
    storing = settings.storing
    names = [storing.image or naming.USUAL, *([storing.output] if storing.storage == Storage.FILE else [])]
    return not settings.map.texture_sets and not any(map(naming.has_low, names))


def _ready(
    context: bpy.types.Context, jobs: Sequence[Job], settings: list[Settings], left_out: list[tuple[str, str]]
) -> list[Job]:
    """The jobs that can be baked. The others are added to `left_out`. Raises BakeError if none can be."""
    context.view_layer.update()
    reasons = [
        object_checks.problem(context, job.low, job.highs, job.cage, of_job.tracing.method)
        for job, of_job in zip(jobs, settings, strict=True)
    ]
    if all(reasons):
        raise BakeError(reasons[0])
    left_out += [(job.low.name, reason) for job, reason in zip(jobs, reasons, strict=True) if reason]
    return [job for job, reason in zip(jobs, reasons, strict=True) if not reason]


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
        shares = context.scene.imprint.share_image and _is_for_several(settings)
        return (yield from bake_jobs.work(context, [job], settings, pace, wants=wants, share_image=shares))

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

    each: labeled(
        BoolProperty,
        "Each Onto Itself",
        "Bake each selected object for itself, also if they lie over one another: onto itself, or the detail of its pair",
        options={"SKIP_SAVE"},
    )

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        panel = context.scene.imprint
        all_chosen = [] if self.low or self.high else panel.all_chosen(context, is_each=self.each)
        if len(all_chosen) < 2:
            return (yield from OnePairOperator.task(self, context, pace))
        jobs = []
        for chosen in all_chosen:
            settings = self.to_settings(panel, chosen.rays, object_pairs.CHOSEN)
            cage = chosen.cage if chosen.pair else None  # the slot is for one low object
            jobs.append(Job(chosen.low, chosen.highs, cage, tracing=settings.tracing))
        left_out = [(chosen.low.name, why) for chosen in all_chosen if (why := object_pairs.problem(chosen.missing))]
        ready = [job for job, chosen in zip(jobs, all_chosen, strict=True) if not chosen.missing]
        if not ready:
            raise BakeError(left_out[0][1])
        return (yield from bake_several(context, ready, self.to_settings(panel), pace, left_out))


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
