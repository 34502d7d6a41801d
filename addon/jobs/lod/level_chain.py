# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a chain of levels of detail: meshes as coarse as their limits allow, each with a map by Flatten."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import bpy

from ... import older_blender
from ...core.declarations.choices import Method
from ...core.errors import BakeError
from ...core.levels import ChainReport, Level, Limit
from ...core.progress import Pace, Progress, Task, part, relay
from ...core.settings import Settings
from ...engine import gpu_memory
from ...output import map_names, map_storage, output_clashes
from ...output.files.atomic_file import all_or_none
from ...scene import object_checks
from ...scene.object_refs import ObjectRef
from .. import bake_jobs, decimation
from ..job import Job, files_kept
from .level_search import LevelSearch

SEARCHED = 0.85
"""The share of the work that is done before maps are baked."""
ENDING, COLLECTION = "_LOD", "_LODs"
"""What is added to the object's name in the names of levels, before their number, and of their collection."""


def work(
    context: bpy.types.Context, obj: bpy.types.Object, limits: Sequence[Limit], settings: Settings, pace: Pace
) -> Task[ChainReport]:
    """Make a level of `obj` for each limit, in a new collection, and bake a map for each level.

    settings: of the maps; their method is Flatten. If the generator is closed early,
    or raises BakeError, nothing has changed.
    """
    start, ref = time.perf_counter(), ObjectRef.of(obj)
    settings.check()
    settings = replace(settings.read_by(context.scene.render.engine), method=Method.FLATTEN, single_user=True)
    _check(context, obj, len(limits), settings)
    with decimation.Meshes() as meshes, gpu_memory.trimmed():
        yield Progress(f"Reading {obj.name}", 0.0)
        original = decimation.read(context, obj, settings.map.uv_layer, settings.map.modifiers, meshes)
        search = LevelSearch(original, settings, pace, meshes)
        yield from part(search.measure_original(), 0.0, 0.05)
        found, left_out = yield from part(_search_all(search, limits), 0.05, SEARCHED)
        with _only_if_finished(), all_or_none():
            collection, objects = _objects(context, ref.resolve(), [level[0] for level in found])
            jobs = [Job(level, [ref.resolve()]) for level in objects]
            baking = bake_jobs.work(context, jobs, settings, pace)
            # Without the number of finished maps: none is kept if the chain is stopped.
            bakes = yield from relay(part(baking, SEARCHED, 1.0), partial(replace, finished=0))
        for data, _ in found:
            meshes.release(data)
    # A level of triangles may have more faces than an original of quads.
    swapped = [object_checks.SWAPPED.format(low=repr(each.name), highs=repr(ref.resolve().name)) for each in objects]
    bakes = [replace(bake, warnings=[each for each in bake.warnings if each not in swapped]) for bake in bakes]
    levels = [
        replace(level, name=each.name, bake=bake) for each, (_, level), bake in zip(objects, found, bakes, strict=True)
    ]
    warnings = [*left_out, *dict.fromkeys(warning for bake in bakes for warning in bake.warnings)]
    seconds = time.perf_counter() - start
    return ChainReport(ref.resolve().name, original.triangles, collection.name, levels, search.count, seconds, warnings)


def names(obj: bpy.types.Object, count: int) -> list[str]:
    """The names of the levels of `obj`, unless other objects have them."""
    return [f"{obj.name}{ENDING}{number}" for number in range(1, count + 1)]


def _check(context: bpy.types.Context, obj: bpy.types.Object, count: int, settings: Settings) -> None:
    """Raise BakeError for problems that show before the mesh is read."""
    if obj.type != "MESH":
        raise BakeError(f"{obj.name!r} is no mesh: choose a mesh, or convert it to one.")
    reason = object_checks.matrix_problem(obj)
    if reason:
        raise BakeError(reason)
    if settings.sampling.udim:
        raise BakeError("Levels of detail are measured on one tile: turn UDIM Tiles off.")
    bakes = [bake_jobs.for_low(settings, name) for name in names(obj, count)]
    output_clashes.check(settings.storing, bakes, names(obj, count), files_kept([Job(obj, [obj])], settings.storing))
    for job_settings in bakes:
        for image_settings in map_names.settings_by_map(job_settings).values():
            map_storage.check(obj.name, image_settings)
    try:
        older_blender.start_gpu()
    except (SystemError, RuntimeError) as error:
        raise BakeError(f"There is no GPU to bake on: {error}.") from error


def _search_all(
    search: LevelSearch, limits: Sequence[Limit]
) -> Task[tuple[list[tuple[bpy.types.Mesh, Level]], list[str]]]:
    """The levels for these limits, the finest first, and sentences about limits that have none. Raises BakeError."""
    found: dict[int, tuple[bpy.types.Mesh, Level]] = {}
    left_out, original = [], search.original
    for number, limit in enumerate(limits):
        data, level = yield from part(search.coarsest(limit), number / len(limits), (number + 1) / len(limits))
        if level.triangles == original.triangles:
            left_out.append(f"No coarser mesh of {original.surface.name!r} is within {limit}: it has no level.")
        elif level.triangles in found:
            other = found[level.triangles][1].limit
            left_out.append(f"The coarsest mesh within {limit} is the one within {other}: they have one level.")
        else:
            found[level.triangles] = data, level
    if not found:
        raise BakeError(" ".join(left_out))
    return [found[triangles] for triangles in sorted(found, reverse=True)], left_out


def _objects(
    context: bpy.types.Context, source: bpy.types.Object, data: Sequence[bpy.types.Mesh]
) -> tuple[bpy.types.Collection, list[bpy.types.Object]]:
    """Objects of the levels, where `source` is, in a new collection of the scene."""
    collection = bpy.data.collections.new(source.name + COLLECTION)
    context.scene.collection.children.link(collection)
    objects = []
    for name, each in zip(names(source, len(data)), data, strict=True):
        each.name = name
        level = bpy.data.objects.new(name, each)
        collection.objects.link(level)
        level.matrix_world = source.matrix_world
        decimation.finish(level)
        for slot, before in zip(level.material_slots, source.material_slots, strict=False):
            if before.link == "OBJECT":
                slot.link, slot.material = before.link, before.material
        objects.append(level)
    context.view_layer.update()
    return collection, objects


@contextmanager
def _only_if_finished() -> Iterator[None]:
    """Remove all objects, meshes, collections, materials, images and node groups that the block has made, if it fails."""
    data = bpy.data
    kinds = (data.objects, data.meshes, data.collections, data.materials, data.images, data.node_groups)
    before = [{each.session_uid for each in kind} for kind in kinds]
    is_finished = False
    try:
        yield
        is_finished = True
    finally:
        if not is_finished:
            for kind, known in zip(kinds, before, strict=True):
                for each in [each for each in kind if each.session_uid not in known]:
                    kind.remove(each)
