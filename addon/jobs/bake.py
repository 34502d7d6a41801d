# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake, step by step: read, choose a method, make a source, draw tile by tile, audit, store, hook up, report."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial

import bpy
import gpu
import numpy as np

from ..audit import deviations, severity
from ..audit.appearance import Appearance, SeenBake
from ..audit.checks import Findings, audit, check_stacked
from ..audit.deviations import BetweenTexels, Deviations, OtherEngines
from ..audit.pictures import BakePictures
from ..audit.severity import Warned
from ..audit.tally import Tally
from ..core import map_types, progress
from ..core.declarations.choices import Method
from ..core.errors import Fix, Length, NothingDrawn, shorten_list
from ..core.map_types import BY_NAME, NORMAL, Labeled
from ..core.progress import Pace, Progress, Task, Timings, part, relay
from ..core.report import Report
from ..core.settings import MapSettings, Run, Settings
from ..engine import gpu_memory, margins, mip_levels, orienting, ray_maps, sources, stacked_uvs
from ..engine.baking import Renderer
from ..engine.method_choice import Plan, choose_method, nothing_drawn, tiles_to_bake
from ..engine.ray_casting import RayCast
from ..engine.sampling import SampledMaps, maps_of_bake
from ..engine.sources import Source, normal_source
from ..engine.stacked_uvs import StackedParts
from ..mesh import triangle_mesh
from ..mesh.edges import is_without_area
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from ..output.materials import into_materials
from ..output.outputs import HIDDEN_MISSES, Outputs, Stored, kept
from ..passes import surface_tables
from ..scene import object_checks, reading
from . import checks, material_inputs
from .job import Job, Request, check_job, read_meshes, set_numbers

READY = 0.2
"""The share of a bake that is done when drawing begins."""


@dataclass(frozen=True)
class DrawnJob:
    """A bake whose maps are drawn and not yet stored. meshes: all that were read. ray_cast: None for Flatten. warnings: about
    the objects. stopped_early, rays, targets, deviation, picture: as in Report. appearance: None if it was not measured."""

    request: Request
    meshes: Meshes
    plan: Plan
    ray_cast: RayCast | None
    findings: Findings
    timings: Timings
    warnings: Sequence[Warned] = ()
    stopped_early: float = 0.0
    rays: float = 0.0
    targets: dict[str, dict[str, float | int]] = field(default_factory=dict)
    deviation: dict[str, float | int] = field(default_factory=dict)
    between: dict[str, float | int] = field(default_factory=dict)
    appearance: Appearance | None = None
    picture: np.ndarray | None = None

    @property
    def labels(self) -> dict[Labeled, list[str]]:
        """As Outputs.commit takes them."""
        return {
            Labeled.OBJECTS: [high.name for high in self.meshes.highs],
            Labeled.MATERIALS: [material.name for material in self.meshes.materials],
        }


def bake_job(context: bpy.types.Context, request: Request, pace: Pace) -> Task[Report]:
    """Do one bake into its own images, and put the map into the low object's materials.

    request: checked. Raises BakeError, and then nothing has changed.
    """
    run = Run(request.settings, pace)
    steps = relay(_bake(context, request, run), request.job.check_low)
    drawn, stored, warnings = yield from run.timings.counted(steps)
    return report_of(drawn, stored, warnings)


def _bake(context: bpy.types.Context, request: Request, run: Run) -> Task[tuple[DrawnJob, Stored, list[str]]]:
    job, settings, timings = request.job, run.settings, run.timings
    with Outputs(settings) as outputs:
        with gpu_memory.trimmed():
            ready = yield from part(_prepare(context, request, run), 0.0, READY)
            tally, post_processes = Tally(), margins.for_maps([ready.plan.meshes.low], settings)
            outputs.sample_onto(job.low, ready.meshes.uv_layer, is_own_base=ready.meshes.is_own_base, slots=job.slots)
            for tile, start, stop in _shares(ready.plan):
                maps = yield from part(ready.renderer.texels(tile, post_processes), start, stop)
                tally.add(maps[NORMAL.name], settings.map)
                with timings.timed("audit"):
                    ready.others.add(tile, maps[NORMAL.name])
                    ready.deviations.add(tile, maps[NORMAL.name])
                    ready.between.add(tile, maps[NORMAL.name])
                    ready.seen.add(tile, maps[NORMAL.name])
                    ready.pictures.add(tile, maps)
                levels = yield from part(mip_levels.of(maps, tile, run), stop, stop)
                with timings.timed("image"):
                    outputs.add(tile, maps, levels)
            drawn = yield from part(_audit(request, run, ready, tally), 1.0, 1.0)
        yield Progress("Storing", 1.0)
        low = job.low  # before anything changes: it raises if the object was deleted
        with timings.timed("image"):
            stored = outputs.commit(drawn.labels, [low])
            layer, is_own_base = drawn.meshes.uv_layer, drawn.meshes.is_own_base
            notes = into_materials(low, stored, layer, settings, slots=job.slots, is_own_base=is_own_base)
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
    others: OtherEngines
    truth: SampledMaps
    hidden: StackedParts
    deviations: Deviations
    between: BetweenTexels
    seen: SeenBake
    pictures: BakePictures
    length: Length


def _prepare(context: bpy.types.Context, request: Request, run: Run) -> Task[_Ready]:
    job, wants, settings, timings = request.job, request.wants, run.settings, run.timings
    name, length = job.low.name, reading.lengths_of(context.scene)
    yield Progress(f"Reading {name}", 0.0)
    meshes = read_meshes(context, request, timings)
    with timings.timed("extract"):
        warnings = [*map(Warned, meshes.lacks), *map(Warned, object_checks.warnings(job.low, job.highs))]
        warnings += map(Warned, orienting.notes(meshes))
    tiles = tiles_to_bake(meshes, settings.sampling)
    yield Progress(f"Looking at {name}", 0.5)
    with timings.timed("method"):
        in_order = stacked_uvs.ordered(meshes, tiles, settings.sampling)
        plan = choose_method(in_order, tiles, settings.tracing, length)
    with timings.timed("audit"):
        found = checks.flipped_findings(meshes, timings, has_rays=plan.casts_rays)
        if wants.for_others:
            others = checks.mesh_findings(meshes.low, job.low, meshes.uv_layer, settings.sampling)
            found += checks.unsolved_by_export(others, is_exported=wants.exported)
        early = [*map(Warned, checks.pose_notes(context, job, settings)), *checks.finding_warnings(found)]
    yield Progress(f"Looking at {name}", 0.5, warnings=tuple(each.text for each in early))
    source = yield from part(normal_source(plan, run), 0.5, 1.0)
    drawn, others = maps_of_bake(in_order, source, run), OtherEngines(in_order.basis, settings)
    low = in_order.basis or in_order.low
    pictures = BakePictures(low, tiles, settings, is_wanted=wants.pictured)
    is_wanted = (wants.measured or wants.pictured) and settings.map.normal
    truth = drawn
    if is_wanted and sources.hits_are_chosen(plan, settings.tracing):
        source_of_truth = yield from part(sources.own_source(plan, run), 1.0, 1.0)
        truth = maps_of_bake(in_order, source_of_truth, replace(run, settings=settings.without_other_maps()))
    hidden = StackedParts(plan, truth.source, settings, is_shared=in_order is not meshes)
    deviations = Deviations(
        plan, truth, settings, pictures, kept=partial(kept, settings=settings), is_wanted=is_wanted, hidden=hidden
    )
    between = BetweenTexels(
        plan, truth, settings, kept=partial(kept, settings=settings), is_wanted=wants.measured and settings.map.normal
    )
    warnings = [*warnings, *early, *map(Warned, others.warnings)]
    if plan.method == Method.CAST:
        warnings += [Warned(text, severity.UNFIT) for text in wants.hints]
    seen = SeenBake(
        plan, settings, kept=partial(kept, settings=settings), is_wanted=settings.map.appearance or wants.seen
    )
    warnings += map(Warned, seen.warnings)
    renderer = Renderer(drawn, run)
    return _Ready(
        meshes, warnings, plan, source, renderer, others, truth, hidden, deviations, between, seen, pictures, length
    )


def _audit(request: Request, run: Run, ready: _Ready, tally: Tally) -> Task[DrawnJob]:
    """Raises BakeError if no texel was written."""
    settings, timings = run.settings, run.timings
    if not tally.written:
        why, tracing = nothing_drawn(ready.plan, ready.length, is_covered=tally.missed > 0), settings.tracing
        is_set = tracing.extrusion is not None or tracing.max_distance is not None
        can_be_hit = ready.plan.casts_rays and not all(map(is_without_area, ready.plan.meshes.listed_highs))
        raise NothingDrawn(Fix.MEASURE.after(why) if is_set and tally.missed and can_be_hit else why)
    ray_cast = ready.source.ray_cast
    seen = yield from relay(ready.seen.measured(), within=partial(timings.timed, "audit"))
    with timings.timed("audit"):
        materials = set_numbers(request.job.low, ready.plan.meshes) if not settings.map.texture_sets else None
        stacked = check_stacked(ready.plan, ready.hidden, ready.truth, settings, materials)
        findings = audit(ready.plan, tally, settings, ray_cast, length=ready.length, stacked=stacked)
    stopped = ready.renderer.stopped / tally.written
    read = ready.others.results(tally.backwards)
    with timings.timed("audit"):
        picture = ready.pictures.result()
    return DrawnJob(
        request,
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
        ready.between.results(),
        seen,
        picture,
    )


def _shares(plan: Plan) -> Iterator[tuple[int, float, float]]:
    """Each UDIM tile, with the share of the bake that is done before and after it."""
    share = (1.0 - READY) / len(plan.tiles)
    for number, tile in enumerate(plan.tiles):
        yield tile, READY + number * share, READY + (number + 1) * share


def draw_raw(
    context: bpy.types.Context, request: Request, run: Run
) -> Task[tuple[DrawnJob, dict[int, dict[str, np.ndarray]]]]:
    """Draw the maps of one bake and store nothing. run: with the settings of the request.

    Also returns the maps without a margin, by tile and name, as Renderer.raw has them.
    """
    with gpu_memory.trimmed():
        ready = yield from part(_prepare(context, request, run), 0.0, READY)
        tally, maps = Tally(), {}
        for tile, start, stop in _shares(ready.plan):
            maps[tile] = yield from part(ready.renderer.raw(tile), start, stop)
            tally.add_raw(maps[tile][NORMAL.name], run.settings.map)
            with run.timings.timed("audit"):
                ready.others.add_raw(tile, maps[tile][NORMAL.name])
                ready.deviations.add_raw(tile, maps[tile][NORMAL.name])
                ready.between.add_raw(tile, maps[tile][NORMAL.name])
                ready.seen.add_raw(tile, maps[tile][NORMAL.name])
                ready.pictures.add_raw(tile, maps[tile][NORMAL.name])
        drawn = yield from part(_audit(request, run, ready, tally), 1.0, 1.0)
        return drawn, maps


def measure_rays(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    cage: bpy.types.Object | None = None,
) -> RayCast | None:
    """The rays of a bake of these objects; None if it would cast none. Raises BakeError as the bake does."""
    # Nothing is stored, so it does not matter where.
    settings = settings.without_file().without_materials()
    settings.check()
    job = Job(low, highs, cage)
    check_job(context, job, settings)
    meshes = read_meshes(context, Request(job, settings))
    with gpu_memory.trimmed():
        tiles = tiles_to_bake(meshes, settings.sampling)
        in_order = stacked_uvs.ordered(meshes, tiles, settings.sampling)
        plan = choose_method(in_order, tiles, settings.tracing, reading.lengths_of(context.scene))
        return progress.finish(normal_source(plan, Run(settings))).ray_cast


def report_of(drawn: DrawnJob, stored: Stored, notes: Sequence[str] = (), margin: float | None = None) -> Report:
    """The report of a bake. notes: warnings about what was stored, in sentences. margin: of the stored map, if it differs from
    the drawn one."""
    job, settings = drawn.request.job, drawn.request.settings
    plan, ray_cast, findings = drawn.plan, drawn.ray_cast, drawn.findings
    return Report(
        method=plan.method,
        space=settings.map.space,
        size=settings.sampling.size,
        low=drawn.meshes.low.name,
        material=job.material,
        slots=list(job.slots or ()),
        high=drawn.labels[Labeled.OBJECTS],
        cage=drawn.meshes.cage.name if drawn.meshes.cage else "",
        refs=job.refs,
        settings=settings.flat(),
        uv_layer=drawn.meshes.uv_layer,
        why=plan.why,
        triangles=findings.triangles,
        mended=drawn.meshes.mended.to_dict() if drawn.meshes.mended is not None else {},
        turned_parts=[asdict(part) for part in drawn.meshes.mended.largest] if drawn.meshes.mended is not None else [],
        materials=material_inputs.ways(drawn.meshes, settings.map),
        distances={"extrusion": ray_cast.extrusion, "max_distance": ray_cast.max_distance} if ray_cast else {},
        measured=ray_cast is not None and ray_cast.is_measured,
        low_offset=ray_cast.offset * ray_cast.ray_scene.local_space.size if ray_cast else 0.0,
        blend_width=ray_cast.blend_width if ray_cast else 0.0,
        rays=drawn.rays,
        missed=findings.missed,
        coverage=findings.coverage,
        stopped_early=drawn.stopped_early,
        margin=findings.margin if margin is None else margin,
        overlap=findings.checks["overlap"]["share"],
        mirrored=findings.checks["mirrored"]["count"],
        checks=findings.checks,
        targets=drawn.targets,
        deviation=drawn.deviation,
        between=drawn.between,
        appearance=drawn.appearance.to_dict() if drawn.appearance is not None else {},
        picture=drawn.picture,
        tiles=[tile for tile in plan.tiles if tile in stored.tiles],
        maps=_with_meanings(drawn, stored.maps),
        attributes=stored.attributes,
        loss=stored.loss,
        image=stored.image.name,
        output=stored.paths,
        mip_files=stored.mip_files,
        backend=gpu.platform.backend_type_get(),
        renderer=gpu.platform.renderer_get(),
        seconds=drawn.timings.seconds,
        warnings=severity.remaining(
            (
                *drawn.warnings,
                *map(Warned, material_inputs.notes(drawn.meshes, settings.map)),
                *map(Warned, attribute_notes(drawn.meshes, settings.map)),
                *map(Warned, material_inputs.bare_notes(drawn.meshes, job.found_highs, settings.map)),
                *map(Warned, slope_notes(settings)),
                *map(Warned, plan.warnings),
                *findings.warnings,
                *(Warned(text, severity.REBUILT) for text in deviations.engine_warnings(drawn.targets)),
                *(Warned(text, severity.HIDDEN_MISSES if text == HIDDEN_MISSES else "") for text in notes),
            )
        ),
    )


def attribute_notes(meshes: Meshes, map_settings: MapSettings) -> list[str]:
    """The high meshes without the attribute that the attribute map shows, and attributes with values that are no numbers."""
    lacking = [
        repr(high.name) for high in meshes.highs if (triangle_mesh.ATTRIBUTE, map_settings.attribute) not in high.layers
    ]
    notes = []
    for high in meshes.highs:
        names: dict[int, str] = {}  # the attribute that is set to render can have been read by its name, too
        for (kind, name), values in high.layers.items():
            if kind == triangle_mesh.ATTRIBUTE:
                wrong = surface_tables.count_others(values)
                names[wrong] = name or names.get(wrong, "")
        notes += [
            f"The {_attribute(name)} of {high.name!r} is not finite at {wrong:,} face corners: NaN counts as 0 there, "
            f"infinity as {surface_tables.LARGEST_FINITE:,.0f}."
            for wrong, name in names.items()
            if wrong
        ]
    if lacking and map_types.ATTRIBUTE.name in map_settings.drawn_maps:
        wanted = _attribute(map_settings.attribute)
        notes.append(f"The attribute map is black where the high mesh has no {wanted}: {shorten_list(lacking)}.")
    return notes


def _attribute(name: str) -> str:
    """An attribute in a sentence. name: empty for the color attribute that is set to render."""
    return f"attribute {name!r}" if name else "color attribute"


def slope_notes(settings: Settings) -> list[str]:
    """That one sample does not show the detail in a texel."""
    if settings.sampling.samples > 1 or map_types.WIDENED_ROUGHNESS.name not in settings.map.drawn_maps:
        return []
    return [Fix.SAMPLES.after("With 1 sample in a texel, widened roughness is the roughness of the material.")]


def _with_meanings(drawn: DrawnJob, maps: dict[str, dict]) -> dict[str, dict]:
    """`maps` with what values mean that do not depend on the bake's other values, also in packed channels."""
    settings = drawn.request.settings
    if not any(BY_NAME[name].family in ray_maps.WITH_MEANING for name in settings.map.drawn_maps):
        return maps
    space = local_space_of(drawn.plan.meshes.highs)
    meanings = {name.lower(): how for name, how in ray_maps.meanings(settings, space).items()}
    found = {name: how | meanings.get(name, {}) for name, how in maps.items()}
    for how in found.values():
        for channel in how.get("channels", {}).values():
            channel.update(meanings.get(channel.get("map", ""), {}))
    return found
