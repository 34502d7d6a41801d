# SPDX-License-Identifier: GPL-3.0-or-later
"""The story of a bake: check, read the meshes, draw, read back, store, hook up, report."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace

import bpy
import gpu
import numpy as np

from ..audit import checks
from ..core import file_names, progress, udim
from ..core.errors import BakeError, shorten_list
from ..core.name_matching import Suffixes, match
from ..core.progress import Pace, Progress, Task, part
from ..core.report import Report
from ..core.settings import Settings
from ..engine import gpu_memory, method_choice, post_process, ray_casting, rendering
from ..engine.bands import bands
from ..mesh import uv_layout
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import image_writer, materials, output_clashes
from ..output.outputs import Outputs
from ..scene import bake_objects, reading
from . import atlas

TOLD_EVERY = 0.25
"""Seconds between two steps of which somebody wants to hear."""
ATLAS = "atlas"
"""What stands for the low object's name where several share an image."""


class Job:
    """The objects of one bake. `highs` may be [low] alone: its surface with modifiers goes onto its own base mesh.

    It outlives renaming and undo. The attributes `low`, `highs` and `cage`, which has the topology of `low` and lets rays
    start on it, raise BakeError for an object that was deleted.
    """

    def __init__(self, low: bpy.types.Object, highs: Sequence[bpy.types.Object], cage: bpy.types.Object | None = None):
        self.refs = [bake_objects.hold(obj) for obj in (low, *highs, *([cage] if cage else []))]
        self._has_cage = cage is not None

    @property
    def low(self) -> bpy.types.Object:
        return self.refs[0].resolve()

    @property
    def high_refs(self) -> list[bake_objects.ObjectRef]:
        return self.refs[1 : len(self.refs) - self._has_cage]

    @property
    def highs(self) -> list[bpy.types.Object]:
        return [ref.resolve() for ref in self.high_refs]

    @property
    def cage(self) -> bpy.types.Object | None:
        return self.refs[-1].resolve() if self._has_cage else None

    def renew(self) -> bool:
        """Whether one has another session_uid now, as after its library was reloaded; from then on it is known by that.

        Raises BakeError if one was deleted.
        """
        found = [ref.resolve() for ref in self.refs]
        is_new = any(obj.session_uid != ref.uid for obj, ref in zip(found, self.refs, strict=True))
        if is_new:
            self.refs = [bake_objects.hold(obj) for obj in found]
        return is_new

    def report(self, settings: Settings) -> Report:
        """What a bake of these objects is to fill. Raises BakeError if one was deleted."""
        low, highs, cage = self.low, self.highs, self.cage
        return Report(
            settings.method,
            settings.space,
            (settings.width, settings.height),
            low.name,
            [high.name for high in highs],
            cage=cage.name if cage else "",
            refs=self.refs,
        )


def jobs_by_name(context: bpy.types.Context, suffixes: Suffixes) -> tuple[list[Job], list[str]]:
    """The jobs of the view layer's objects that are matched by name, and sentences about those that are not.

    Raises BakeError when there is no job.
    """
    objects = context.view_layer.objects
    found, problems = match(objects.keys(), suffixes)
    if not found:
        raise BakeError(" ".join(problems) or f"No object is called something{suffixes.low}.")
    jobs = [
        Job(objects[pair.low], [objects[name] for name in pair.highs], objects[pair.cage] if pair.cage else None)
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
    tell: Callable[[Progress], None] | None = None,
) -> list[Report]:
    """All that `work` does, at once; `tell` hears how far it is."""
    return progress.finish(
        work(context, jobs, settings, Pace(TOLD_EVERY if tell else None), share_image=share_image), tell
    )


def work(
    context: bpy.types.Context,
    jobs: Sequence[Job],
    settings: Settings,
    speed: Pace,
    *,
    share_image: bool = False,
    reports: list[Report] | None = None,
) -> Task[list[Report]]:
    """Bake several jobs, each low against its own highs alone, into an image each or, shared, into one (an atlas).

    A generator: between its steps Blender may go on, and closing it leaves everything as it was, but for jobs that were
    done before. "{low}" in the settings' image and output stands for the low object's name. What can be known beforehand
    is checked for all jobs before the first is baked. Raises BakeError; jobs before the one that failed are done, unless
    they were to share its image. `reports` is added to as jobs are done, for who closes it early.
    """
    settings.check()  # before names are filled in, which may hold anything
    settings = settings.read_by(context.scene.render.engine)
    named = [for_low(settings, ATLAS if share_image else job.low.name) for job in jobs]
    each, names = (named[:1], [ATLAS]) if share_image else (named, [job.low.name for job in jobs])
    output_clashes.check(settings, each, names)
    for job, own in zip(jobs, named, strict=True):
        check(context, job, own)
    bakes, shared = [], atlas.Atlas(named[0])
    for number, (job, own) in enumerate(zip(jobs, named, strict=True)):
        report = replace(job.report(own), settings=asdict(own))
        bakes.append(_Bake(job, own, report, speed))
        share = number / len(jobs), (number + 1) / len(jobs)
        if share_image:
            drawn = yield from part(report.counted(bakes[-1].raw(context)), *share)
            shared.add(drawn, bakes[-1].meshes, report)
        else:
            for step in part(report.counted(bakes[-1].whole(context)), *share):
                yield replace(step, finished=number)
            if reports is not None:
                reports.append(report)
    if share_image:
        yield Progress("Storing", 1.0)
        shared.store([job.low for job in jobs], [bake.report for bake in bakes])
    return [bake.report for bake in bakes]


def for_low(settings: Settings, name: str) -> Settings:
    """The settings with names filled in; without one the image is called after the low object."""
    return replace(
        settings,
        image=image_writer.name_for(name, settings),
        output=file_names.fill(settings.output, name),
    )


class _Bake:
    """One job on its way."""

    def __init__(self, job: Job, settings: Settings, report: Report, speed: Pace):
        self.job, self.settings, self.report, self.pace = job, settings, report, speed
        self.tally = checks.Tally()
        self.meshes: Meshes | None = None
        self.tiles: list[int] = []

    def whole(self, context: bpy.types.Context) -> Task[None]:
        """From the objects to images and materials."""
        settings, report = self.settings, self.report
        with Outputs(settings) as outputs:
            renderer = yield from part(self._renderer(context), 0.0, 0.2)
            try:
                post_processes = post_process.for_maps([self.meshes.low], settings)
                for number, tile in enumerate(self.tiles):
                    maps = yield from part(renderer.texels(tile, post_processes), *self._share(number))
                    texels, state = maps["NORMAL"]
                    is_tangent = settings.space == "TANGENT"
                    upwards = post_process.upwards(texels[checks.SOME], settings) if is_tangent else None
                    lost = post_process.backwards(texels, state, settings) if is_tangent else 0
                    self.tally.add(state, upwards, lost)
                    with report.timed("image"):
                        outputs.add(tile, maps)
                self._tell(renderer.source.ray_cast)
            finally:
                gpu_memory.trim()
            yield Progress("Storing", 1.0)
            with report.timed("image"):
                outputs.commit([self.job.low], [report], self.meshes.materials)

    def raw(self, context: bpy.types.Context) -> Task[dict[int, dict[str, np.ndarray]]]:
        """From the objects to the values of all maps without a margin, by tile and name, as Renderer.raw has them."""
        drawn = {}
        renderer = yield from part(self._renderer(context), 0.0, 0.2)
        try:
            for number, tile in enumerate(self.tiles):
                drawn[tile] = yield from part(renderer.raw(tile), *self._share(number))
                normals = drawn[tile]["NORMAL"]
                is_tangent = self.settings.space == "TANGENT"
                upwards = 0.5 * normals[checks.SOME][..., 2] if is_tangent else None
                lost = np.count_nonzero((normals[..., 2] <= 0.0) & (normals[..., 3] > 0.0)) if is_tangent else 0
                self.tally.add(atlas.state(normals), upwards, int(lost))
            self._tell(renderer.source.ray_cast)
        finally:
            gpu_memory.trim()
        return drawn

    def _renderer(self, context: bpy.types.Context) -> Task[rendering.Renderer]:
        """Read the objects and make ready for drawing."""
        settings, report, name = self.settings, self.report, self.job.low.name
        report.backend, report.renderer = gpu.platform.backend_type_get(), gpu.platform.renderer_get()
        yield Progress(f"Reading {name}", 0.0)
        with report.timed("extract"):
            meshes = reading.read(context, self.job.low, self.job.highs, self.job.cage, settings)
        report.uv_layer = meshes.uv_layer
        report.tiles = self.tiles = _tiles(meshes.low, settings)
        yield Progress(f"Looking at {name}", 0.5)
        self.meshes = method_choice.choose(meshes, self.tiles, settings, report)
        source = yield from part(method_choice.source(self.meshes, self.tiles, settings, report, self.pace), 0.5, 1.0)
        return rendering.Renderer(source, meshes.basis, settings, report, self.pace)

    def _share(self, number: int) -> tuple[float, float]:
        """Where in the whole bake a tile begins and ends."""
        return tuple(0.2 + 0.8 * n / len(self.tiles) for n in (number, number + 1))

    def _tell(self, ray_cast: ray_casting.RayCast | None) -> None:
        if not self.tally.written:
            raise BakeError(method_choice.nothing_drawn(self.meshes, self.tiles, self.report))
        checks.tell(self.meshes, self.tally, self.tiles, self.settings, self.report, ray_cast=ray_cast)


def _tiles(low: Mesh, settings: Settings) -> list[int]:
    """The UDIM tiles to bake."""
    if not settings.udim:
        return [1001]
    found = uv_layout.tiles(low)
    if len(found) > udim.MOST_BAKED and not settings.tiles:
        raise BakeError(
            f"{low.name!r} reaches over {len(found)} UDIM tiles: name those to bake, or look for stray UVs."
        )
    wanted = [tile for tile in found if not settings.tiles or tile in settings.tiles]
    if not wanted:
        where = shorten_list(found) or "no tile"
        raise BakeError(
            f"{low.name!r} lies on {where}"
            + (f", not on {shorten_list(settings.tiles)}." if settings.tiles else ": its UVs are empty or negative.")
        )
    return wanted


def check(context: bpy.types.Context, job: Job, settings: Settings) -> None:
    """Raise BakeError for what can be known before anything is read."""
    # Scripts link, move and bake without a redraw between: view layers and matrices lag behind until asked.
    context.view_layer.update()
    reason = bake_objects.problem(context, job.low, job.highs, job.cage, settings.method)
    if reason:
        raise BakeError(reason)
    for own in output_clashes.settings_by_map(settings).values():
        image_writer.check(job.low.name, own)
    if settings.material:
        materials.check(job.low)
    try:
        gpu.init()
    except (SystemError, RuntimeError) as error:
        raise BakeError(f"There is no GPU to bake on: {error}.") from error
    limit = gpu.capabilities.max_texture_size_get()
    tallest = max(band.height for band in bands(settings.width, settings.height, settings.margin))
    if max(settings.width, tallest) > limit:
        raise BakeError(
            f"A map of {settings.width} x {settings.height} texels does not fit this GPU, whose textures have at most {limit} "
            "a side."
        )
