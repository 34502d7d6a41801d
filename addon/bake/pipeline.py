# SPDX-License-Identifier: GPL-3.0-or-later
"""The story of a bake: check, read the meshes, draw, read back, store, hook up, report."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import gpu
import numpy as np

from ..mesh import arrays
from ..passes import resolve, target
from . import agreement, casting, distances, images, materials, reading, render, subjects
from .errors import BakeError
from .pairs import Pair
from .report import Report
from .settings import Settings

MUCH_OVERLAP = 1e-3
"""Share of texels that triangles may share without a warning: decimation leaves a few slivers."""
MANY_MISSES = 1e-3
"""Share of rays that may hit nothing without a warning."""


@dataclass(frozen=True)
class Job:
    """The objects of one bake. `highs` may be [low] alone: its surface with modifiers goes onto its own base mesh.

    cage: has the topology of `low`; rays start on it.
    """

    low: bpy.types.Object
    highs: Sequence[bpy.types.Object]
    cage: bpy.types.Object | None = None


def job_of(pair: Pair) -> Job:
    """The job of objects matched by name."""
    cage = subjects.named(pair.cage) if pair.cage else None
    return Job(subjects.named(pair.low), [subjects.named(name) for name in pair.highs], cage)


def bake(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    cage: bpy.types.Object | None = None,
) -> Report:
    """Bake the detail of `highs` into a map for `low`, and put the map into its material.

    Raises BakeError, with the scene, the image and its file as before, when that cannot be done.
    """
    return bake_all(context, [Job(low, highs, cage)], settings)[0]


def bake_all(
    context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, *, share_image: bool = False
) -> list[Report]:
    """Bake several jobs, each low against its own highs alone, into an image each or, shared, into one (an atlas).

    "{low}" in the settings' image and output stands for the low object's name. What can be known beforehand is checked
    for all jobs before the first is baked. Raises BakeError; jobs before the one that failed are done, unless they were
    to share its image.
    """
    named = [_for_low(settings, "atlas" if share_image else job.low.name) for job in jobs]
    if (
        not share_image
        and len({(s.output, s.image) for s in named}) < len(jobs)
        and (settings.output or settings.image)
    ):
        raise BakeError("Several maps would go into one: put {low} into its name, or let them share it.")
    for job, own in zip(jobs, named, strict=True):
        _check(context, job, own)
    reports, shared = [], None
    for job, own in zip(jobs, named, strict=True):
        report = Report(own.method, own.space, (own.width, own.height), job.low.name, [h.name for h in job.highs])
        reports.append(report)
        with report.timed("total"):
            drawn = _texels(context, job, own, report)
            if share_image:
                shared = drawn if shared is None else _merge(shared, drawn)
            else:
                _store(*drawn, [job], [report], own)
    if share_image:
        with reports[-1].timed("total"):
            _store(*shared, jobs, reports, named[0])
    return reports


def _for_low(settings: Settings, name: str) -> Settings:
    """The settings with names filled in; without one the image is called after the low object."""
    return replace(
        settings,
        image=images.name_for(name, settings),
        output=settings.output.replace("{low}", bpy.path.clean_name(name)),
    )


def _texels(context: bpy.types.Context, job: Job, settings: Settings, report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Read the objects and draw their map: texels and their state, as render.texels has them."""
    report.backend, report.renderer = gpu.platform.backend_type_get(), gpu.platform.renderer_get()
    with report.timed("extract"):
        meshes = reading.read(context, job.low, job.highs, job.cage, settings)
    report.uv_layer = meshes.uv_layer
    try:
        texels, state = _draw(meshes, settings, report)
        _tell(meshes, state, report)
    finally:
        target.trim()
        casting.trim()
    return texels, state


def _merge(below: tuple[np.ndarray, np.ndarray], above: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Two maps in one. Margins yield to what was drawn, misses to what was hit; else the later one stays."""
    rank = np.array([0, 2, 3, 1], np.uint8)  # background, margin, written, missed
    wins = (rank[above[1]] >= rank[below[1]]) & (above[1] > 0)
    return np.where(wins[..., None], above[0], below[0]), np.where(wins, above[1], below[1])


def _store(
    texels: np.ndarray, state: np.ndarray, jobs: Sequence[Job], reports: Sequence[Report], settings: Settings
) -> None:
    """Put a map into its image and into the materials of the low objects that it is for."""
    with reports[-1].timed("image"):
        image = images.store(texels, jobs[0].low.name, settings)
        if settings.mask:
            images.store_mask(state == resolve.MISSED, "missed", settings)
        for job, report in zip(jobs, reports, strict=True):
            report.image = image.name
            report.output = settings.output if settings.storage == "FILE" else ""
            if settings.material:
                report.warnings += materials.hook_up(
                    job.low,
                    image,
                    space=settings.space,
                    uv_layer=report.uv_layer,
                    green=settings.green,
                    single_user=settings.single_user,
                )


def _draw(meshes: reading.Meshes, settings: Settings, report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Texels and their state, by the method asked for or, with AUTO, by the one that fits."""
    if settings.method == "AUTO":
        if meshes.is_own_base:
            report.method, report.why = "FLATTEN", "a surface and its own base mesh share their UVs"
        elif meshes.cage is not None:
            report.method, report.why = "CAST", "there is a cage"
        else:
            report.method, report.why = agreement.choose(meshes.low, meshes.highs)
    if report.method == "FLATTEN":
        source = render.flattened(meshes.low, meshes.highs, settings, report)
    else:
        source = _rays(meshes, settings, report)
    texels, state = render.texels(source, meshes.basis, settings, report)
    if not (state == resolve.WRITTEN).any():
        raise BakeError(_nothing_drawn(meshes, report))
    return texels, state


def _rays(meshes: reading.Meshes, settings: Settings, report: Report) -> render.Source:
    aim = casting.target_of(meshes.highs, report)
    rays = casting.rays(meshes.low, meshes.directions, meshes.cage, aim.frame)
    extrusion, reach = settings.extrusion, settings.max_distance
    if extrusion is None or reach is None:
        with report.timed("distances"):
            size = settings.width, settings.height
            measured = distances.measure(
                aim.tables, rays, size, has_cage=meshes.cage is not None, facing_only=settings.facing_only
            )
        if reach is None:
            # What was measured from the low surface, from wherever rays start.
            reach = (measured[1] - measured[0]) * aim.frame.size
            reach += measured[0] * aim.frame.size if extrusion is None else extrusion
        extrusion = measured[0] * aim.frame.size if extrusion is None else extrusion
    report.distances = {"extrusion": extrusion, "max_distance": reach}
    return render.casted(
        meshes.low, rays, aim, settings, extrusion=extrusion / aim.frame.size, reach=reach / aim.frame.size
    )


def _nothing_drawn(meshes: reading.Meshes, report: Report) -> str:
    """Why no texel was written, as a sentence."""
    names = ", ".join(map(repr, report.high))
    if not arrays.is_on_tile(meshes.low):
        return f"No triangle of {report.low!r} lies on the map: its UVs are outside 0 to 1, or empty."
    if report.method == "FLATTEN":
        if not any(map(arrays.is_on_tile, meshes.highs)):
            return f"No triangle of {names} lies on the map: its UVs are outside 0 to 1, or empty."
        return f"{report.low!r} and {names} have no texel in common: their UV layouts differ, so cast rays instead."
    gap = arrays.gap(meshes.low, meshes.highs)
    if gap > 0.0:
        return f"{report.low!r} and {names} do not overlap: they are {gap:.4g} apart."
    return f"No ray from {report.low!r} hit {names}: give a larger extrusion and maximum distance."


def _tell(meshes: reading.Meshes, state: np.ndarray, report: Report) -> None:
    """Put into the report what was covered, what was missed and what was left out."""
    report.triangles = {"high": sum(len(high.triangles) for high in meshes.highs), "low": len(meshes.low.triangles)}
    written, in_margin, missed = (
        int(np.count_nonzero(state == which)) for which in (resolve.WRITTEN, resolve.MARGIN, resolve.MISSED)
    )
    report.coverage, report.margin = written / state.size, in_margin / state.size
    report.missed = missed / max(1, missed + written)
    if report.missed > MANY_MISSES:
        report.warnings.append(
            f"{report.missed:.2%} of the rays from {report.low!r} hit nothing: those texels have alpha 0. "
            "Look at the extrusion and the maximum distance."
        )
    report.overlap = render.overlap(meshes.low, (state.shape[1], state.shape[0]))
    report.mirrored = arrays.mirrored(meshes.low)
    if report.overlap > MUCH_OVERLAP:
        report.warnings.append(
            f"{report.overlap:.2%} of the texels of {report.low!r} belong to two of its triangles or more: they show the "
            "detail of one of them."
        )
    for mesh in (meshes.low, *meshes.highs):
        laid_flat = mesh is meshes.low or report.method == "FLATTEN"
        no_area, outside = arrays.uv_flaws(mesh) if laid_flat else (0, 0)
        for count, what in (
            (mesh.not_finite, "left out: their coordinates are NaN or infinite"),
            (no_area, "have no area in UV space and cannot be drawn"),
            (outside, "reach outside the UV tile 0 to 1 and are cut off there"),
        ):
            if count:
                report.warnings.append(f"{mesh.name!r}: {count:,} of its triangles {what}.")


def _check(context: bpy.types.Context, job: Job, settings: Settings) -> None:
    settings.check()
    # Scripts link, move and bake without a redraw between: view layers and matrices lag behind until asked.
    context.view_layer.update()
    reason = subjects.problem(context, job.low, job.highs, job.cage, settings.method)
    if reason:
        raise BakeError(reason)
    images.check(job.low.name, settings)
    if settings.material:
        materials.check(job.low)
    try:
        gpu.init()
    except (SystemError, RuntimeError) as error:
        raise BakeError(f"There is no GPU to bake on: {error}.") from error
    limit = gpu.capabilities.max_texture_size_get()
    if settings.width > limit:
        raise BakeError(f"A map {settings.width} texels wide does not fit this GPU, whose limit is {limit}.")
