# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a chain of levels of detail: meshes as coarse as their limits allow, each with a map by Flatten.

Each level is made step by step from finer ones, whose deviation from the original surface was measured with their maps, in
degrees and in distance.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import bpy
import numpy as np

from .. import older_blender
from ..core import levels, udim
from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.levels import ChainReport, Level, Limit
from ..core.progress import Pace, Progress, Task, part, relay
from ..core.settings import Settings
from ..engine import gpu_memory
from ..mesh import coarser_uvs
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import map_names, outputs
from ..output.atomic_file import all_or_none
from ..passes import audit
from ..scene import evaluation, mesh_reader, object_checks
from ..scene.object_checks import ObjectRef
from . import bake_jobs, level_judge
from .job import Job, check_clashes, files_kept
from .level_judge import Deviations, QuickJudge

SEARCHED = 0.85
"""The share of the work that is done before maps are baked."""
ENDING, COLLECTION = "_LOD", "_LODs"
"""What is added to the object's name in the names of levels, before their number, and of their collection."""
TEMPORARY = "Imprint level"
"""Of temporary datablocks, which exist only within one step of a task, except for meshes."""
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
        self._found: list[tuple[Source, Deviations]] = []
        """The original, and the levels that were found: a search starts from the coarsest within its limit."""

    def measure_original(self) -> Task[None]:
        """Measure the original with its own map. Raises BakeError if it has no texel on the map."""
        self._found.append((self.original, (yield from self._measured(self.original))))

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
        judge = QuickJudge(self.original.surface, self.settings, self.pace, limit.distance)
        yield from part(judge.prepare(), 0.0, 0.02)
        steps = _Steps(self, judge, limit)
        within, beyond = yield from part(levels.search(start, steps.attempt), 0.02, 0.9)
        within, beyond = yield from part(self._confirmed(steps, start, within, beyond), 0.9, 1.0)
        steps.remove_all_but([within])
        self._found.append((within.source, within.deviations))
        found, other = within.deviations, beyond and beyond.deviations
        of_beyond = (beyond.triangles, other.degrees, other.distance) if beyond else ()
        level = Level("", limit, within.triangles, found.degrees, found.bare_degrees, found.distance, *of_beyond)
        return within.source.data, level

    def _confirmed(
        self, steps: "_Steps", start: Candidate, within: Candidate, beyond: Candidate | None
    ) -> Task[tuple[Candidate, Candidate | None]]:
        """The result of a search after exact measurements."""
        while True:
            if within is not start:
                exact = yield from self._exact(within)
                if exact.excess > 1.0:
                    steps.correct(within, exact)
                    within, beyond = yield from levels.search(steps.within(start), steps.attempt, levels.FEWER)
                    continue
                within = exact
            if beyond is None:
                return within, None
            exact = yield from self._exact(beyond)
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
            raise BakeError(
                f"No triangle of {self.original.surface.name!r} lies on the map: its UVs are outside 0 to 1, or empty."
            )
        return found


class _Steps:
    """The steps of a search: makes coarser meshes, and measures them quickly.

    A step is done again without touching the triangles whose texels came to lie beyond the limit: narrow bevels keep their
    triangles while the rest becomes coarser. Where that leaves too few triangles to remove, or before a search ends, a step is
    done with all triangles free. factor: on the excess of all meshes, as Candidate has it.
    """

    def __init__(self, search: LevelSearch, judge: QuickJudge, limit: Limit):
        self.search, self.judge, self.limit, self.factor = search, judge, limit, 1.0
        self._made: list[Candidate] = []
        """Those whose meshes exist."""
        self._passed: list[Candidate] = []
        """The results of steps that were within the limit."""
        self._frozen = np.zeros(judge.size[::-1], bool)
        self._shares = self._shares_of_steps()

    def attempt(self, base: Candidate, wanted: int, is_last: bool) -> Task[list[Candidate]]:
        """The candidates of a step, as levels.search takes it."""
        self.remove_all_but([base, *self._passed])
        start, stop = next(self._shares)

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
        print("    factor",self.factor)
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

    @staticmethod
    def _shares_of_steps() -> Iterator[tuple[float, float]]:
        """Shares of a search, whose number of steps is not known."""
        left = 1.0
        while True:
            yield 1.0 - left, 1.0 - 0.9 * left
            left *= 0.9

    def _coarser(self, base: Candidate, wanted: int, frozen: np.ndarray) -> Task[Candidate]:
        """A mesh of about `wanted` triangles: with UVs that are moved, or without if those are beyond the limit and this is
        better."""
        source, original, found = base.source, self.search.original, []
        is_frozen = frozen_vertices(source, frozen)
        for data in decimated(source, wanted, is_frozen, original.data):
            yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
            self.search.meshes.own(data)
            surface = of_mesh(data, source.layer, source.surface.name, source.surface.to_world)
            self.search.count += 1
            deviations = self.judge.measure(surface.surface, mesh_reader.smooth_normals(data, surface.surface))
            found.append(Candidate(surface, deviations, self.limit, self.factor))
            self._made.append(found[-1])
            if not 1.0 < found[-1].excess < MOST_FOR_UVS:
                break
        return min(found, key=lambda each: each.excess)


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
) -> Iterator[bpy.types.Mesh]:
    """A mesh of about this many triangles, or of more where too many vertices are kept. The caller removes it.

    is_frozen (V,) bool: vertices of `source` that are kept beside those on borders. moved_to: the mesh from which vertices
    inside islands get the UVs of the place where they lie now: collapsing edges moves vertices off the place that their UVs
    stand for. If it is given, yields the mesh with such UVs first, and then another one without.
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
        moved = result.copy()
        _move(moved, moved_to)
        yield moved
    yield result


def remove_group(level: bpy.types.Object) -> None:
    """Remove from the object of a finished mesh what making it has left."""
    group = level.vertex_groups.get(TEMPORARY)
    if group is not None:
        level.vertex_groups.remove(group)


def _move(data: bpy.types.Mesh, moved_to: bpy.types.Mesh) -> None:
    """Give the vertices of `data` the UVs of the nearest place on `moved_to`, where that is safe."""
    source = of_mesh(data, data.uv_layers[0].name, data.name, np.eye(4))
    with _scene() as scene:
        obj = _object(scene, data.copy())
        with _uvs_of(_object(scene, moved_to.copy())) as nodes:
            obj.modifiers.new(TEMPORARY, "NODES").node_group = nodes
            moved = _evaluated(scene, obj)
    surface = source.surface
    for layer in data.uv_layers:
        before, after = (mesh_reader.uvs(mesh, layer.name) for mesh in (data, moved))
        uv = coarser_uvs.moved_uvs(before, after, surface.vertices, surface.triangles, source.is_kept)
        layer.uv.foreach_set("vector", uv.reshape(-1))
    bpy.data.meshes.remove(moved)


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
