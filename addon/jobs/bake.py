# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake, step by step: read, choose a method, make a source, draw tile by tile, audit, store, hook up, report."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import bpy
import numpy as np

from ..audit import causes, stacked_detail
from ..audit.causes import Warned
from ..audit.checks import audit
from ..audit.deviations import Deviations
from ..audit.other_readers import OtherReaders
from ..audit.pictures.bake_pictures import BakePictures
from ..audit.tally import Tally
from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.lengths import Length
from ..core.map_types import NORMAL
from ..core.progress import Pace, Progress, Task, part
from ..core.report import Report
from ..core.settings import Run, Settings
from ..engine import gpu_memory, margins, shared_uvs, sources
from ..engine.hidden_parts import HiddenParts
from ..engine.maps.maps_of_bake import maps_of_bake
from ..engine.maps.sampling import SampledMaps
from ..engine.method_choice import Plan, choose_method, nothing_drawn, tiles_to_bake
from ..engine.mips import mip_levels
from ..engine.rendering import Renderer
from ..engine.sources import Source, normal_source
from ..mesh.inputs import Meshes
from ..output import map_storage
from ..output.outputs import Outputs, Stored, into_materials
from ..scene import object_checks, reading
from . import readiness, texture_sets
from .job import Job
from .report_making import DrawnJob, report_of

READY = 0.2
"""The share of a bake that is done when drawing begins."""


def bake_job(context: bpy.types.Context, job: Job, settings: Settings, pace: Pace) -> Task[Report]:
    """Bake one job into its own images, and put the map into the low object's materials.

    settings: checked, with names filled in. Raises BakeError, and then nothing has changed.
    """
    run = Run(settings, pace)
    drawn, stored, warnings = yield from run.timings.counted(_bake(context, job, run))
    return report_of(drawn, stored, warnings)


def _bake(context: bpy.types.Context, job: Job, run: Run) -> Task[tuple[DrawnJob, Stored, list[str]]]:
    settings, timings = run.settings, run.timings
    with Outputs(settings) as outputs:
        with gpu_memory.trimmed():
            ready = yield from part(_prepare(context, job, run), 0.0, READY)
            tally, post_processes = Tally(), margins.for_maps([ready.plan.meshes.low], settings)
            outputs.sample_onto(job.low, ready.meshes.uv_layer, is_own_base=ready.meshes.is_own_base, slots=job.slots)
            for tile, start, stop in _shares(ready.plan):
                maps = yield from part(ready.renderer.texels(tile, post_processes), start, stop)
                tally.add(maps[NORMAL.name], settings.map)
                with timings.timed("audit"):
                    ready.others.add(tile, maps[NORMAL.name])
                    ready.deviations.add(tile, maps[NORMAL.name])
                    ready.pictures.add(tile, maps)
                levels = yield from part(mip_levels.of(maps, tile, run), stop, stop)
                with timings.timed("image"):
                    outputs.add(tile, maps, levels)
            drawn = _audit(job, run, ready, tally)
        yield Progress("Storing", 1.0)
        low = job.low  # before anything changes: it raises if the object was deleted
        with timings.timed("image"):
            stored = outputs.commit(drawn.labels, [low])
            notes = into_materials(low, stored, drawn.meshes.uv_layer, settings, slots=job.slots)
    return drawn, stored, [*stored.warnings, *notes]


@dataclass(frozen=True)
class _Ready:
    """A bake that is ready to be drawn. meshes: all, as they were read. warnings: about the objects. length: a length in
    scene units as text."""

    meshes: Meshes
    warnings: list[Warned]
    plan: Plan
    source: Source
    renderer: Renderer
    others: OtherReaders
    truth: SampledMaps
    hidden: HiddenParts
    deviations: Deviations
    pictures: BakePictures
    length: Length


def _prepare(context: bpy.types.Context, job: Job, run: Run) -> Task[_Ready]:
    settings, timings = run.settings, run.timings
    name, length = job.low.name, reading.lengths_of(context.scene)
    yield Progress(f"Reading {name}", 0.0)
    with timings.timed("extract"):
        meshes = reading.read(
            context,
            job.low,
            job.highs,
            job.cage,
            settings,
            others=job.others,
            texture_set=job.texture_set,
            must_be_whole=job.must_be_whole,
        )
        warnings = [*map(Warned, meshes.lacks), *map(Warned, object_checks.warnings(job.low, job.highs))]
    with timings.timed("audit"):
        found = readiness.flipped_findings(meshes)
        if job.is_for_others:
            others = readiness.mesh_findings(meshes.low, job.low, meshes.uv_layer, settings.sampling)
            found += readiness.unsolved_by_export(others, is_exported=job.is_exported)
        early = readiness.finding_warnings(found)
    tiles = tiles_to_bake(meshes, settings.sampling)
    yield Progress(f"Looking at {name}", 0.5, warnings=tuple(each.text for each in early))
    with timings.timed("method"):
        in_order = shared_uvs.ordered(meshes, tiles, settings.sampling)
        plan = choose_method(in_order, tiles, settings.tracing, length)
    source = yield from part(normal_source(plan, run), 0.5, 1.0)
    drawn, others = maps_of_bake(in_order, source, run), OtherReaders(in_order.basis, settings)
    low = in_order.basis or in_order.low
    pictures = BakePictures(low, tiles, settings, is_wanted=job.is_pictured)
    is_wanted = (job.is_measured or job.is_pictured) and settings.map.normal
    kept = partial(map_storage.kept, settings=settings)
    truth = drawn
    if is_wanted and sources.hits_are_chosen(plan, settings.tracing):
        source_of_truth = yield from part(sources.own_source(plan, run), 1.0, 1.0)
        truth = maps_of_bake(in_order, source_of_truth, replace(run, settings=settings.without_other_maps()))
    hidden = HiddenParts(plan, truth.source, settings, is_shared=in_order is not meshes)
    deviations = Deviations(plan, truth, settings, pictures, kept=kept, is_wanted=is_wanted, hidden=hidden)
    warnings = [*warnings, *early, *map(Warned, others.warnings)]
    if plan.method == Method.CAST:
        warnings += [Warned(text, causes.UNFIT) for text in job.hints]
    renderer = Renderer(drawn, run)
    return _Ready(meshes, warnings, plan, source, renderer, others, truth, hidden, deviations, pictures, length)


def _audit(job: Job, run: Run, ready: _Ready, tally: Tally) -> DrawnJob:
    """Raises BakeError if no texel was written."""
    settings, timings = run.settings, run.timings
    if not tally.written:
        raise BakeError(nothing_drawn(ready.plan, ready.length))
    ray_cast = ready.source.ray_cast
    with timings.timed("audit"):
        materials = texture_sets.numbers(job.low, ready.plan.meshes) if not settings.map.texture_sets else None
        stacked = stacked_detail.check(ready.plan, ready.hidden, ready.truth, settings, materials)
        findings = audit(ready.plan, tally, settings, ray_cast, length=ready.length, stacked=stacked)
    stopped = ready.renderer.stopped / tally.written
    read = ready.others.results(tally.backwards)
    with timings.timed("audit"):
        picture = ready.pictures.result()
    return DrawnJob(
        job,
        settings,
        ready.meshes,
        ready.plan,
        ray_cast,
        findings,
        timings,
        ready.warnings,
        stopped,
        ready.source.share_of_rays if ready.plan.has_rays else 0.0,
        read,
        ready.deviations.results(),
        picture,
    )


def _shares(plan: Plan) -> Iterator[tuple[int, float, float]]:
    """Each UDIM tile, with the share of the bake that is done before and after it."""
    share = (1.0 - READY) / len(plan.tiles)
    for number, tile in enumerate(plan.tiles):
        yield tile, READY + number * share, READY + (number + 1) * share


def draw_raw(context: bpy.types.Context, job: Job, run: Run) -> Task[tuple[DrawnJob, dict[int, dict[str, np.ndarray]]]]:
    """Draw one job and store nothing. Also returns the maps without a margin, by tile and name, as Renderer.raw has them."""
    with gpu_memory.trimmed():
        ready = yield from part(_prepare(context, job, run), 0.0, READY)
        tally, maps = Tally(), {}
        for tile, start, stop in _shares(ready.plan):
            maps[tile] = yield from part(ready.renderer.raw(tile), start, stop)
            tally.add_raw(maps[tile][NORMAL.name], run.settings.map)
            with run.timings.timed("audit"):
                ready.others.add_raw(tile, maps[tile][NORMAL.name])
                ready.deviations.add_raw(tile, maps[tile][NORMAL.name])
                ready.pictures.add_raw(tile, maps[tile][NORMAL.name])
        return _audit(job, run, ready, tally), maps
