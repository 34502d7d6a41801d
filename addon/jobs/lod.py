# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a chain of levels of detail: meshes as coarse as their limits allow, each with a map by Flatten.

Each level is made step by step from finer ones, whose deviation from the original surface was measured with their maps, in
degrees and in distance.
"""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .. import older_blender
from ..core import levels, udim
from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.levels import ChainReport, Level, Limit
from ..core.progress import Pace, Progress, Task, part
from ..core.settings import Settings
from ..engine import gpu_memory
from ..mesh import coarser_uvs
from ..mesh.triangle_mesh import Mesh
from ..output import map_names, outputs
from ..output.atomic_file import all_or_none
from ..passes import audit
from ..scene import evaluation, mesh_reader, object_checks, reading
from ..scene.object_checks import ObjectRef
from . import bake_jobs, level_judge, temporary
from .job import Job, check_clashes, files_kept
from .level_judge import Deviations, QuickJudge
from .temporary import TEMPORARY, TemporaryMeshes

SEARCHED = 0.85
"""The share of the work that is done before maps are baked."""
ENDING, COLLECTION = "_LOD", "_LODs"
"""What is added to the object's name in the names of levels, before their number, and of their collection."""
GAP = 0.2
"""The gap between levels that stand side by side, as a share of the width of the mesh."""
MOST_FOR_KEEPING, MOST_FOR_UVS = 1.6, 1.25
"""The shares of a limit that a mesh takes beyond which more vertices that are kept, and other UVs, hardly bring it within."""
LAYERS = 4
"""How many triangles on one texel are found: as many as mirrored or repeated parts usually share."""


@dataclass(frozen=True, eq=False)
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


@dataclass(frozen=True, eq=False)
class Candidate:
    """A mesh that was measured. excess, spent: as levels.Measured has them. is_beyond (height, width) bool: the texels whose
    normals are beyond the limit. factor: on the excess, of exact measurements to quick ones."""

    source: Source
    deviations: Deviations
    limit: Limit
    factor: float = 1.0

    @property
    def triangles(self) -> int:
        return self.source.triangles

    @property
    def excess(self) -> float:
        return self.factor * self.limit.excess(self.deviations.degrees, self.deviations.distance)

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
        self.settings = level_judge.settings_for(settings)
        self.judge = QuickJudge(original.surface, self.settings, pace)
        self._found: list[tuple[Source, Deviations]] = []
        """The original, and the levels that were found: a search starts from the coarsest within its limit."""

    def measure_original(self) -> Task[None]:
        """Measure the original with its own map. Raises BakeError if it has no texel on the map."""
        yield from self.judge.prepare()
        found = self.quickly_measured(self.original, 0.0)
        if not math.isfinite(found.degrees):
            raise self._nowhere()
        self._found.append((self.original, found))

    def quickly_measured(self, source: Source, farthest: float) -> Deviations:
        """As QuickJudge.measure."""
        self.count += 1
        return self.judge.measure(source.surface, mesh_reader.smooth_normals(source.data, source.surface), farthest)

    def coarsest(self, limit: Limit) -> Task[tuple[bpy.types.Mesh, Level]]:
        """The coarsest mesh within a limit. Raises BakeError.

        The search measures quickly. Its result, and the mesh beyond the limit, are measured exactly; where both measurements
        disagree, it goes on with what the exact one says.
        """
        known = [Candidate(*found, limit) for found in self._found]
        original = known[0]
        if original.excess > 1.0:
            raise BakeError(
                f"The map of {self.original.surface.name!r} alone deviates by {original.deviations.degrees:.2f} degrees: allow "
                f"more than {limit}, or store more bits."
            )
        start = min((each for each in known if each.excess <= 1.0), key=lambda each: each.triangles)
        steps = _Steps(self, limit)
        within, beyond = yield from part(levels.search(start, steps.attempt), 0.0, 0.9)
        within, beyond = yield from part(self._confirmed(steps, start, within, beyond), 0.9, 1.0)
        steps.remove_all_but([within])
        self._found.append((within.source, within.deviations))
        found, other = within.deviations, beyond and beyond.deviations
        of_beyond = (beyond.triangles, other.degrees, other.distance) if beyond else ()
        level = Level("", limit, within.triangles, found.degrees, found.bare_degrees, found.distance, *of_beyond)
        return within.source.data, level

    def of_size(self, limit: Limit) -> Task[tuple[bpy.types.Mesh, Level]]:
        """The mesh with the triangles that a limit names, made from the coarsest known one that has more. Raises BakeError."""
        wanted = limit.wanted(self.original.triangles)
        finer = [source for source, _ in self._found if source.triangles > wanted]
        if not finer:
            return self.original.data, Level("", limit, self.original.triangles, 0.0, 0.0, 0.0)
        base = min(finer, key=lambda each: each.triangles)
        yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
        plain = self.meshes.own(decimated(base, wanted, np.zeros(len(base.is_kept), bool)))
        data = self.meshes.own(with_moved_uvs(plain, self.original.data))
        self.meshes.remove(plain)
        level = of_mesh(data, base.layer, base.surface.name, base.surface.to_world)
        found = yield from self._measured(level)
        self._found.append((level, found))
        return data, Level("", limit, level.triangles, found.degrees, found.bare_degrees, found.distance)

    def _confirmed(
        self, steps: "_Steps", start: Candidate, within: Candidate, beyond: Candidate | None
    ) -> Task[tuple[Candidate, Candidate | None]]:
        """The result of a search after exact measurements."""
        steps.shares = shares_of_steps()
        while True:
            if within is not start:
                exact = yield from part(self._exact(within), *next(steps.shares))
                if exact.excess > 1.0:
                    steps.correct(within, exact)
                    finer = steps.within(start)
                    share = min(max(math.sqrt(exact.triangles / finer.triangles), levels.STRIDE), levels.FEWER)
                    within, beyond = yield from levels.search(finer, steps.attempt, share)
                    continue
                within = exact
            if beyond is None:
                return within, None
            exact = yield from part(self._exact(beyond), *next(steps.shares))
            if exact.excess > 1.0:
                return within, exact
            steps.correct(beyond, exact)
            start = exact
            within, beyond = yield from levels.search(exact, steps.attempt, levels.FEWER)

    def _exact(self, candidate: Candidate) -> Task[Candidate]:
        return replace(candidate, deviations=(yield from self._measured(candidate.source)), factor=1.0)

    def _measured(self, source: Source) -> Task[Deviations]:
        self.count += 1
        found = yield from level_judge.measure(
            self.original.surface, source.data, source.layer, self.settings, self.pace
        )
        if found is None:
            raise self._nowhere()
        return found

    def _nowhere(self) -> BakeError:
        return BakeError(
            f"No triangle of {self.original.surface.name!r} lies on the map: its UVs are outside 0 to 1, or empty."
        )


class _Steps:
    """The steps of a search: makes coarser meshes, and measures them quickly.

    A step is done again without touching the triangles whose texels came to lie beyond the limit: narrow bevels keep their
    triangles while the rest becomes coarser. Where that leaves too few triangles to remove, or before a search ends, a step is
    done with all triangles free. factor: on the excess of all meshes, as Candidate has it.
    """

    def __init__(self, search: LevelSearch, limit: Limit):
        self.search, self.limit, self.factor = search, limit, 1.0
        self._made: list[Candidate] = []
        """Those whose meshes exist."""
        self._passed: list[Candidate] = []
        """The results of steps that were within the limit."""
        self._frozen = np.zeros(search.judge.size[::-1], bool)
        self.shares = shares_of_steps()
        """Where the progress of each step begins and ends."""

    def attempt(self, base: Candidate, wanted: int, is_last: bool) -> Task[list[Candidate]]:
        """The candidates of a step, as levels.search takes it."""
        self.remove_all_but([base, *self._passed])
        start, stop = next(self.shares)

        def coarser(number: int, texels: np.ndarray) -> Task[Candidate]:
            ends = (start + (stop - start) * share / 3.0 for share in (number, number + 1))
            return part(self._coarser(base, wanted, texels), *ends)

        def has_good() -> bool:
            return any(each.excess <= 1.0 and each.triangles < base.triangles for each in result)

        frozen = self._frozen
        result = [(yield from coarser(0, frozen))]
        has_room = result[0].triangles <= wanted + levels.ODD
        more = frozen | result[0].is_beyond
        if has_room and result[0].excess < MOST_FOR_KEEPING and (more & ~frozen).any():
            result.append((yield from coarser(1, more)))
        if has_good():
            self._frozen = more
        elif frozen.any() and (is_last or not has_room):
            result.append((yield from coarser(2, np.zeros_like(frozen))))
            self._frozen = np.zeros_like(frozen) if has_good() else frozen
        self._passed += [each for each in result if each.excess <= 1.0]
        return result

    def correct(self, quick: Candidate, exact: Candidate) -> None:
        """Judge by how much an exact measurement differs from the quick one of the same mesh, and keep what it found."""
        self.factor *= exact.excess / quick.excess
        places = np.argwhere(exact.is_beyond) * self._frozen.shape // exact.is_beyond.shape
        self._frozen = self._frozen.copy()
        self._frozen[tuple(places.T)] = True
        if exact.excess <= 1.0:
            self._passed.append(exact)

    def within(self, start: Candidate) -> Candidate:
        """The coarsest mesh of all steps that is within the limit with the present factor; `start` if none is."""
        now = [replace(each, factor=self.factor) for each in self._passed if each.triangles < start.triangles]
        return min((each for each in now if each.excess <= 1.0), key=lambda each: each.triangles, default=start)

    def remove_all_but(self, kept: Sequence[Candidate]) -> None:
        """Remove all meshes that were made but these."""
        sources = [each.source for each in kept]
        for each in [each for each in self._made if each.source not in sources]:
            self.search.meshes.remove(each.source.data)
            self._made.remove(each)

    def _coarser(self, base: Candidate, wanted: int, frozen: np.ndarray) -> Task[Candidate]:
        """A mesh of about `wanted` triangles: with UVs that are moved, or without if those are beyond the limit and this is
        better."""
        source, meshes, found = base.source, self.search.meshes, []
        is_frozen = frozen_vertices(source, frozen)
        yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
        plain = meshes.own(decimated(source, wanted, is_frozen))
        moved = meshes.own(with_moved_uvs(plain, self.search.original.data))
        for data in (moved, plain):
            yield Progress(f"Decimating to {wanted:,} triangles", 0.5)
            coarser = of_mesh(data, source.layer, source.surface.name, source.surface.to_world)
            deviations = self.search.quickly_measured(coarser, self.limit.distance)
            found.append(Candidate(coarser, deviations, self.limit, self.factor))
            self._made.append(found[-1])
            if not 1.0 < found[0].excess < MOST_FOR_UVS:
                meshes.remove(plain)
                break
        return min(found, key=lambda each: each.excess)


SHARE_LEFT = 0.8
"""The share of what is left that the steps after one take: the more steps, the less each of them."""


def shares_of_steps() -> Iterator[tuple[float, float]]:
    """Where the progress of one step after another begins and ends, of steps whose number is not known."""
    left = 1.0
    while True:
        yield 1.0 - left, 1.0 - SHARE_LEFT * left
        left *= SHARE_LEFT


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
    with TemporaryMeshes() as meshes, gpu_memory.trimmed():
        yield Progress(f"Reading {obj.name}", 0.0)
        original = read_original(context, obj, settings.map.uv_layer, settings.map.modifiers, meshes)
        search = LevelSearch(original, settings, pace, meshes)
        yield from part(search.measure_original(), 0.0, 0.05)
        found, left_out = yield from part(_search_all(search, limits), 0.05, SEARCHED)
        with temporary.only_if_finished(), all_or_none():
            collection, objects = _level_objects(context, ref.resolve(), [level[0] for level in found])
            jobs = [Job(level, [ref.resolve()]) for level in objects]
            baking = bake_jobs.work(context, jobs, settings, pace)
            bakes = yield from bake_jobs.all_or_nothing(part(baking, SEARCHED, 1.0))
        for data, _ in found:
            meshes.release(data)
    levels = [
        replace(level, name=each.name, bake=bake) for each, (_, level), bake in zip(objects, found, bakes, strict=True)
    ]
    warnings = [*left_out, *dict.fromkeys(warning for bake in bakes for warning in bake.warnings)]
    seconds = time.perf_counter() - start
    return ChainReport(ref.resolve().name, original.triangles, collection.name, levels, search.count, seconds, warnings)


def put_beside(context: bpy.types.Context, chain: ChainReport) -> None:
    """Move the levels of a finished chain into a row beside their original, along the X axis of the scene."""
    reports = [level.bake for level in chain.levels]
    original, objects = reports[0].refs[1].resolve(), [report.refs[0].resolve() for report in reports]
    corners = np.array([original.matrix_world @ Vector(corner) for corner in original.bound_box])
    step = (1.0 + GAP) * float(np.ptp(corners[:, 0]))
    for number, obj in enumerate(objects, start=1):
        obj.matrix_world = Matrix.Translation((number * step, 0.0, 0.0)) @ original.matrix_world
    context.view_layer.update()


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


def read_original(
    context: bpy.types.Context, obj: bpy.types.Object, uv_layer: str, modifiers: str, meshes: TemporaryMeshes
) -> Source:
    """Read an object with its modifiers. uv_layer: its name; empty for the active one. meshes: owns the copy.

    Raises BakeError.
    """

    def copied(depsgraph: bpy.types.Depsgraph) -> tuple[bpy.types.Mesh, np.ndarray]:
        shown = obj.evaluated_get(depsgraph)
        copy = bpy.data.meshes.new_from_object(shown, preserve_all_data_layers=True, depsgraph=depsgraph)
        return meshes.own(copy), mesh_reader.matrix(shown)

    data, to_world = evaluation.evaluate(context, [obj], copied, modifiers=modifiers)
    data.name = TEMPORARY
    if not data.polygons:
        raise BakeError(f"{obj.name!r} has no faces: choose a mesh that has some.")
    if not data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer: unwrap it first.")
    if uv_layer and uv_layer not in data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer {uv_layer!r}: choose one of its layers.")
    layer = uv_layer or mesh_reader.active_uv_layer(data)
    _drop_custom_normals(data)
    source = of_mesh(data, layer, obj.name, to_world)
    if source.surface.not_finite:
        raise BakeError(
            f"{obj.name!r} has {source.surface.not_finite:,} triangles with NaN or infinite coordinates: remove them."
        )
    reading.check_surface([source.surface])
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


def decimated(source: Source, triangles: int, is_frozen: np.ndarray) -> bpy.types.Mesh:
    """A mesh of about this many triangles, or of more where too many vertices are kept. The caller removes it.

    is_frozen (V,) bool: vertices of `source` that are kept beside those on borders.
    """
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, source.data.copy())
        remove_group(obj)  # of what making `source` has left
        group = obj.vertex_groups.new(name=TEMPORARY)
        free = np.flatnonzero(~(source.is_kept | is_frozen))
        group.add(free.tolist(), 1.0, "REPLACE")
        decimate = obj.modifiers.new(TEMPORARY, "DECIMATE")
        # The modifier takes a group without vertices for no group.
        decimate.ratio = min(1.0, triangles / source.triangles) if len(free) else 1.0
        decimate.use_collapse_triangulate = True
        decimate.vertex_group = group.name  # weight 0 locks a vertex
        return temporary.evaluated(scene, obj)


def with_moved_uvs(data: bpy.types.Mesh, original: bpy.types.Mesh) -> bpy.types.Mesh:
    """A copy of a coarser mesh whose vertices have the UVs of the nearest place on the original, where that is safe. The caller
    removes it.

    Collapsing edges moves vertices off the place that their UVs stand for.
    """
    result = data.copy()
    source = of_mesh(result, result.uv_layers[0].name, result.name, np.eye(4))
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, result.copy())
        with _uvs_of(temporary.add_object(scene, original.copy())) as nodes:
            obj.modifiers.new(TEMPORARY, "NODES").node_group = nodes
            nearest = temporary.evaluated(scene, obj)
    surface = source.surface
    for layer in result.uv_layers:
        before, after = (mesh_reader.uvs(mesh, layer.name) for mesh in (result, nearest))
        uv = coarser_uvs.moved_uvs(before, after, surface.vertices, surface.triangles, source.is_kept)
        layer.uv.foreach_set("vector", uv.reshape(-1))
    bpy.data.meshes.remove(nearest)
    return result


def remove_group(level: bpy.types.Object) -> None:
    """Remove from the object of a finished mesh what making it has left."""
    group = level.vertex_groups.get(TEMPORARY)
    if group is not None:
        level.vertex_groups.remove(group)


@contextmanager
def _uvs_of(target: bpy.types.Object) -> Iterator[bpy.types.NodeTree]:
    """Geometry nodes that give each corner the UVs of the nearest point of `target`, in all its layers.

    Blender's Data Transfer modifier does the same, but loses memory each time it transfers UVs.
    """
    nodes = bpy.data.node_groups.new(TEMPORARY, "GeometryNodeTree")
    try:
        for way in ("INPUT", "OUTPUT"):
            nodes.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        start, end, info = map(nodes.nodes.new, ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeObjectInfo"))
        info.inputs["Object"].default_value = target
        geometry = start.outputs[0]
        for layer in target.data.uv_layers:
            uv, sample, at_points, store = (
                nodes.nodes.new(f"GeometryNode{kind}")
                for kind in ("InputNamedAttribute", "SampleNearestSurface", "FieldOnDomain", "StoreNamedAttribute")
            )
            uv.data_type = sample.data_type = at_points.data_type = "FLOAT_VECTOR"
            at_points.domain = "POINT"  # once for all corners at a vertex
            store.data_type, store.domain = "FLOAT2", "CORNER"
            uv.inputs["Name"].default_value = store.inputs["Name"].default_value = layer.name
            nodes.links.new(info.outputs["Geometry"], sample.inputs["Mesh"])
            nodes.links.new(uv.outputs["Attribute"], sample.inputs["Value"])
            nodes.links.new(geometry, store.inputs["Geometry"])
            nodes.links.new(sample.outputs["Value"], at_points.inputs[0])
            nodes.links.new(at_points.outputs[0], store.inputs["Value"])
            geometry = store.outputs["Geometry"]
        nodes.links.new(geometry, end.inputs[0])
        yield nodes
    finally:
        bpy.data.node_groups.remove(nodes)


def frozen_vertices(source: Source, texels: np.ndarray) -> np.ndarray:
    """Which vertices (V,) bool belong to a triangle on one of these `texels` (height, width) bool."""
    surface, result = source.surface, np.zeros(len(source.is_kept), bool)
    if texels.any():
        uploaded = audit.upload_with_ids(surface.triangles, surface.uv)
        for numbers in audit.layers_of_triangles(uploaded, texels.shape[::-1], udim.uv_to_clip(), LAYERS):
            found = np.unique(numbers[texels]).astype(np.int64)
            result[surface.vertices[surface.triangles[found[found > 0] - 1]]] = True
    return result
