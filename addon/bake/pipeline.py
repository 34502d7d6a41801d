# SPDX-License-Identifier: GPL-3.0-or-later
"""The story of a bake: check, read the meshes, draw, read back, store, hook up, report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import bpy
import gpu
import numpy as np

from ..mesh import arrays
from ..mesh.arrays import Mesh
from ..passes import resolve, target
from . import audit, casting, images, materials, methods, pace, reading, render, subjects
from .errors import BakeError
from .finish import Finish, upwards
from .pace import Pace, Step, Work, part
from .pairs import Suffixes, match
from .report import Report
from .settings import Settings

TOLD_EVERY = 0.25
"""Seconds between two steps of which somebody wants to hear."""


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
    context: bpy.types.Context,
    jobs: Sequence[Job],
    settings: Settings,
    *,
    share_image: bool = False,
    tell: Callable[[Step], None] | None = None,
) -> list[Report]:
    """All that `work` does, at once; `tell` hears how far it is."""
    return pace.finish(work(context, jobs, settings, Pace(TOLD_EVERY if tell else None), share_image=share_image), tell)


def work(
    context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, speed: Pace, *, share_image: bool = False
) -> Work[list[Report]]:
    """Bake several jobs, each low against its own highs alone, into an image each or, shared, into one (an atlas).

    A generator: between its steps Blender may go on, and closing it leaves everything as it was, but for jobs that were
    done before. "{low}" in the settings' image and output stands for the low object's name. What can be known beforehand
    is checked for all jobs before the first is baked. Raises BakeError; jobs before the one that failed are done, unless
    they were to share its image.
    """
    named = [_for_low(settings, "atlas" if share_image else job.low.name) for job in jobs]
    places = {(own.output if own.storage == "FILE" else own.image).casefold() for own in named}
    if not share_image and len(places) < len(jobs):
        raise BakeError("Several maps would go into one place: put {low} into its name, or let them share it.")
    for job, own in zip(jobs, named, strict=True):
        _check(context, job, own)
    bakes = []
    for number, (job, own) in enumerate(zip(jobs, named, strict=True)):
        report = Report(own.method, own.space, (own.width, own.height), job.low.name, [h.name for h in job.highs])
        bakes.append(_Bake(job, own, report, speed))
        steps = bakes[-1].normals(context) if share_image else bakes[-1].whole(context)
        for step in part(steps, number / len(jobs), (number + 1) / len(jobs)):
            yield replace(step, finished=0 if share_image else number)
    if share_image:
        yield Step("Storing", 1.0)
        _store_atlas(bakes, named[0])
    return [bake.report for bake in bakes]


def _for_low(settings: Settings, name: str) -> Settings:
    """The settings with names filled in; without one the image is called after the low object."""
    return replace(
        settings,
        image=images.name_for(name, settings),
        output=settings.output.replace("{low}", bpy.path.clean_name(name)),
    )


class _Bake:
    """One job on its way."""

    def __init__(self, job: Job, settings: Settings, report: Report, speed: Pace):
        self.job, self.settings, self.report, self.pace = job, settings, report, speed
        self.tally = audit.Tally()
        self.drawn: dict[int, np.ndarray] = {}
        self.low: Mesh | None = None

    def whole(self, context: bpy.types.Context) -> Work[None]:
        """From the objects to the image and the material."""
        with self.report.timed("total"):
            outputs = _Outputs(self.job.low.name, self.settings)
            yield from self._drawn(context, outputs.add)
            yield Step("Storing", 1.0)
            with self.report.timed("image"):
                outputs.commit([self.job], [self.report])

    def normals(self, context: bpy.types.Context) -> Work[None]:
        """From the objects to normals, which stay in `drawn`."""
        with self.report.timed("total"):
            yield from self._drawn(context, None)

    def _drawn(self, context: bpy.types.Context, add) -> Work[None]:
        """Read the objects and draw their map, tile by tile: `add` gets texels and state, or `drawn` the normals."""
        settings, report = self.settings, self.report
        name = self.job.low.name
        report.backend, report.renderer = gpu.platform.backend_type_get(), gpu.platform.renderer_get()
        yield Step(f"Reading {name}", 0.0)
        with report.timed("extract"):
            meshes = reading.read(context, self.job.low, self.job.highs, self.job.cage, settings)
        self.low, report.uv_layer = meshes.low, meshes.uv_layer
        report.tiles = tiles = _tiles(meshes.low, settings)
        try:
            yield Step(f"Looking at {name}", 0.1)
            meshes = methods.choose(meshes, tiles, settings, report)
            source = yield from part(methods.source(meshes, tiles, settings, report, self.pace), 0.1, 0.2)
            renderer = render.Renderer(source, meshes.basis, settings, report, self.pace)
            finish = Finish([meshes.low], settings) if add else None
            for number, tile in enumerate(tiles):
                steps = renderer.texels(tile, finish) if add else renderer.normals(tile)
                drawn = yield from part(steps, 0.2 + 0.7 * number / len(tiles), 0.2 + 0.7 * (number + 1) / len(tiles))
                is_tangent = settings.space == "TANGENT"
                if add:
                    texels, state = drawn
                    self.tally.add(state, upwards(texels, settings) if is_tangent else None)
                    add(tile, texels, state)
                else:
                    self.drawn[tile] = drawn
                    self.tally.add(_state(drawn), drawn[..., 2] if is_tangent else None)
            if not self.tally.written:
                raise BakeError(methods.nothing_drawn(meshes, tiles, report))
            yield Step(f"Checking {name}", 0.9)
            audit.tell(meshes, self.tally, tiles, settings, report)
        finally:
            target.trim()
            casting.trim()


class _Outputs:
    """The images that a bake fills: the map and what was asked for beside it."""

    def __init__(self, low_name: str, settings: Settings):
        self.settings = settings
        self.map = images.Writer(low_name, settings)
        self.mask = images.Writer(low_name, images.beside(settings, images.MISSED)) if settings.mask else None

    def add(self, tile: int, texels: np.ndarray, state: np.ndarray) -> None:
        """Take one tile."""
        self.map.add(tile, texels)
        if self.mask:
            self.mask.add(tile, images.black_and_white(state == resolve.MISSED))

    def commit(self, jobs: Sequence[Job], reports: Sequence[Report]) -> None:
        """Put all images in their places and the map into the materials of the low objects that it is for."""
        settings = self.settings
        image = self.map.commit()
        if self.mask:
            self.mask.commit()
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


def _store_atlas(bakes: Sequence[_Bake], settings: Settings) -> None:
    """One map of what several bakes drew: the margin comes last, so that no object's runs over another's texels."""
    report = bakes[-1].report
    with report.timed("total"):
        merged: dict[int, np.ndarray] = {}
        for bake in bakes:
            for tile, normals in bake.drawn.items():
                merged[tile] = _merge(merged[tile], normals, bake.report) if tile in merged else normals
        # In all their samples and in their own tangent spaces already.
        plain = replace(settings, samples=1)
        finish, outputs = Finish([bake.low for bake in bakes], plain), _Outputs("", settings)
        tally = audit.Tally()
        for tile, normals in merged.items():
            renderer = render.Renderer(render.array_source(normals), None, plain, report, Pace())
            texels, state = pace.finish(renderer.texels(tile, finish))
            tally.add(state, None)
            outputs.add(tile, texels, state)
        with report.timed("image"):
            outputs.commit([bake.job for bake in bakes], [bake.report for bake in bakes])
    for bake in bakes:
        bake.report.margin = tally.margin / tally.texels


def _merge(below: np.ndarray, above: np.ndarray, report: Report) -> np.ndarray:
    """Normals of two objects in one map. Misses yield to hits; else the later one stays."""
    hits = above[..., 3] > 0.0
    lost = np.count_nonzero(hits & (below[..., 3] > 0.0))
    if lost > audit.MUCH_OVERLAP * max(1, np.count_nonzero(hits)):
        report.warnings.append(
            f"{lost:,} texels of {report.low!r} lie over those of others in the same image: give each its own place, or a "
            "map each with {low} in the name."
        )
    wins = hits | ((above[..., 3] < 0.0) & (below[..., 3] <= 0.0))
    return np.where(wins[..., None], above, below)


def _state(normals: np.ndarray) -> np.ndarray:
    """The state of texels without a margin, from the alpha of their normals."""
    alpha = normals[..., 3]
    return np.where(alpha > 0.0, resolve.WRITTEN, np.where(alpha < 0.0, resolve.MISSED, 0)).astype(np.uint8)


def _tiles(low: Mesh, settings: Settings) -> list[int]:
    """The UDIM tiles to bake."""
    if not settings.udim:
        return [1001]
    found = arrays.tiles(low)
    wanted = [tile for tile in found if not settings.tiles or tile in settings.tiles]
    if not wanted:
        where = ", ".join(map(str, found)) or "no tile"
        raise BakeError(
            f"{low.name!r} lies on {where}"
            + (
                f", not on {', '.join(map(str, settings.tiles))}."
                if settings.tiles
                else ": its UVs are empty or negative."
            )
        )
    return wanted


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
