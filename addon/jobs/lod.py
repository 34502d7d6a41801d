# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a chain of levels of detail: meshes as coarse as their limits allow, each with a map by Flatten.

Each level is made step by step from finer ones, whose deviation from the original surface was measured with their maps, in
degrees and in distance.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..core import naming
from ..core.declarations.choices import Method, Wrap
from ..core.errors import BakeError
from ..core.levels import ChainReport, Level
from ..core.progress import Pace, Progress, Task, part
from ..core.settings import Settings
from ..core.simplify import Candidate, Limit, StepSearch
from ..engine import gpu_memory
from ..output import map_names, outputs
from ..output.atomic_file import all_or_none
from ..scene import object_checks
from ..scene.object_checks import ObjectRef
from . import bake_jobs, temporary
from .job import Job, check_clashes, check_gpu, files_kept
from .simplify import decimation, skins
from .simplify.decimation import UvDecimation, UvMesh
from .simplify.skins import Skin
from .simplify.texel_judge import Deviations, TexelJudge

SEARCHED = 0.85
"""The share of the work that is done before maps are baked."""
GAP = 0.2
"""The gap between levels that stand side by side, as a share of the width of the mesh."""


class _Levels:
    """Finds the levels of one mesh. count: how many meshes were measured."""

    def __init__(self, original: UvMesh, settings: Settings, pace: Pace):
        self.original, self.count = original, 0
        self._judge = TexelJudge(original, settings, pace)
        self._maker = UvDecimation(original, original, np.zeros(self._judge.size[::-1], bool))
        self._known: list[tuple[UvMesh, Deviations]] = []
        """The original, and the levels that were found: a search starts from the coarsest within its limit."""

    def measure_original(self) -> Task[None]:
        """Measure the original with its own map. Raises BakeError if it has no texel on the map."""
        yield from part(self._judge.prepare(), 0.0, 0.9)
        deviations = yield from part(self._judge.of_original(), 0.9, 1.0)
        self._known.append((self.original, deviations))
        self.count += 1

    def within(self, limit: Limit) -> Task[tuple[UvMesh, Level]]:
        """The level of a limit: the coarsest mesh within it, or one of so many triangles. Raises BakeError."""
        if limit.triangles:
            return (yield from self._of_size(limit))
        known = [Candidate(mesh, None, deviations, limit) for mesh, deviations in self._known]
        if known[0].excess > 1.0:
            raise BakeError(
                f"The map of {self.original.name!r} alone deviates by {self._known[0][1].degrees:.2f} degrees: allow more than "
                f"{limit}, or store more bits."
            )
        start = min((each for each in known if each.excess <= 1.0), key=lambda each: each.triangles)
        search = StepSearch(limit, partial(self._judge.quickly, limit.distance), UvMesh.remove, self._judge.exactly)
        within, beyond = yield from search.coarsest(start, self._maker)
        self.count += search.count
        self._known.append((within.mesh, within.deviation))
        other = (beyond.triangles, beyond.deviation.degrees, beyond.deviation.distance) if beyond else ()
        return within.mesh, self._level(limit, within.mesh, within.deviation, *other)

    def _of_size(self, limit: Limit) -> Task[tuple[UvMesh, Level]]:
        """The mesh with the triangles that a limit names, made from the coarsest known one that has more."""
        wanted = limit.wanted(self.original.triangles)
        finer = [mesh for mesh, _ in self._known if mesh.triangles > wanted]
        if not finer:
            return self.original, Level("", limit, self.original.triangles, 0.0, 0.0, 0.0)
        mesh, other = yield from self._maker.of(min(finer, key=lambda each: each.triangles)).make(wanted)
        other.remove()
        deviations = yield from self._judge.exactly(mesh)
        self.count += 1
        self._known.append((mesh, deviations))
        return mesh, self._level(limit, mesh, deviations)

    def _level(self, limit: Limit, mesh: UvMesh, deviations: Deviations, *beyond: float) -> Level:
        how = deviations.degrees, deviations.bare_degrees, deviations.distance
        return Level("", limit, mesh.triangles, *how, *beyond)


def work(
    context: bpy.types.Context, obj: bpy.types.Object, limits: Sequence[Limit], settings: Settings, pace: Pace
) -> Task[ChainReport]:
    """Make a level of `obj` for each limit, in a new collection, and bake a map for each level.

    settings: of the maps; their method is Flatten. If the generator is closed early,
    or raises BakeError, nothing has changed.
    """
    start, ref = time.perf_counter(), ObjectRef.of(obj)
    settings.check()
    settings = settings.read_by(context.scene.render.engine).traced(method=Method.FLATTEN).stored(single_user=True)
    _check(context, obj, len(limits), settings)
    skin = Skin.of([obj], settings.map.modifiers)
    with (
        temporary.only_if_finished(),
        all_or_none(),
        temporary.meshes(),
        gpu_memory.trimmed(),
        skin.at_rest(context),
    ):
        yield Progress(f"Reading {obj.name}", 0.0)
        original = decimation.read_original(context, obj, settings.map.uv_layer, settings.map.modifiers)
        levels = _Levels(original, settings, pace)
        yield from part(levels.measure_original(), 0.0, 0.05)
        made, left_out = yield from part(_search_all(levels, limits), 0.05, SEARCHED)
        collection, objects = _level_objects(context, ref.resolve(), [mesh.data for mesh, _ in made])
        notes = yield from part(skin.carry(context, objects), SEARCHED, SEARCHED)
        jobs = [Job(level, [ref.resolve()]) for level in objects]
        baking = bake_jobs.work(context, jobs, settings, pace)
        bakes = yield from bake_jobs.all_or_nothing(part(baking, SEARCHED, 1.0))
    reports = [
        replace(level, name=obj.name, bake=bake) for obj, (_, level), bake in zip(objects, made, bakes, strict=True)
    ]
    warnings = [*left_out, *notes, *dict.fromkeys(warning for bake in bakes for warning in bake.warnings)]
    seconds = time.perf_counter() - start
    return ChainReport(
        ref.resolve().name, original.triangles, collection.name, reports, levels.count, seconds, warnings
    )


def put_beside(context: bpy.types.Context, chain: ChainReport) -> None:
    """Move the levels of a finished chain into a row beside their original, along the X axis of the scene.

    An armature would deform them there as if they were here: levels with one stay.
    """
    reports = [level.bake for level in chain.levels]
    original, objects = reports[0].refs[1].resolve(), [report.refs[0].resolve() for report in reports]
    corners = np.array([original.matrix_world @ Vector(corner) for corner in original.bound_box])
    step = (1.0 + GAP) * float(np.ptp(corners[:, 0]))
    for number, obj in enumerate(objects, start=1):
        if any(modifier.type == "ARMATURE" for modifier in obj.modifiers):
            continue
        obj.matrix_world = Matrix.Translation((number * step, 0.0, 0.0)) @ original.matrix_world
    context.view_layer.update()


def _check(context: bpy.types.Context, obj: bpy.types.Object, count: int, settings: Settings) -> None:
    """Raise BakeError for problems that show before the mesh is read."""
    if obj.type != "MESH":
        raise BakeError(f"{obj.name!r} is no mesh: choose a mesh, or convert it to one.")
    reason = object_checks.matrix_problem(obj)
    if reason:
        raise BakeError(reason)
    if settings.sampling.udim:
        raise BakeError("Levels of detail are measured on one tile: turn UDIM Tiles off.")
    if settings.sampling.wrap != Wrap.NONE:
        raise BakeError("Maps of levels of detail do not wrap around: turn Wrap off.")
    names = naming.level_names(obj.name, count)
    bakes = [bake_jobs.for_low(settings, name) for name in names]
    check_clashes(settings.storing, bakes, names, files_kept([Job(obj, [obj])], settings.storing))
    for job_settings in bakes:
        for image_settings in map_names.settings_by_map(job_settings).values():
            outputs.check_storage(obj.name, image_settings)
    check_gpu()


def _search_all(levels: _Levels, limits: Sequence[Limit]) -> Task[tuple[list[tuple[UvMesh, Level]], list[str]]]:
    """The levels for these limits, the finest first, and sentences about limits that have none. Raises BakeError."""
    made: dict[int, tuple[UvMesh, Level]] = {}
    left_out, original = [], levels.original
    for number, limit in enumerate(limits):
        mesh, level = yield from part(levels.within(limit), number / len(limits), (number + 1) / len(limits))
        if level.triangles == original.triangles:
            left_out.append(f"No coarser mesh of {original.name!r} is within {limit}: it has no level.")
        elif level.triangles in made:
            other = made[level.triangles][1].limit
            left_out.append(f"The coarsest mesh within {limit} is the one within {other}: they have one level.")
        else:
            made[level.triangles] = mesh, level
    if not made:
        raise BakeError(" ".join(left_out))
    return [made[triangles] for triangles in sorted(made, reverse=True)], left_out


def _level_objects(
    context: bpy.types.Context, source: bpy.types.Object, data: Sequence[bpy.types.Mesh]
) -> tuple[bpy.types.Collection, list[bpy.types.Object]]:
    """Objects of the levels, where `source` is, in a new collection of the scene."""
    collection = bpy.data.collections.new(source.name + naming.LEVELS)
    context.scene.collection.children.link(collection)
    objects = []
    for name, each in zip(naming.level_names(source.name, len(data)), data, strict=True):
        each.name = name
        level = bpy.data.objects.new(name, each)
        collection.objects.link(level)
        skins.put_in_place_of(level, source)
        decimation.remove_group(level)
        for slot, before in zip(level.material_slots, source.material_slots, strict=False):
            if before.link == "OBJECT":
                slot.link, slot.material = before.link, before.material
        objects.append(level)
    context.view_layer.update()
    return collection, objects
