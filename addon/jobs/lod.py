# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a chain of levels of detail: meshes as coarse as their limits allow, each with a map by Flatten.

Each level is made step by step from finer ones, whose deviation from the original surface was measured with their maps, in
degrees and in distance.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import bpy
import gpu
import numpy as np

from .. import older_blender
from ..core import levels, udim
from ..core.declarations.choices import Directions, Hit, Method, Space
from ..core.errors import BakeError
from ..core.levels import ChainReport, Level, Limit
from ..core.map_types import NORMAL
from ..core.progress import Pace, Progress, Task, part, relay
from ..core.settings import Run, Settings
from ..engine import gpu_memory, margins, normal_channels, rendering, separation, sources
from ..engine.bands import Band
from ..engine.maps.maps_of_bake import maps_of_bake
from ..engine.method_choice import Plan
from ..mesh import stretch
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import map_names, map_storage, output_clashes
from ..output.files.atomic_file import all_or_none
from ..passes import lit, mesh_upload, target, viewport
from ..scene import mesh_reader, object_checks
from ..scene.object_refs import ObjectRef
from . import bake_jobs, decimation
from .decimation import Source
from .job import Job, files_kept

SIDE = 1024
"""The most texels a side of the map that is measured. It is not filtered, so that a larger one would show the same."""
PERCENTILE = 99
"""Of the texels, by which levels are judged."""
FLAT, TREES = 0.2, 0.4
"""Which shares of a measurement are done after drawing the map, and after building the trees for rays."""
MISSED = 180.0
"""The degrees of a texel whose ray meets no original surface."""


@dataclass(frozen=True)
class Deviations:
    """How a level with its map differs from the original surface, on the texels of its map.

    degrees: between the normals that the level shows with its map and those of the original surface where a ray from the level
    meets it, at the 99th percentile. bare_degrees: without the map. distance: along those rays, at the 99th percentile, as a
    share of the longest side of the original's box. by_texel (height, width) float32: the degrees on each texel, 0 on those
    that are not covered.
    """

    degrees: float
    bare_degrees: float
    distance: float
    by_texel: np.ndarray = field(repr=False, compare=False)


def settings_for(settings: Settings) -> Settings:
    """Settings for the normal map alone, by Flatten, on a single tile of at most SIDE texels a side, with one sample."""
    shrink = max(1.0, max(settings.sampling.size) / SIDE)
    return replace(
        settings.without_file().without_other_maps(),
        method=Method.FLATTEN,
        width=max(1, round(settings.sampling.width / shrink)),
        height=max(1, round(settings.sampling.height / shrink)),
        samples=1,
        margin=0,
        normal=True,
        hit=Hit.OWN,
        directions=Directions.BLENDED,
        extrusion=None,
        max_distance=None,
        facing_only=False,
    )


def measure(
    original: Mesh, level: bpy.types.Mesh, layer: str, settings: Settings, pace: Pace
) -> Task[Deviations | None]:
    """Measure a level. Returns None if it covers no texel.

    original: with UVs. level: in the original's space. settings: from settings_for.
    """
    low = mesh_reader.surface(level, layer, original.name, original.to_world, with_faces=True)
    is_tangent = settings.map.space == Space.TANGENT
    basis = mesh_reader.with_tangents(level, layer, original.name, original.to_world) if is_tangent else None
    if basis is not None:
        basis = stretch.as_read(basis, settings.map.basis)
    meshes = Meshes(low, [original], basis, mesh_reader.smooth_normals(level, low), None, layer, False, [])
    normal_map = yield from part(_flattened(meshes, settings, pace), 0.0, FLAT)
    casting = replace(settings, method=Method.CAST)
    plan = Plan(Method.CAST, (udim.FIRST,), meshes)
    source = yield from part(sources.normal_source(plan, Run(casting, pace)), FLAT, TREES)
    size = settings.sampling.width, settings.sampling.height
    for _, rows in source.normals(Band(0, size[1], size, 0)):
        yield Progress("Measuring", TREES + (1.0 - TREES) * rows.stop / size[1])
    measured = _compared(basis or low, normal_map, source.drawn().texture, settings)
    is_covered = measured[..., 3] != 0.0
    if not is_covered.any():
        return None
    measured[measured[..., 3] < 0.0, :2] = MISSED
    measured[~is_covered, :2] = 0.0
    degrees, bare = np.percentile(measured[is_covered][:, :2], PERCENTILE, axis=0)
    probe = separation.full_probe(meshes, source.ray_cast)
    vectors = separation.sample(probe, size, [udim.FIRST])
    distances = np.linalg.norm(vectors[vectors[..., 3] > 0.0][:, :3].astype(np.float64), axis=1)
    distance = float(np.percentile(distances, PERCENTILE)) if len(distances) else np.inf
    return Deviations(float(degrees), float(bare), distance / longest_side(original), measured[..., 0].copy())


def longest_side(mesh: Mesh) -> float:
    """The longest side of the box around the mesh in its own space, in scene units."""
    sides = (mesh.box[1] - mesh.box[0]) * np.linalg.norm(mesh.to_world[:3, :3], axis=0)
    return float(sides.max())


def _flattened(meshes: Meshes, settings: Settings, pace: Pace) -> Task[gpu.types.GPUTexture]:
    """The normal map of the level as it is stored, but not yet rounded."""
    run = Run(settings, pace)
    plan = Plan(Method.FLATTEN, (udim.FIRST,), meshes)
    source = yield from part(sources.normal_source(plan, run), 0.0, 0.5)
    renderer = rendering.Renderer(maps_of_bake(meshes, source, run), run)
    drawing = renderer.texels(udim.FIRST, margins.for_maps([meshes.low], settings))
    maps = yield from part(drawing, 0.5, 1.0)
    texels = maps[NORMAL.name][0]
    data = gpu.types.Buffer("FLOAT", texels.size, texels)
    return gpu.types.GPUTexture(settings.sampling.size, format="RGBA32F", data=data)


def _compared(
    basis: Mesh, normal_map: gpu.types.GPUTexture, truth: gpu.types.GPUTexture, settings: Settings
) -> np.ndarray:
    """What viewport.measure_deviation writes, (height, width, 4) float32. basis: the level, with tangents for tangent space."""
    read = (255 if settings.storing.depth == 8 else 0, *normal_channels.reading(settings.map)[1:])
    reading = lit.shading(basis.normal_matrix, read=read)
    level = mesh_upload.upload(basis.triangles, **basis.tangent_space)
    measured = target.get("deviation", settings.sampling.width, settings.sampling.height, "RGBA32F")
    nowhere = np.zeros((1, 1), bool)
    viewport.measure_deviation(measured, level, normal_map, truth, reading, elsewhere=nowhere, stretch=basis.stretch)
    values = np.empty((settings.sampling.height, settings.sampling.width, 4), np.float32)
    measured.read(values)
    return values


@dataclass(frozen=True, eq=False)
class Candidate:
    """A mesh that was measured. excess, spent: as levels.Measured has them. is_beyond (height, width) bool: the texels whose
    normals are beyond the limit."""

    source: Source
    deviations: Deviations
    limit: Limit

    @property
    def triangles(self) -> int:
        return self.source.triangles

    @property
    def excess(self) -> float:
        return self.limit.excess(self.deviations.degrees, self.deviations.distance)

    @property
    def is_beyond(self) -> np.ndarray:
        return self.deviations.by_texel > self.limit.degrees

    @property
    def spent(self) -> float:
        return float(self.is_beyond.mean())


class LevelSearch:
    """Searches levels of one mesh. Call `measure_original` first. count: how many meshes were measured."""

    def __init__(self, original: Source, settings: Settings, pace: Pace, meshes: decimation.Meshes):
        self.original, self.pace, self.meshes, self.count = original, pace, meshes, 0
        self.settings = settings_for(settings)
        self._found: list[tuple[Source, Deviations]] = []
        """The original, and the levels that were found: a search starts from the coarsest within its limit."""

    def measure_original(self) -> Task[None]:
        """Measure the original with its own map. Raises BakeError if it has no texel on the map."""
        self._found.append((self.original, (yield from self._measured(self.original))))

    def coarsest(self, limit: Limit) -> Task[tuple[bpy.types.Mesh, Level]]:
        """The coarsest mesh within a limit. Raises BakeError."""
        known = [Candidate(*found, limit) for found in self._found]
        original = known[0]
        if original.excess > 1.0:
            raise BakeError(
                f"The map of {self.original.surface.name!r} alone deviates by {original.deviations.degrees:.2f} degrees: allow "
                f"more than {limit}, or store more bits."
            )
        start = min((each for each in known if each.excess <= 1.0), key=lambda each: each.triangles)
        made: list[Candidate] = []
        within, beyond = yield from levels.search(start, self._attempts(limit, made))
        self._keep(within, made)
        self._found.append((within.source, within.deviations))
        found, other = within.deviations, beyond and beyond.deviations
        of_beyond = (beyond.triangles, other.degrees, other.distance) if beyond else ()
        level = Level("", limit, within.triangles, found.degrees, found.bare_degrees, found.distance, *of_beyond)
        return within.source.data, level

    def _attempts(self, limit: Limit, made: list[Candidate]) -> Callable[[Candidate, int, bool], Task[list[Candidate]]]:
        """Makes the candidates of a step, as levels.search takes it. made: those that exist; the others are removed.

        A step is done again without touching the triangles whose texels came to lie beyond the limit: narrow bevels keep their
        triangles while the rest becomes coarser. Where that leaves too few triangles to remove, or before a search ends, a step
        is done with all triangles free.
        """
        frozen = np.zeros((self.settings.sampling.height, self.settings.sampling.width), bool)
        shares = self._shares()

        def attempt(base: Candidate, wanted: int, is_last: bool) -> Task[list[Candidate]]:
            nonlocal frozen
            self._keep(base, made)
            start, stop = next(shares)

            def coarser(number: int, texels: np.ndarray) -> Task[Candidate]:
                ends = (start + (stop - start) * share / 3.0 for share in (number, number + 1))
                return part(self._coarser(base, wanted, texels, limit, made), *ends)

            def has_good() -> bool:
                return any(each.excess <= 1.0 and each.triangles < base.triangles for each in result)

            result = [(yield from coarser(0, frozen))]
            has_room = result[0].triangles <= wanted + levels.ODD
            more = frozen | result[0].is_beyond
            if has_room and (more & ~frozen).any():
                result.append((yield from coarser(1, more)))
            if has_good():
                frozen = more
            elif frozen.any() and (is_last or not has_room):
                result.append((yield from coarser(2, np.zeros_like(frozen))))
                frozen = np.zeros_like(frozen) if has_good() else frozen
            return result

        return attempt

    @staticmethod
    def _shares() -> Iterator[tuple[float, float]]:
        """Shares of a search, whose number of steps is not known."""
        left = 1.0
        while True:
            yield 1.0 - left, 1.0 - 0.9 * left
            left *= 0.9

    def _coarser(
        self, base: Candidate, wanted: int, frozen: np.ndarray, limit: Limit, made: list[Candidate]
    ) -> Task[Candidate]:
        """A mesh of about `wanted` triangles: with UVs that are moved, or without if those are beyond the limit and this is
        better."""
        source, found = base.source, []
        is_frozen = decimation.frozen_vertices(source, frozen)
        for moved_to in (self.original.data, None):
            yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
            data = self.meshes.own(decimation.coarser(source, wanted, is_frozen, moved_to))
            coarser = decimation.of_mesh(data, source.layer, source.surface.name, source.surface.to_world)
            found.append(Candidate(coarser, (yield from self._measured(coarser)), limit))
            made.append(found[-1])
            if found[-1].excess <= 1.0:
                break
        return min(found, key=lambda each: each.excess)

    def _keep(self, kept: Candidate, made: list[Candidate]) -> None:
        """Remove all meshes of `made` but one."""
        for each in made:
            if each is not kept:
                self.meshes.remove(each.source.data)
        made[:] = [each for each in made if each is kept]

    def _measured(self, source: Source) -> Task[Deviations]:
        self.count += 1
        found = yield from measure(self.original.surface, source.data, source.layer, self.settings, self.pace)
        if found is None:
            raise BakeError(
                f"No triangle of {self.original.surface.name!r} lies on the map: its UVs are outside 0 to 1, or empty."
            )
        return found


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
            collection, objects = _level_objects(context, ref.resolve(), [level[0] for level in found])
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


def _level_objects(
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
