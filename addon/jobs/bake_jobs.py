# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes several jobs, each into its own image, or all into a shared one.

Fills in names, checks for clashes, and counts maps.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import bpy

from .. import older_blender
from ..core import naming, progress
from ..core.declarations.choices import Occluders
from ..core.errors import BakeError
from ..core.naming import ATLAS
from ..core.progress import Pace, Progress, Task, part, relay
from ..core.report import Report
from ..core.settings import Settings, TracingSettings
from ..output import map_names
from ..scene import evaluation, object_checks
from ..scene.high_materials import NO_MATERIAL
from ..scene.object_checks import ObjectRef
from . import one_material, pair_checks, shared_image, weights
from .job import (
    NOTHING_ELSE,
    Job,
    Request,
    Wants,
    by_material,
    check_clashes,
    check_job,
    files_kept,
)
from .shared_bake import Texture, into_one

PROGRESS_SECONDS = 0.25
"""Seconds between two calls of a listener."""


def bake_pair(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    cage: bpy.types.Object | None = None,
) -> Report:
    """Bake the detail of `highs` into a map for `low`, and put the map into its materials.

    Raises BakeError, and then the scene, the image and its file are as before.
    """
    return bake_all(context, [Job(low, highs, cage)], settings)[0]


def bake_all(
    context: bpy.types.Context,
    jobs: Sequence[Job],
    settings: Settings,
    *,
    wants: Wants = NOTHING_ELSE,
    share_image: bool = False,
    shared_name: str = ATLAS,
    only: Collection[int] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> list[Report]:
    """Do all of `work` at once. on_progress: called with each step."""
    pace = Pace(PROGRESS_SECONDS if on_progress else None)
    sharing = {"share_image": share_image, "shared_name": shared_name, "only": only}
    steps = work(context, jobs, settings, pace, wants=wants, **sharing)
    return older_blender.with_gpu(lambda: progress.finish(steps, on_progress))


def work(
    context: bpy.types.Context,
    jobs: Sequence[Job],
    settings: Settings,
    pace: Pace,
    *,
    wants: Wants = NOTHING_ELSE,
    share_image: bool = False,
    shared_name: str = ATLAS,
    only: Collection[int] | None = None,
    also: Collection[int] = (),
    goes_on: bool = False,
) -> Task[list[Report]]:
    """Bake several jobs, each low object only from its own high objects, into an image each, or into a shared one (an atlas);
    with texture sets, into an image for each material that a low object has, or that all have which wear it.

    A generator: Blender can continue between its steps. If it is closed early, finished images stay, and nothing else changes.
    Steps with its reports follow each. All jobs are checked before the first is baked. Raises BakeError; images before the
    one that failed stay.

    Args:
        settings: "{low}" in image and output is replaced by the low object's name.
        wants: besides the maps, of each bake.
        share_image: whether the low objects share one image, or one for each material.
        shared_name: takes the place of "{low}" in the name of a shared image, and of the material where faces have none.
        only: session_uids of the low objects that are baked; None for all. The others keep their texels, but shade what is
            baked, and their names count.
        also: session_uids of others that are baked as well where an image that low objects share has not their texels, or
            cannot keep them beside new ones.
        goes_on: whether a bake that fails does not end the others: a step with the failure follows it, and only if all fail, it
            raises BakeError.
    """
    shared_name = shared_name if share_image else ""
    groups = _groups(context, jobs, settings, wants, shared_name)
    if only is not None and also and shared_name:
        only = _with_lost(context, groups, only, also)
    planned, failures = _checked(context, groups, only, shared_name)
    for name, error in failures.items():
        if not goes_on:
            raise error
        yield Progress("Starting", 0.0, failure=(name, str(error)))
    if failures and not planned:
        raise next(iter(failures.values()))
    total, begun = sum(len(texture.requests) for texture in planned), 0
    reports: list[Report] = []
    failed: dict[str, str] = {}
    for texture in planned:
        lows = [request.job.low_ref.name for request in texture.requests]
        start, begun = begun / total, begun + len(lows)
        failed = {}
        steps = part(into_one(context, texture, pace, failed if goes_on else None), start, begun / total)
        try:
            baked = yield from relay(steps, partial(replace, finished=len(reports), low="" if share_image else lows[0]))
        except BakeError as error:
            if not goes_on:
                raise
            baked, failed = [], dict.fromkeys(lows, str(error)) | failed
        for failure in failed.items():
            yield Progress("Storing", begun / total, finished=len(reports), failure=failure)
        for report in baked:
            reports.append(report)
            yield Progress("Storing", begun / total, finished=len(reports), report=report)
    if not reports and failed:
        raise BakeError(next(iter(failed.values())))
    return reports


def _with_lost(
    context: bpy.types.Context, groups: Sequence[Sequence[Request]], only: Collection[int], also: Collection[int]
) -> set[int]:
    """`only`, and the low objects among `also` whose texels are not in an image that is baked, or cannot stay there. One that
    has several images may bring those of another one of them. only, also: as in `work`."""
    wanted, before = {*only}, -1
    while len(wanted) != before:
        before = len(wanted)
        for group in groups:
            jobs = [request.job for request in group if request.job.low_ref.uid in wanted]
            others = [request.job for request in group if request.job.low_ref.uid in {*also} - wanted]
            with suppress(BakeError):  # the bake tells it
                if jobs and others:
                    wanted |= {job.low_ref.uid for job in shared_image.lost(context, jobs, others, group[0].settings)}
    return wanted


def _checked(
    context: bpy.types.Context, groups: Sequence[Sequence[Request]], only: Collection[int] | None, shared_name: str
) -> tuple[list[Texture], dict[str, BakeError]]:
    """What can be baked, by image, and why others cannot, by the names of low objects. only, shared_name: as in `work`; no name
    if low objects share no images."""
    planned: list[Texture] = []
    failures: dict[str, BakeError] = {}
    for group in groups:
        ready = []
        for request in group:
            if only is not None and request.job.low_ref.uid not in only:
                continue
            try:
                check_job(context, request.job, request.settings)
                ready.append(request)
            except BakeError as error:
                failures.setdefault(request.job.low_ref.name, error)
        jobs = [request.job for request in ready]
        try:
            if ready:
                kept = shared_image.kept(context, jobs, ready[0].settings, is_shared=bool(shared_name))
                lows = frozenset(request.job.low_ref for request in group)
                planned.append(Texture(ready, kept, shared_name, lows))
        except BakeError as error:
            failures = {job.low_ref.name: error for job in jobs} | failures
    return planned, failures


def all_or_nothing(baking: Task[list[Report]]) -> Task[list[Report]]:
    """`baking`, in whose steps no map counts as finished: none is kept if it is closed early."""
    return relay(baking, partial(replace, finished=0, low="", report=None))


def _groups(
    context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, wants: Wants, shared_name: str
) -> list[list[Request]]:
    """The bakes of `work`, by the images that they fill. shared_name: empty if low objects share none. Raises BakeError."""
    settings.check()  # before object names are filled in, which may contain anything
    wants = replace(wants, for_others=pair_checks.is_for_others(settings, is_exported=wants.exported))
    settings = settings.read_by(context.scene.render.engine)
    requests = [replace(each, wants=wants) for each in _requests(context, jobs, settings, shared_name)]
    jobs = [each.job for each in requests]
    by_image: dict[object, list[Request]] = {}
    for request in requests:
        storing = request.settings.storing
        by_image.setdefault((storing.image, storing.output) if shared_name else id(request), []).append(request)
    groups = list(by_image.values())
    if not shared_name:
        one_material.check_apart([job.low for job in jobs], settings.storing)
    titles = [group[0].job.material or shared_name if shared_name else group[0].job.title for group in groups]
    check_clashes(settings.storing, [group[0].settings for group in groups], titles, files_kept(jobs, settings.storing))
    return groups


def named(settings: Settings, job: Job, shared_name: str = "") -> Settings:
    """The settings with the names of the images of a job filled in. shared_name: as in `work`; empty if it has its own."""
    if shared_name:
        return for_shared(settings, shared_name, job.material)
    return for_low(settings, job.low.name, job.material)


def for_shared(settings: Settings, shared_name: str, material: str = "") -> Settings:
    """The settings with the names of images that low objects share filled in: one for all, or that of a material."""
    if not material:
        return for_low(settings, shared_name)
    storing = settings.storing
    image, output = map(naming.of_shared_textures, (storing.image or naming.USUAL, storing.output))
    material = shared_name if material == NO_MATERIAL else material
    return for_low(settings.stored(image=image, output=output), shared_name, material)


def requests_of(
    context: bpy.types.Context, job: Job, settings: Settings, *, jobs: Sequence[Job] = (), shared_name: str = ""
) -> list[Request]:
    """The requests that `work` makes of one of several jobs, one for each texture set, without its checks. Raises BakeError.

    jobs: all of them; empty for `job` alone. shared_name: empty if low objects share no image.
    """
    settings = settings.read_by(context.scene.render.engine)
    return list(_requests(context, jobs or [job], settings, shared_name, of=job.low_ref.uid))


def _requests(
    context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, shared_name: str, of: int | None = None
) -> Iterator[Request]:
    """Each bake of `work`, without its wants, as a low object alone reads what its own needs. of: the session_uid of the low
    object whose bakes are returned; None for all."""
    if settings.map.texture_sets:
        jobs = by_material(jobs, settings.storing, shares=bool(shared_name))
    own_jobs = [job for job in jobs if of in (None, job.low_ref.uid)]
    for job, of_job in zip(own_jobs, weights.settings_by_job(jobs, settings, own_jobs), strict=True):
        own = _of_job(of_job, job, is_shared=bool(shared_name))
        shading = occluders(context, job, jobs, settings.tracing)
        yield Request(job, named(own, job, shared_name), NOTHING_ELSE, shading, own, bool(shared_name))


def _of_job(settings: Settings, job: Job, *, is_shared: bool) -> Settings:
    """The settings with the size and the distances that a job has for itself, see also `beside_materials`. is_shared: whether
    others share its images, which then have only the size of a material."""
    settings = beside_materials(settings, job)
    if job.tracing is not None:
        settings = settings.traced(
            method=job.tracing.method, extrusion=job.tracing.extrusion, max_distance=job.tracing.max_distance
        )
    if job.size and (job.material or not is_shared):
        settings = settings.sampled(width=job.size, height=job.size)
    if job.distance:  # rays start outside, and reach as far inside
        settings = settings.traced(extrusion=job.distance, max_distance=2.0 * job.distance)
    return settings


def beside_materials(settings: Settings, job: Job) -> Settings:
    """The settings; of a mesh that is baked onto itself, the materials stay: the next bake would read the maps in them."""
    is_itself = object_checks.is_itself(job.low, job.highs)
    return settings.stored(material=False, connect_maps=False) if is_itself else settings


def occluders(
    context: bpy.types.Context, job: Job, jobs: Sequence[Job], tracing: TracingSettings
) -> tuple[ObjectRef, ...]:
    """What shades the high objects of a job: those of the other jobs, or what the scene shows, as the settings have it.

    Low objects and cages of the jobs do not: they are in the place of high ones. Nor do floaters.
    """
    if tracing.occluders == Occluders.OWN:
        return ()
    refs = {ref.uid: ref for each in jobs for ref in each.high_refs}
    if tracing.occluders == Occluders.SCENE:
        left_out = {ref.uid for each in jobs for ref in each.refs}
        shown = map(ObjectRef.of, evaluation.shown_surfaces(context))
        refs |= {ref.uid: ref for ref in shown if ref.uid not in left_out}
    floaters = {uid for each in jobs for uid in each.floaters}
    for own in job.refs:
        refs.pop(own.uid, None)
    shading = ((ref, ref.find()) for ref in refs.values() if ref.uid not in floaters)
    return tuple(ref for ref, obj in shading if obj is None or not object_checks.is_floater(obj))


def for_low(settings: Settings, name: str, material: str = "") -> Settings:
    """The settings with names filled in. Without a name, the image is named after the low object and the texture set."""
    return settings.stored(
        image=map_names.name_for(name, settings.storing, material),
        output=naming.fill(settings.storing.output, name, material, low_suffix=settings.storing.low_suffix),
    )
