# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake, step by step: read, choose a method, make a source, draw tile by tile, audit, store, hook up, report."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import bpy
import numpy as np

from ..audit import severity
from ..audit.appearance import SeenBake
from ..audit.checks import audit, check_stacked
from ..audit.deviations import BetweenTexels, Deviations, OtherEngines
from ..audit.pictures import BakePictures
from ..audit.severity import Warned
from ..audit.tally import Tally
from ..core import progress
from ..core.declarations.choices import Method
from ..core.errors import Fix, Length, NothingDrawn
from ..core.map_types import NORMAL
from ..core.progress import Pace, Progress, Task, part, relay
from ..core.report import Report
from ..core.settings import Run, Settings
from ..engine import baking, gpu_memory, mip_levels, orienting
from ..engine.baking import READY, Drawing, shares_of_tiles
from ..engine.planning import Plan, nothing_drawn, plan_of
from ..engine.ray_casting import RayLengths
from ..engine.stacked_uvs import StackedParts
from ..mesh.edges import is_without_area
from ..output.materials import into_materials
from ..output.outputs import Outputs, kept
from ..scene import object_checks, reading
from . import pair_checks
from .baked import Baked
from .job import Job, Request, check_job, read_meshes, set_numbers


def bake_job(context: bpy.types.Context, request: Request, pace: Pace) -> Task[Report]:
    """Do one bake into its own images, and put the map into the low object's materials.

    request: checked. Raises BakeError, and then nothing has changed.
    """
    run = Run(request.settings, pace)
    steps = relay(_bake(context, request, run), request.job.check_low)
    return Report.of((yield from run.timings.counted(steps)))


def _bake(context: bpy.types.Context, request: Request, run: Run) -> Task[Baked]:
    job, settings, timings = request.job, run.settings, run.timings
    with Outputs(settings) as outputs:
        with gpu_memory.trimmed():
            ready = yield from part(_prepare(context, request, run), 0.0, READY)
            tally, read = Tally(), ready.plan.read
            outputs.sample_onto(job.low, read.uv_layer, is_own_base=read.is_own_base, slots=job.slots)
            for tile, start, stop in shares_of_tiles(ready.plan):
                maps = yield from part(ready.drawing.texels(tile), start, stop)
                tally.add(maps[NORMAL.name], settings.map)
                with timings.timed("audit"):
                    for each in ready.measures:
                        each.add(tile, maps[NORMAL.name])
                    ready.pictures.add(tile, maps)
                levels = yield from part(mip_levels.of(maps, tile, run), stop, stop)
                with timings.timed("image"):
                    outputs.add(tile, maps, levels)
            baked = yield from part(_audit(request, run, ready, tally), 1.0, 1.0)
        yield Progress("Storing", 1.0)
        low = job.low  # before anything changes: it raises if the object was deleted
        with timings.timed("image"):
            stored = outputs.commit(baked.labels, [low])
            layer, is_own_base = baked.meshes.uv_layer, baked.meshes.is_own_base
            notes = into_materials(low, stored, layer, settings, slots=job.slots, is_own_base=is_own_base)
    return baked.stored_as(stored, [*stored.warnings, *notes])


@dataclass(frozen=True)
class _Ready:
    """A bake that is ready to be drawn.

    Attributes:
        warnings: About the objects.
        truth: The same with own hits, for what is measured.
        length: A length in scene units as text.
    """

    warnings: list[Warned]
    drawing: Drawing
    others: OtherEngines
    truth: Drawing
    hidden: StackedParts
    deviations: Deviations
    between: BetweenTexels
    seen: SeenBake
    pictures: BakePictures
    length: Length

    @property
    def plan(self) -> Plan:
        return self.drawing.plan

    @property
    def measures(self) -> tuple[OtherEngines, Deviations, BetweenTexels, SeenBake]:
        """What measures the normal map."""
        return self.others, self.deviations, self.between, self.seen


def _prepare(context: bpy.types.Context, request: Request, run: Run) -> Task[_Ready]:
    job, wants, settings, timings = request.job, request.wants, run.settings, run.timings
    name, length = job.low.name, reading.lengths_of(context.scene)
    yield Progress(f"Reading {name}", 0.0)
    with timings.timed("extract"):
        meshes = read_meshes(context, request)
    yield Progress(f"Looking at {name}", 0.5)
    plan = plan_of(meshes, settings, timings, length=length)
    notes = [*meshes.lacks, *object_checks.warnings(job.low, job.highs), *orienting.notes(meshes, plan.told)]
    with timings.timed("audit"):
        found = pair_checks.flipped_findings(plan, timings)
        if wants.for_others:
            others = pair_checks.mesh_findings(meshes.low, job.low, meshes.uv_layer, settings.sampling)
            found += pair_checks.unsolved_by_export(others, is_exported=wants.exported)
        early = [*map(Warned, pair_checks.pose_notes(context, job, settings)), *pair_checks.finding_warnings(found)]
    yield Progress(f"Looking at {name}", 0.5, warnings=tuple(each.text for each in early))
    truth = drawing = yield from part(baking.draw(plan, run), 0.5, 1.0)
    others = OtherEngines(plan.meshes.basis, settings)
    low = plan.meshes.basis or plan.meshes.low
    pictures = BakePictures(low, plan.tiles, settings, is_wanted=wants.pictured)
    is_wanted = (wants.measured or wants.pictured) and settings.map.normal
    if is_wanted:
        truth = yield from part(baking.draw_own_hits(plan, run, drawing), 1.0, 1.0)
    hidden = StackedParts(truth, settings)
    as_kept = partial(kept, settings=settings)
    deviations = Deviations(truth, settings, pictures, kept=as_kept, is_wanted=is_wanted, hidden=hidden)
    between = BetweenTexels(truth, settings, kept=as_kept, is_wanted=wants.measured and settings.map.normal)
    warnings = [*map(Warned, notes), *early, *map(Warned, others.warnings)]
    if plan.method == Method.CAST:
        warnings += [Warned(text, severity.UNFIT) for text in wants.hints]
    seen = SeenBake(plan, settings, kept=as_kept, is_wanted=settings.map.appearance or wants.seen)
    warnings += map(Warned, seen.warnings)
    return _Ready(warnings, drawing, others, truth, hidden, deviations, between, seen, pictures, length)


def _audit(request: Request, run: Run, ready: _Ready, tally: Tally) -> Task[Baked]:
    """Raises BakeError if no texel was written."""
    settings, timings = run.settings, run.timings
    if not tally.written:
        why, tracing = nothing_drawn(ready.plan, ready.length, is_covered=tally.missed > 0), settings.tracing
        is_set = tracing.extrusion is not None or tracing.max_distance is not None
        can_be_hit = ready.plan.casts_rays and not all(map(is_without_area, ready.plan.meshes.listed_highs))
        raise NothingDrawn(Fix.MEASURE.after(why) if is_set and tally.missed and can_be_hit else why)
    seen = yield from relay(ready.seen.measured(), within=partial(timings.timed, "audit"))
    with timings.timed("audit"):
        materials = set_numbers(request.job.low, ready.plan.meshes) if not settings.map.texture_sets else None
        stacked = check_stacked(ready.hidden, ready.truth, settings, materials)
        findings = audit(ready.plan, tally, settings, ready.drawing.ray_cast, length=ready.length, stacked=stacked)
    with timings.timed("audit"):
        picture = ready.pictures.result()
    findings = replace(
        findings,
        stopped_early=ready.drawing.renderer.stopped / tally.written,
        rays=ready.drawing.source.share_of_rays if ready.plan.has_rays else 0.0,
        targets=ready.others.results(tally.backwards),
        deviation=ready.deviations.results(),
        between=ready.between.results(),
        appearance=seen,
        picture=picture,
    )
    return Baked(request, ready.plan, findings, timings, ready.warnings)


def draw_raw(
    context: bpy.types.Context, request: Request, run: Run
) -> Task[tuple[Baked, dict[int, dict[str, np.ndarray]]]]:
    """Draw the maps of one bake and store nothing. run: with the settings of the request.

    Also returns the maps without a margin, by tile and name, as Renderer.raw has them.
    """
    with gpu_memory.trimmed():
        ready = yield from part(_prepare(context, request, run), 0.0, READY)
        tally, maps = Tally(), {}
        for tile, start, stop in shares_of_tiles(ready.plan):
            maps[tile] = yield from part(ready.drawing.renderer.raw(tile), start, stop)
            tally.add_raw(maps[tile][NORMAL.name], run.settings.map)
            with run.timings.timed("audit"):
                for each in (*ready.measures, ready.pictures):
                    each.add_raw(tile, maps[tile][NORMAL.name])
        baked = yield from part(_audit(request, run, ready, tally), 1.0, 1.0)
        return baked, maps


def measure_rays(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    cage: bpy.types.Object | None = None,
) -> RayLengths | None:
    """How far the rays of a bake of these objects reach; None if it would cast none. Raises BakeError as the bake does."""
    # Nothing is stored, so it does not matter where.
    settings = settings.without_file().without_materials()
    settings.check()
    job = Job(low, highs, cage)
    check_job(context, job, settings)
    meshes = read_meshes(context, Request(job, settings))
    with gpu_memory.trimmed():
        plan = plan_of(meshes, settings, length=reading.lengths_of(context.scene))
        return progress.finish(baking.draw(plan, Run(settings))).plan.rays
