# SPDX-License-Identifier: GPL-3.0-or-later
"""The story of a bake: check, read the meshes, draw, read back, store, hook up, report."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import gpu
import numpy as np

from ..passes import resolve, target
from . import audit, casting, images, materials, methods, reading, render, subjects
from .errors import BakeError
from .pairs import Suffixes, match
from .report import Report
from .settings import Settings


@dataclass(frozen=True)
class Job:
    """The objects of one bake. `highs` may be [low] alone: its surface with modifiers goes onto its own base mesh.

    cage: has the topology of `low`; rays start on it.
    """

    low: bpy.types.Object
    highs: Sequence[bpy.types.Object]
    cage: bpy.types.Object | None = None


def jobs_by_name(context: bpy.types.Context, suffixes: Suffixes) -> tuple[list[Job], list[str]]:
    """The jobs of the view layer's objects that are matched by name, and sentences about those that are not.

    Raises BakeError when there is no job.
    """
    found, problems = match(context.view_layer.objects.keys(), suffixes)
    if not found:
        raise BakeError(" ".join(problems) or f"No object is called something{suffixes.low}.")
    jobs = [
        Job(
            subjects.named(pair.low),
            [subjects.named(name) for name in pair.highs],
            subjects.named(pair.cage) if pair.cage else None,
        )
        for pair in found
    ]
    return jobs, problems


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
    places = {(own.output if own.storage == "FILE" else own.image).casefold() for own in named}
    if not share_image and len(places) < len(jobs):
        raise BakeError("Several maps would go into one place: put {low} into its name, or let them share it.")
    for job, own in zip(jobs, named, strict=True):
        _check(context, job, own)
    reports, shared = [], None
    for job, own in zip(jobs, named, strict=True):
        report = Report(own.method, own.space, (own.width, own.height), job.low.name, [h.name for h in job.highs])
        reports.append(report)
        with report.timed("total"):
            drawn = _texels(context, job, own, report)
            if share_image:
                shared = drawn if shared is None else _merge(shared, drawn, report)
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
        meshes = methods.choose(meshes, settings, report)
        texels, state = methods.draw(meshes, settings, report)
        audit.tell(meshes, texels, state, report)
    finally:
        target.trim()
        casting.trim()
    return texels, state


def _merge(
    below: tuple[np.ndarray, np.ndarray], above: tuple[np.ndarray, np.ndarray], report: Report
) -> tuple[np.ndarray, np.ndarray]:
    """Two maps in one. Margins yield to what a mesh covers, hit or missed, and misses to hits; else the later one stays."""
    lost = np.count_nonzero((below[1] == resolve.WRITTEN) & (above[1] == resolve.WRITTEN))
    if lost > audit.MUCH_OVERLAP * max(1, np.count_nonzero(above[1] == resolve.WRITTEN)):
        report.warnings.append(
            f"{lost:,} texels of {report.low!r} lie over those of others in the same image: give each its own place, or a "
            "map each with {low} in the name."
        )
    rank = np.array([0, 1, 3, 2], np.uint8)  # background, margin, written, missed
    wins = (rank[above[1]] >= rank[below[1]]) & (above[1] > 0)
    return np.where(wins[..., None], above[0], below[0]), np.where(wins, above[1], below[1])


def _store(
    texels: np.ndarray, state: np.ndarray, jobs: Sequence[Job], reports: Sequence[Report], settings: Settings
) -> None:
    """Put a map into its image and into the materials of the low objects that it is for."""
    with reports[-1].timed("image"):
        image = images.store(texels, jobs[0].low.name, settings)
        if settings.mask:
            images.store_mask(state == resolve.MISSED, images.MISSED, settings)
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
    tallest = max(band.height for band in render.bands(settings.width, settings.height, settings.margin))
    if max(settings.width, tallest) > limit:
        raise BakeError(
            f"A map of {settings.width} x {settings.height} texels with a margin of {settings.margin} does not fit this GPU, "
            f"whose textures have at most {limit} a side."
        )
