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
from ..engine import baking, gpu_memory, margins, normal_space, separation, sources
from ..engine.bands import Band
from ..engine.method_choice import Plan
from ..engine.sampling import maps_of_bake
from ..mesh import coarser_uvs, triangle_mesh
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import map_names, outputs
from ..output.atomic_file import all_or_none
from ..passes import audit, data_texture, lit, mesh_upload, target, viewport
from ..scene import evaluation, mesh_reader, object_checks
from ..scene.object_checks import ObjectRef
from . import bake_jobs
from .job import Job, check_clashes, files_kept

SIDE = 1024
"""The most texels a side of the map that is measured. It is not filtered, so that a larger one would show the same."""
PERCENTILE = 99
"""Of the texels, by which levels are judged."""
FLAT, TREES = 0.2, 0.4
"""Which shares of a measurement are done after drawing the map, and after building the trees for rays."""
MISSED = 180.0
"""The degrees of a texel whose ray meets no original surface."""
SEARCHED = 0.85
"""The share of the work that is done before maps are baked."""
ENDING, COLLECTION = "_LOD", "_LODs"
"""What is added to the object's name in the names of levels, before their number, and of their collection."""
TEMPORARY = "Imprint level"
"""Of temporary datablocks, which exist only within one step of a task, except for meshes."""
LAYERS = 4
"""How many triangles on one texel are found: as many as mirrored or repeated parts usually share."""


@dataclass(frozen=True)
class Source:
    """A mesh that coarser ones are made of.

    data: the mesh. surface: as bakes read it, with UVs. is_kept (V,) bool: vertices that stay where they are, because they lie
    on a border. layer: the UV layer of the map. triangles: their number.
    """

    data: bpy.types.Mesh
    surface: Mesh
    is_kept: np.ndarray
    layer: str

    @property
    def triangles(self) -> int:
        return len(self.surface.triangles)


class TemporaryMeshes:
    """Temporary meshes. They are removed when the block ends, unless they are released."""

    def __init__(self):
        self._uids: set[int] = set()

    def __enter__(self) -> "Meshes":
        return self

    def __exit__(self, *_) -> None:
        for data in [data for data in bpy.data.meshes if data.session_uid in self._uids]:
            bpy.data.meshes.remove(data)

    def own(self, data: bpy.types.Mesh) -> bpy.types.Mesh:
        """Remove `data` at the end. Returns it."""
        self._uids.add(data.session_uid)
        return data

    def release(self, data: bpy.types.Mesh) -> None:
        """Keep `data`."""
        self._uids.discard(data.session_uid)

    def remove(self, data: bpy.types.Mesh) -> None:
        """Remove `data` now."""
        self._uids.discard(data.session_uid)
        bpy.data.meshes.remove(data)


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

    def __init__(self, original: Source, settings: Settings, pace: Pace, meshes: TemporaryMeshes):
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

    def of_size(self, limit: Limit) -> Task[tuple[bpy.types.Mesh, Level]]:
        """The mesh with the triangles that a limit names, made from the coarsest known one that has more. Raises BakeError."""
        known = [Candidate(*found, limit) for found in self._found]
        wanted, made = limit.wanted(self.original.triangles), []
        finer = [each for each in known if each.triangles > wanted]
        if not finer:
            return self.original.data, Level("", limit, self.original.triangles, 0.0, 0.0, 0.0)
        base = min(finer, key=lambda each: each.triangles)
        level = yield from self._coarser(base, wanted, np.zeros_like(base.is_beyond), limit, made)
        self._keep(level, made)
        self._found.append((level.source, level.deviations))
        found = level.deviations
        return level.source.data, Level("", limit, level.triangles, found.degrees, found.bare_degrees, found.distance)

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
        is_frozen = frozen_vertices(source, frozen)
        for moved_to in (self.original.data, None):
            yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
            data = self.meshes.own(decimated(source, wanted, is_frozen, moved_to))
            coarser = of_mesh(data, source.layer, source.surface.name, source.surface.to_world)
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
    with TemporaryMeshes() as meshes, gpu_memory.trimmed():
        yield Progress(f"Reading {obj.name}", 0.0)
        original = read_original(context, obj, settings.map.uv_layer, settings.map.modifiers, meshes)
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
    check_clashes(settings.storing, bakes, names(obj, count), files_kept([Job(obj, [obj])], settings.storing))
    for job_settings in bakes:
        for image_settings in map_names.settings_by_map(job_settings).values():
            outputs.check_storage(obj.name, image_settings)
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
        making = search.of_size(limit) if limit.triangles else search.coarsest(limit)
        data, level = yield from part(making, number / len(limits), (number + 1) / len(limits))
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
        remove_group(level)
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
        basis = triangle_mesh.with_stretch(basis, settings.map.basis)
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
    renderer = baking.Renderer(maps_of_bake(meshes, source, run), run)
    drawing = renderer.texels(udim.FIRST, margins.for_maps([meshes.low], settings))
    maps = yield from part(drawing, 0.5, 1.0)
    return data_texture.image(maps[NORMAL.name][0])


def _compared(
    basis: Mesh, normal_map: gpu.types.GPUTexture, truth: gpu.types.GPUTexture, settings: Settings
) -> np.ndarray:
    """What viewport.measure_deviation writes, (height, width, 4) float32. basis: the level, with tangents for tangent space."""
    read = (255 if settings.storing.depth == 8 else 0, *normal_space.reading(settings.map)[1:])
    reading = lit.shading(basis.normal_matrix, read=read)
    level = mesh_upload.upload(basis.triangles, **basis.tangent_space)
    measured = target.get("deviation", settings.sampling.width, settings.sampling.height, "RGBA32F")
    nowhere = np.zeros((1, 1), bool)
    viewport.measure_deviation(measured, level, normal_map, truth, reading, elsewhere=nowhere, stretch=basis.stretch)
    values = np.empty((settings.sampling.height, settings.sampling.width, 4), np.float32)
    measured.read(values)
    return values


def read_original(
    context: bpy.types.Context, obj: bpy.types.Object, uv_layer: str, modifiers: str, meshes: TemporaryMeshes
) -> Source:
    """Read an object with its modifiers. uv_layer: its name; empty for the active one. meshes: owns the copy.

    Raises BakeError.
    """
    with evaluation.prepared(context, obj, [], None, modifiers) as depsgraph:
        data = meshes.own(
            bpy.data.meshes.new_from_object(
                obj.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
            )
        )
    data.name = TEMPORARY
    if not data.polygons:
        raise BakeError(f"{obj.name!r} has no faces: choose a mesh that has some.")
    if not data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer: unwrap it first.")
    if uv_layer and uv_layer not in data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer {uv_layer!r}: choose one of its layers.")
    layer = uv_layer or data.uv_layers.active.name
    _drop_custom_normals(data)
    source = of_mesh(data, layer, obj.name, mesh_reader.matrix(obj))
    if source.surface.not_finite:
        raise BakeError(
            f"{obj.name!r} has {source.surface.not_finite:,} triangles with NaN or infinite coordinates: remove them."
        )
    return source


def of_mesh(data: bpy.types.Mesh, layer: str, name: str, to_world: np.ndarray) -> Source:
    """A mesh, to make coarser ones of. name: of its object. to_world (4, 4): the object's matrix."""
    surface = mesh_reader.surface(data, layer, name, to_world, with_faces=True)
    slots = np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("material_index", slots)
    layers = [mesh_reader.uvs(data, each.name) for each in data.uv_layers]
    is_kept = np.ones(len(data.vertices), bool)  # vertices without a face, too
    on_border = coarser_uvs.kept_vertices(surface.vertices, surface.triangles, layers, slots[surface.faces])
    is_kept[: len(on_border)] = on_border
    return Source(data, surface, is_kept, layer)


def _drop_custom_normals(data: bpy.types.Mesh) -> None:
    """Levels get the normals that Blender computes: custom ones belong to corners that collapse."""
    if "custom_normal" in data.attributes:
        data.attributes.remove(data.attributes["custom_normal"])


def decimated(
    source: Source, triangles: int, is_frozen: np.ndarray, moved_to: bpy.types.Mesh | None = None
) -> bpy.types.Mesh:
    """A mesh of about this many triangles, or of more where too many vertices are kept. The caller removes it.

    is_frozen (V,) bool: vertices of `source` that are kept beside those on borders. moved_to: the mesh from which vertices
    inside islands get the UVs of the place where they lie now; None leaves them. Collapsing edges moves vertices off the place
    that their UVs stand for.
    """
    with _scene() as scene:
        obj = _object(scene, source.data.copy())
        remove_group(obj)  # of what making `source` has left
        group = obj.vertex_groups.new(name=TEMPORARY)
        free = np.flatnonzero(~(source.is_kept | is_frozen))
        group.add(free.tolist(), 1.0, "REPLACE")
        decimate = obj.modifiers.new(TEMPORARY, "DECIMATE")
        # The modifier takes a group without vertices for no group.
        decimate.ratio = min(1.0, triangles / source.triangles) if len(free) else 1.0
        decimate.use_collapse_triangulate = True
        decimate.vertex_group = group.name  # weight 0 locks a vertex
        result = _evaluated(scene, obj)
        if moved_to is not None:
            with _uvs_of(_object(scene, moved_to.copy()), group.name) as nodes:
                obj.modifiers.new(TEMPORARY, "NODES").node_group = nodes
                moved = _evaluated(scene, obj)
                _move(result, moved)
                bpy.data.meshes.remove(moved)
        return result


def remove_group(level: bpy.types.Object) -> None:
    """Remove from the object of a finished mesh what making it has left."""
    group = level.vertex_groups.get(TEMPORARY)
    if group is not None:
        level.vertex_groups.remove(group)


def _move(data: bpy.types.Mesh, moved: bpy.types.Mesh) -> None:
    """Give `data` the UVs of `moved`, which has the same topology, where that is safe."""
    source = of_mesh(data, data.uv_layers[0].name, data.name, np.eye(4))
    surface = source.surface
    for layer in data.uv_layers:
        before, after = (mesh_reader.uvs(mesh, layer.name) for mesh in (data, moved))
        uv = coarser_uvs.moved_uvs(before, after, surface.vertices, surface.triangles, source.is_kept)
        layer.uv.foreach_set("vector", uv.reshape(-1))


@contextmanager
def _uvs_of(target: bpy.types.Object, group: str) -> Iterator[bpy.types.NodeTree]:
    """Geometry nodes that give each corner in a vertex group the UVs of the nearest point of `target`, in all its layers.

    Blender's Data Transfer modifier does the same, but loses memory each time it transfers UVs.
    """
    nodes = bpy.data.node_groups.new(TEMPORARY, "GeometryNodeTree")
    try:
        for way in ("INPUT", "OUTPUT"):
            nodes.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        kinds = "NodeGroupInput", "NodeGroupOutput", "GeometryNodeObjectInfo", "GeometryNodeInputNamedAttribute"
        start, end, info, chosen = map(nodes.nodes.new, kinds)
        info.inputs["Object"].default_value, chosen.inputs["Name"].default_value = target, group
        geometry = start.outputs[0]
        for layer in target.data.uv_layers:
            uv, sample, store = (
                nodes.nodes.new(f"GeometryNode{kind}")
                for kind in ("InputNamedAttribute", "SampleNearestSurface", "StoreNamedAttribute")
            )
            uv.data_type = sample.data_type = "FLOAT_VECTOR"
            store.data_type, store.domain = "FLOAT2", "CORNER"
            uv.inputs["Name"].default_value = store.inputs["Name"].default_value = layer.name
            nodes.links.new(info.outputs["Geometry"], sample.inputs["Mesh"])
            nodes.links.new(uv.outputs["Attribute"], sample.inputs["Value"])
            nodes.links.new(geometry, store.inputs["Geometry"])
            nodes.links.new(chosen.outputs["Attribute"], store.inputs["Selection"])
            nodes.links.new(sample.outputs["Value"], store.inputs["Value"])
            geometry = store.outputs["Geometry"]
        nodes.links.new(geometry, end.inputs[0])
        yield nodes
    finally:
        bpy.data.node_groups.remove(nodes)


@contextmanager
def _scene() -> Iterator[bpy.types.Scene]:
    """An empty scene. At the end it is removed, with its objects and their meshes."""
    scene = bpy.data.scenes.new(TEMPORARY)
    try:
        yield scene
    finally:
        for obj in list(scene.collection.objects):
            bpy.data.meshes.remove(obj.data)  # and the object with it
        bpy.data.scenes.remove(scene)


def _object(scene: bpy.types.Scene, data: bpy.types.Mesh) -> bpy.types.Object:
    obj = bpy.data.objects.new(TEMPORARY, data)
    scene.collection.objects.link(obj)
    return obj


def _evaluated(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Mesh:
    """The mesh of `obj` with its modifiers and without its vertex groups."""
    layer = scene.view_layers[0]
    layer.update()
    return bpy.data.meshes.new_from_object(obj.evaluated_get(layer.depsgraph), depsgraph=layer.depsgraph)


def frozen_vertices(source: Source, texels: np.ndarray) -> np.ndarray:
    """Which vertices (V,) bool belong to a triangle on one of these `texels` (height, width) bool."""
    surface, result = source.surface, np.zeros(len(source.is_kept), bool)
    if texels.any():
        uploaded = audit.upload_with_ids(surface.triangles, surface.uv)
        for numbers in audit.layers_of_triangles(uploaded, texels.shape[::-1], udim.uv_to_clip(), LAYERS):
            found = np.unique(numbers[texels]).astype(np.int64)
            result[surface.vertices[surface.triangles[found[found > 0] - 1]]] = True
    return result
