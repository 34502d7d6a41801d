# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake, step by step: read, choose a method, make a source, draw tile by tile, audit, store, hook up, report."""

from collections.abc import Callable, Sequence

import bpy
import numpy as np

from ..audit import severity
from ..audit.measures import Measures, measuring
from ..core import progress
from ..core.declarations.choices import Method
from ..core.errors import Fix, NothingDrawn
from ..core.map_types import NORMAL, Map
from ..core.progress import Pace, Progress, Task, part, relay
from ..core.report import Report
from ..core.sentences import WRONG, Sentence, by_harm, rated
from ..core.settings import Run, Settings
from ..engine import baking, gpu_memory, mip_levels, orienting
from ..engine.baking import READY, shares_of_tiles
from ..engine.planning import nothing_drawn, plan_of
from ..engine.ray_casting import RayLengths
from ..mesh.edges import is_without_area
from ..output.materials import into_materials
from ..output.outputs import Outputs
from ..scene import object_checks, reading
from . import one_material, pair_checks, state_pieces
from .baked import Baked
from .job import Job, Request, check_job, closed, read_meshes, set_numbers
from .one_material import Shown
from .state_pieces import State


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
            steps = _prepare(context, request, run, outputs.kept)
            measures, warnings, state = yield from part(steps, 0.0, READY)
            plan, read = measures.plan, measures.plan.read
            outputs.sample_onto(job.low, read.uv_layer, is_own_base=read.is_own_base, slots=job.slots)
            for tile, start, stop in shares_of_tiles(plan):
                maps = yield from part(measures.drawing.texels(tile), start, stop)
                measures.add(tile, maps)
                levels = yield from part(mip_levels.of(maps, tile, run), stop, stop)
                with timings.timed("image"):
                    outputs.add(tile, maps, levels)
            baked = yield from part(_checked(context, request, measures, warnings, state), 1.0, 1.0)
        yield Progress("Storing", 1.0)
        low = job.low  # before anything changes: it raises if the object was deleted
        with timings.timed("image"):
            stored = outputs.commit(baked.labels, [low])
            layer, is_own_base = read.uv_layer, read.is_own_base
            if settings.storing.one_material:
                shown = Shown(low, layer, stored.image, stored.maps, is_own_base)
                notes = one_material.put([shown], settings, low.name)
            else:
                notes = into_materials(low, stored, layer, settings, slots=job.slots, is_own_base=is_own_base)
    return baked.stored_as(stored, [*stored.warnings, *notes])


def _prepare(
    context: bpy.types.Context, request: Request, run: Run, kept: Callable[[int, Map], np.ndarray]
) -> Task[tuple[Measures, list[Sentence], State]]:
    """Read and plan, up to what is drawn and measured. Also returns the warnings about the objects, and what was read.

    kept: as measuring takes it.
    """
    job, wants, settings, timings = request.job, request.wants, run.settings, run.timings
    name = job.low.name
    yield Progress(f"Reading {name}", 0.0)
    with timings.timed("extract"):
        meshes = read_meshes(context, request)
        state = state_pieces.of_read(request, meshes)
        meshes = closed(meshes, job)
    yield Progress(f"Looking at {name}", 0.5)
    plan = plan_of(meshes, settings, timings, length=reading.lengths_of(context.scene))
    notes = [*meshes.lacks, *object_checks.warnings(job.low, job.highs), *orienting.notes(meshes, plan.told)]
    with timings.timed("audit"):
        findings = pair_checks.flipped_findings(plan, timings)
        if wants.for_others:
            others = pair_checks.mesh_findings(meshes.low, job.low, meshes.uv_layer, settings.sampling)
            findings += pair_checks.unsolved_by_export(others, is_exported=wants.exported)
        early = by_harm([*pair_checks.pose_notes(context, job, settings), *pair_checks.finding_warnings(findings)])
    yield Progress(f"Looking at {name}", 0.5, warnings=tuple(early))
    drawing = yield from part(baking.draw(plan, run), 0.5, 1.0)
    making = measuring(
        drawing,
        settings,
        kept=kept,
        is_measured=wants.measured,
        is_seen=settings.map.appearance or wants.seen,
        is_pictured=wants.pictured,
    )
    measures = yield from part(making, 1.0, 1.0)
    hints = wants.hints if plan.method == Method.CAST else ()
    warnings = [*notes, *early, *measures.others.warnings, *rated(hints, WRONG, severity.UNFIT)]
    warnings += measures.seen.warnings if measures.seen else ()
    return measures, list(map(Sentence.of, warnings)), state


def _checked(
    context: bpy.types.Context, request: Request, measures: Measures, warnings: Sequence[Sentence], state: State
) -> Task[Baked]:
    """Check what was drawn. Raises BakeError if no texel was written."""
    plan, tally, drawing = measures.plan, measures.tally, measures.drawing
    tracing, length = request.settings.tracing, reading.lengths_of(context.scene)
    if not tally.written:
        why = nothing_drawn(plan, length, is_covered=tally.missed > 0)
        is_set = tracing.extrusion is not None or tracing.max_distance is not None
        can_be_hit = plan.casts_rays and not all(map(is_without_area, plan.meshes.listed_highs))
        text = Fix.MEASURE.after(why) if is_set and tally.missed and can_be_hit else why
        raise NothingDrawn(text, is_covered=tally.missed > 0)
    materials = set_numbers(request.job.low, plan.meshes) if not request.settings.map.texture_sets else None
    findings = yield from measures.findings(length, materials)
    return Baked(request, plan, findings, drawing.run.timings, warnings, state=state)


def draw_raw(
    context: bpy.types.Context, request: Request, run: Run
) -> Task[tuple[Baked, dict[int, dict[str, np.ndarray]]]]:
    """Draw the maps of one bake and store nothing. run: with the settings of the request.

    Also returns the maps without a margin, by tile and name, as Renderer.raw has them.
    """
    with gpu_memory.trimmed(), Outputs(run.settings) as alone:
        steps = _prepare(context, request, run, alone.kept)
        measures, warnings, state = yield from part(steps, 0.0, READY)
        maps = {}
        for tile, start, stop in shares_of_tiles(measures.plan):
            maps[tile] = yield from part(measures.drawing.renderer.raw(tile), start, stop)
            measures.add_raw(tile, maps[tile][NORMAL.name])
        return (yield from part(_checked(context, request, measures, warnings, state), 1.0, 1.0)), maps


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
