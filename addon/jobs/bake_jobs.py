# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes several jobs, each into its own image, or all into a shared one.

Fills in names, checks for clashes, and counts maps.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial

import bpy
import numpy as np

from .. import older_blender
from ..audit import severity
from ..core import naming, progress
from ..core.declarations.choices import Occluders
from ..core.errors import BakeError, shorten_list
from ..core.map_types import BY_NAME, MARGIN, MISSED, NORMAL, Labeled, Map
from ..core.naming import ATLAS
from ..core.progress import Pace, Progress, Task, Timings, part, relay
from ..core.report import Report
from ..core.sentences import WRONG, Sentence
from ..core.settings import Run, Settings, TracingSettings
from ..engine import gpu_memory, margins, mip_levels
from ..engine.baking import texels_of
from ..engine.bands import DrawnMaps
from ..mesh.triangle_mesh import Mesh
from ..output import map_names
from ..output.materials import into_materials
from ..output.outputs import Outputs, Stored
from ..scene import evaluation, object_checks
from ..scene.high_materials import NO_MATERIAL
from ..scene.object_checks import ObjectRef
from . import one_material, pair_checks, shared_image, weights
from .bake import bake_job, draw_raw
from .baked import Baked
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
from .one_material import Shown
from .shared_image import Kept


class Atlas:
    """Collects the maps of bakes, as Renderer.raw returns them, and stores them as one. kept: what others have in it."""

    def __init__(self, settings: Settings, kept: Kept | None = None):
        self.kept = kept or Kept()
        # All samples and the tangent spaces of the objects are already in the maps.
        self.settings = settings.sampled(samples=1)
        self.drawn: list[Baked] = []
        self.tiles: dict[int, dict[str, np.ndarray]] = {}
        self._owners: dict[int, np.ndarray] = {}
        """Of each texel (height, width) int16 of a tile, the number of the bake that drew it, from 1; 0 for none."""
        self.labels: dict[Labeled, list[str]] = {labeled: [] for labeled in Labeled}
        self._warnings: list[list[str]] = []

    def add(self, drawn: Baked, maps: dict[int, dict[str, np.ndarray]]) -> None:
        """Add the maps of one bake, by tile and name. Hits replace misses; among hits, the later bake wins."""
        self._renumber(maps, drawn.labels)
        self.drawn.append(drawn)
        self._warnings.append([])
        for tile, above in maps.items():
            if tile in self.tiles:
                self._lay_over(tile, above)
            else:
                self.tiles[tile] = above
                self._owners[tile] = (above[NORMAL.name][..., 3] != 0.0).astype(np.int16) * len(self.drawn)

    def store(self) -> list[Report]:
        """Add the margin and store the maps. Returns a report of each bake. Raises BakeError."""
        last = self.drawn[-1].timings
        baked = [
            shared_image.part_of(each.meshes, each.request.job.material, each.request.settings.sampling.samples)
            for each in self.drawn
        ]
        with last.in_total(), Outputs(self.settings, baked, self.kept.parts, self.kept.tiles) as outputs:
            # Before anything changes: it raises if one was deleted.
            lows = [drawn.request.job.low for drawn in self.drawn]
            for low, drawn in zip(lows, self.drawn, strict=True):
                meshes = drawn.meshes
                slots = drawn.request.job.slots
                outputs.sample_onto(low, meshes.uv_layer, is_own_base=meshes.is_own_base, slots=slots)
            margin = self._fill(outputs, last)
            with last.timed("image"):
                stored = outputs.commit(self.labels, lows)
                self._warnings[0] += stored.warnings
                self._show(lows, stored)
        return [
            Report.of(drawn.stored_as(stored, warnings, margin))
            for drawn, warnings in zip(self.drawn, self._warnings, strict=True)
        ]

    def _show(self, lows: Sequence[bpy.types.Object], stored: Stored) -> None:
        """Show the stored maps in the materials of the low objects. Adds to the warnings."""
        shown = [
            Shown(low, drawn.meshes.uv_layer, stored.image, stored.maps, drawn.meshes.is_own_base)
            for low, drawn in zip(lows, self.drawn, strict=True)
        ]
        if self.settings.storing.one_material:
            self._warnings[0] += one_material.put(shown, self.settings, ATLAS if len(lows) > 1 else lows[0].name)
            return
        for each, drawn, warnings in zip(shown, self.drawn, self._warnings, strict=True):
            own, slots = drawn.request.settings, drawn.request.job.slots
            warnings.extend(
                into_materials(each.low, stored, each.uv_layer, own, slots=slots, is_own_base=each.is_own_base)
            )

    def _fill(self, outputs: Outputs, timings: Timings) -> float:
        """Add all maps with their margin to `outputs`. Returns the share of the texels that is margin."""
        lows = [*self._lows, *self.kept.meshes]
        post_processes = margins.for_maps(lows, self.settings, has_owner=bool(self.kept))
        margin = texels = 0
        with gpu_memory.trimmed():
            for tile, maps in self.tiles.items():
                run, is_kept = Run(self.settings, timings=timings), None
                if self.kept:
                    is_of_others = self._of_others(tile, maps)
                    self._owners[tile][is_of_others] = 0
                    maps = margins.with_owner(maps, is_of_others)  # noqa: PLW2901 - the same, with more
                finished = progress.finish(texels_of(DrawnMaps(maps), tile, run, post_processes))
                if self.kept:
                    is_kept = margins.without_others(finished, post_processes)
                self._fill_misses(tile, maps, finished, run, post_processes)
                state = finished[NORMAL.name][1]
                margin += int(np.count_nonzero(state == MARGIN))
                texels += state.size
                outputs.add(tile, finished, progress.finish(mip_levels.of(finished, tile, run)), is_kept)
        return margin / texels

    def _fill_misses(
        self,
        tile: int,
        maps: dict[str, np.ndarray],
        finished: dict[str, Map],
        run: Run,
        processes: dict[str, margins.PostProcess],
    ) -> None:
        """Let the colors of each bake go on where its own rays miss: those of others may be nearer, or not known.

        Args:
            maps: Of the tile, without a margin.
            finished: The maps as they are stored, which change in place.
        """
        names = [name for name in finished if BY_NAME[name].fills_misses]
        missed = self._owners[tile] * (finished[NORMAL.name][1] == MISSED)
        numbers = np.unique(missed[missed > 0]) if len(self.drawn) > 1 or self.kept else ()
        for number in numbers:
            is_own, is_missed = self._owners[tile] == number, missed == number
            for name in names:
                own = {name: np.where(is_own[..., None], maps[name], np.float32(0.0))}
                filled = texels_of(DrawnMaps(own), tile, run, {name: processes[name]})
                for whole, part_of in zip(finished[name], progress.finish(filled)[name], strict=True):
                    whole[is_missed] = part_of[is_missed]

    @property
    def _lows(self) -> list[Mesh]:
        return [drawn.meshes.low for drawn in self.drawn]

    def _of_others(self, tile: int, maps: dict[str, np.ndarray]) -> np.ndarray:
        """The texels (height, width) bool of a tile that low objects have which are not baked."""
        is_covered = self.kept.covered(tile, self.drawn[0].request.settings.sampling)
        is_hit = maps[NORMAL.name][..., 3] > 0.0
        lost = np.count_nonzero(is_hit & is_covered)
        if lost > MOST_TAKEN * np.count_nonzero(is_hit):
            names = [shorten_list(repr(low.name) for low in lows) for lows in (self._lows, self.kept.meshes)]
            raise BakeError(
                f"{names[0]} and {names[1]}, which the image has already, have the same texels: choose another name for "
                "the image, or give them UV maps side by side and bake all of them together."
            )
        if lost > severity.MUCH_OVERLAP * max(1, np.count_nonzero(is_hit)):
            text = (
                f"{lost:,} texels overlap texels of other objects in the same image, which stay as they are: move their UVs "
                "apart, or bake a map for each with {low} in the name."
            )
            self._warnings[0].append(Sentence(text, WRONG))
        return is_covered

    def _lay_over(self, tile: int, above: dict[str, np.ndarray]) -> None:
        """Combine one tile of the last bake with those of the bakes before it."""
        below = self.tiles[tile]
        alpha, alpha_below = above[NORMAL.name][..., 3], below[NORMAL.name][..., 3]
        is_hit, was_hit = alpha > 0.0, alpha_below > 0.0
        lost = np.count_nonzero(is_hit & was_hit)
        if lost > severity.MUCH_OVERLAP * max(1, np.count_nonzero(is_hit)):
            low, *before = [drawn.request.job.low for drawn in self.drawn[::-1]]
            same = [repr(other.name) for other in before if other.data == low.data]
            whose = f"{shorten_list(same)}, which have the same mesh" if same else "other objects in the same image"
            apart = "make it a single user and pack the UV maps" if same else "move their UVs apart"
            text = (
                f"{lost:,} texels of {low.name!r} overlap texels of {whose}: {apart}, or bake a map for each with {{low}} in "
                "the name."
            )
            self._warnings[-1].append(Sentence(text, WRONG))
        wins = is_hit | ((alpha < 0.0) & (alpha_below <= 0.0))
        for name, values in above.items():
            np.copyto(below[name], values, where=wins[..., None])
        self._owners[tile][wins] = len(self.drawn)

    def _renumber(self, maps: dict[int, dict[str, np.ndarray]], labels: dict[Labeled, Sequence[str]]) -> None:
        """Give each name in the atlas its own number. Each bake numbers its objects and materials from 1."""
        numbers = {}
        for labeled, names in labels.items():
            known = self.labels[labeled]
            known += [name for name in dict.fromkeys(names) if name not in known]
            numbers[labeled] = np.array([0, *(known.index(name) + 1 for name in names)], np.float32)
        for tile_maps in maps.values():
            for name, values in tile_maps.items():
                labeled = BY_NAME[name].labeled
                if labeled:
                    values[..., :3] = numbers[labeled][values[..., :3].astype(np.int32)]


MOST_TAKEN = 0.1
"""The share of the texels of what is baked that others in the same image may have."""
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
        goes_on: whether a bake that fails does not end the others: a step with the failure follows it, and only if all fail, it
            raises BakeError.
    """
    groups = _groups(context, jobs, settings, wants, shared_name if share_image else "")
    if only is not None:
        groups = [[request for request in group if request.job.low_ref.uid in only] for group in groups]
    planned, failures = _checked(context, groups, is_shared=share_image)
    for name, error in failures.items():
        if not goes_on:
            raise error
        yield Progress("Starting", 0.0, failure=(name, str(error)))
    if failures and not planned:
        raise next(iter(failures.values()))
    total, begun = sum(len(group) for group, _ in planned), 0
    reports: list[Report] = []
    for group, kept in planned:
        start, begun = begun / total, begun + len(group)
        steps = part(_into_one(context, group, pace, kept, is_alone=not share_image), start, begun / total)
        name = "" if share_image else group[0].job.low_ref.name
        try:
            baked = yield from relay(steps, partial(replace, finished=len(reports), low=name))
        except BakeError as error:
            if not goes_on:
                raise
            for request in group:
                failure = request.job.low_ref.name, str(error)
                yield Progress("Storing", begun / total, finished=len(reports), failure=failure)
            if begun == total and not reports:
                raise
        else:
            for report in baked:
                reports.append(report)
                yield Progress("Storing", begun / total, finished=len(reports), report=report)
    return reports


def _checked(
    context: bpy.types.Context, groups: Sequence[Sequence[Request]], *, is_shared: bool
) -> tuple[list[tuple[list[Request], Kept]], dict[str, BakeError]]:
    """The bakes that can be done, by image, with what others keep in it; and why others cannot, by the names of low objects."""
    planned: list[tuple[list[Request], Kept]] = []
    failures: dict[str, BakeError] = {}
    for group in groups:
        ready = []
        for request in group:
            try:
                check_job(context, request.job, request.settings)
                ready.append(request)
            except BakeError as error:
                failures.setdefault(request.job.low_ref.name, error)
        jobs = [request.job for request in ready]
        try:
            if ready:
                kept = shared_image.kept(context, jobs, ready[0].settings, is_shared=is_shared)
                planned.append((ready, kept))
        except BakeError as error:
            failures |= {job.low_ref.name: error for job in jobs}
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
    requests = _requests(context, jobs or [job], settings.read_by(context.scene.render.engine), shared_name)
    return [request for request in requests if request.job.low_ref.uid == job.low_ref.uid]


def _requests(
    context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, shared_name: str
) -> Iterator[Request]:
    """Each bake of `work`, without its wants, as a low object alone reads what its own needs."""
    if settings.map.texture_sets:
        jobs = by_material(jobs, settings.storing, shares=bool(shared_name))
    for job, of_job in zip(jobs, weights.settings_by_job(jobs, settings), strict=True):
        own = _of_job(of_job, job, is_shared=bool(shared_name))
        shading = occluders(context, job, jobs, settings.tracing)
        yield Request(job, named(own, job, shared_name), NOTHING_ELSE, shading, own)


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

    Low objects and cages of the jobs do not: they are in the place of high ones.
    """
    if tracing.occluders == Occluders.OWN:
        return ()
    refs = {ref.uid: ref for each in jobs for ref in each.high_refs}
    if tracing.occluders == Occluders.SCENE:
        left_out = {ref.uid for each in jobs for ref in each.refs}
        shown = map(ObjectRef.of, evaluation.shown_surfaces(context))
        refs |= {ref.uid: ref for ref in shown if ref.uid not in left_out}
    for own in job.refs:
        refs.pop(own.uid, None)
    return tuple(refs.values())


def _into_one(
    context: bpy.types.Context, requests: Sequence[Request], pace: Pace, kept: Kept, *, is_alone: bool = False
) -> Task[list[Report]]:
    """Do all bakes into the same images, with what is kept in them. is_alone: whether it is one bake, into its own images."""
    if is_alone and not kept:
        return [(yield from bake_job(context, requests[0], pace))]
    atlas = Atlas(requests[0].settings, kept)
    for number, request in enumerate(requests):
        run = Run(request.settings, pace)
        steps = run.timings.counted(relay(draw_raw(context, request, run), partial(_check_lows, requests)))
        atlas.add(*(yield from part(steps, number / len(requests), (number + 1) / len(requests))))
    yield Progress("Storing", 1.0)
    return atlas.store()


def _check_lows(requests: Sequence[Request], step: Progress) -> Progress:
    """`step` of a bake into the image of all. Raises BakeError if one of their low objects was deleted."""
    for request in requests:
        request.job.check_low(step)
    return step


def for_low(settings: Settings, name: str, material: str = "") -> Settings:
    """The settings with names filled in. Without a name, the image is named after the low object and the texture set."""
    return settings.stored(
        image=map_names.name_for(name, settings.storing, material),
        output=naming.fill(settings.storing.output, name, material, low_suffix=settings.storing.low_suffix),
    )
