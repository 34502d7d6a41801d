# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a low object before a bake and what fixes it, and where the checks of a finished bake found something: on
which texels of the map, and on which faces of the low mesh."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property, partial

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..audit import before_bake, mip_gaps, severity
from ..audit.before_bake import FLIPPED, HARD_EDGES, LAYER, MIRRORED, POLYGONS, Faces, Finding
from ..audit.checks import uv_space
from ..audit.severity import Warned
from ..core import progress
from ..core.declarations.choices import ExactMaterials, Method, Modifiers, Space
from ..core.errors import BakeError, shorten_list
from ..core.map_types import BY_NAME, NORMAL
from ..core.material_feeds import ExactFeed, HighMaterial
from ..core.progress import Progress, Task, Timings
from ..core.report import Report, evaluated
from ..core.settings import MapSettings, Run, SamplingSettings, Settings
from ..engine import baking, gpu_memory, high_look, own_hits, separation
from ..engine.bands import Band
from ..engine.high_look import HighLook
from ..engine.planning import Plan, plan_of
from ..engine.unsure_texels import Explorer
from ..mesh import edges, face_shapes, topology, uv_islands, uv_layout, uv_seams
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import diagonal, transformed, unit, unit_normals
from ..output import outputs
from ..passes import audit, mesh_upload, target
from ..scene import evaluation, mesh_elements, mesh_reader, poses, traced_sides
from ..scene.high_materials import MaterialNumbers
from ..scene.textures import ImageTextures
from ..scene.traced_sides import Surface
from . import material_inputs, unwrapping
from .job import Job, PastBake, Request, check_job, read_meshes

__all__ = ["FLIPPED", "HARD_EDGES", "LAYER", "MIRRORED", "POLYGONS", "Finding"]
UNWRAP = "UNWRAP"
"""What `fix` does for an object without UVs."""
SOLVED_BY_EXPORT = (POLYGONS, LAYER)
"""The kinds that do not matter for files that Imprint exports."""
MOST_CORNERS = 400_000
"""The largest low mesh, in corners of faces, that `viewport_findings` looks at: it takes a few tenths of a second."""


def look_at_high(context: bpy.types.Context, job: Job, settings: Settings) -> HighLook:
    """What the high objects of a job are, and what its bake will change of them. Raises BakeError as the bake does."""
    settings = settings.without_file()
    check_job(context, job, settings.without_other_maps())
    with gpu_memory.trimmed():
        meshes = read_meshes(context, Request(job, settings))
        found = high_look.look(meshes, settings.without_other_maps())
    inputs = [*evaluated(material_inputs.ways(meshes, settings.map)), *material_inputs.notes(meshes, settings.map)]
    inputs = [*pose_notes(context, job, settings), *inputs]
    return replace(found, notes=(*found.notes, *inputs))


def is_for_others(settings: Settings, *, is_exported: bool) -> bool:
    """Whether a program other than Blender reads the normal map. settings: as in before_bake.is_for_others.

    is_exported: whether Imprint writes the low mesh for an engine. Then it has the triangles and tangents of the bake.
    """
    return before_bake.is_for_others(settings) or (is_exported and before_bake.is_in_tangent_space(settings.map))


def pose_notes(context: bpy.types.Context, job: Job, settings: Settings) -> list[str]:
    """What only one of the objects of a job is moved by, in sentences; none if the bake leaves it out."""
    if settings.map.rest_pose:
        return []
    return poses.notes(context, job.low, job.highs, for_render=settings.map.modifiers == Modifiers.RENDER)


def unsolved_by_export(findings: Sequence[Finding], *, is_exported: bool) -> list[Finding]:
    """The findings that the export does not solve. is_exported: as in `is_for_others`."""
    return [finding for finding in findings if not (is_exported and finding.kind in SOLVED_BY_EXPORT)]


def active_layer(low: bpy.types.Object) -> str:
    """The name of the active UV map of an object's own mesh; empty if it has none."""
    return mesh_reader.active_uv_layer(low.data) if low.data.uv_layers else ""


def mesh_findings(low: Mesh, obj: bpy.types.Object, uv_layer: str, sampling: SamplingSettings) -> list[Finding]:
    """The findings for a low mesh as it was read from `obj`, for a bake of its UV map `uv_layer`."""
    return before_bake.find(low, uv_layer, active_layer(obj), sampling)


def viewport_findings(
    context: bpy.types.Context, low: bpy.types.Object, settings: Settings, *, is_own_base: bool
) -> list[Finding]:
    """The findings for a low object as the viewport shows it. is_own_base: whether it is baked without its modifiers.

    Empty in other modes than Object Mode, where its mesh is out of date, and for meshes that take long.
    """
    if low.mode != "OBJECT":
        return []
    depsgraph = context.evaluated_depsgraph_get()
    with mesh_reader.base(low) if is_own_base else mesh_reader.evaluated(low, depsgraph) as data:
        layers = data.uv_layers
        layer = settings.map.uv_layer or (mesh_reader.active_uv_layer(data) if layers else "")
        if layer not in layers or not 0 < len(data.loops) <= MOST_CORNERS:
            return []
        mesh = mesh_reader.surface(data, layer, low.name, mesh_reader.matrix(low), with_faces=True)
        return mesh_findings(mesh, low, layer, settings.sampling) if len(mesh.triangles) else []


def flipped_findings(plan: Plan, timings: Timings) -> list[Finding]:
    """A finding if the faces of the meshes of a bake pointed to opposite sides when they were read. That of high meshes that
    were turned over is none.

    Without rays, a tree would be built for this alone, and the nearest faces have to raise the question.
    """
    meshes = replace(plan.read, highs=plan.highs)
    if meshes.is_own_base or not len(meshes.low.triangles):
        return []
    low = before_bake.faces_of_mesh(meshes.low, before_bake.LOW_FACES, least=before_bake.LEAST_FACES)
    each = max(1, before_bake.HIGH_FACES // len(meshes.highs))
    turned = [one.turned_of_kept for one in plan.masks] or [None] * len(meshes.highs)
    faces = (before_bake.faces_of_mesh(high, each, mask) for high, mask in zip(meshes.highs, turned, strict=True))
    highs = before_bake.joined_faces(list(faces))
    names = shorten_list(repr(high.name) for high in meshes.highs)
    against = before_bake.suspicion(len(meshes.low.triangles)) if plan.casts_rays else before_bake.MAYBE
    found = before_bake.find_flipped(low, highs, repr(meshes.low.name), names, against=against)
    is_mended = any(mask is not None for mask in turned)
    found = [each for each in found if not (is_mended and each.values["is_high"])]
    return [each for each in found if _shows_more_flipped(meshes, turned, timings, is_high=each.values["is_high"])]


def _shows_more_flipped(
    meshes: Meshes, turned: Sequence[np.ndarray | None], timings: Timings, *, is_high: bool
) -> bool:
    """Whether the low mesh would own more hits if it was turned over, or if the high ones were, as they were read.

    turned: which triangles (T,) bool of the high meshes the bake has turned over.
    """
    masks = [
        np.zeros(len(high.triangles), bool) if mask is None else mask
        for high, mask in zip(meshes.highs, turned, strict=True)
    ]
    is_mended = any(mask.any() for mask in masks)
    as_read = replace(meshes, highs=list(map(_turned, meshes.highs, masks))) if is_mended else meshes
    shares = own_hits.shares_of_sides(as_read, timings, like=meshes.highs if is_mended else None)
    if shares is None or len(meshes.whole_low.triangles) > MOST_LOW:
        return False
    if is_high:
        highs = [_turned(high, ~mask) for high, mask in zip(meshes.highs, masks, strict=True)]
        flipped = own_hits.shares_of_sides(replace(as_read, highs=highs), timings, like=meshes.highs)
        shares = shares[0], flipped[0] if flipped is not None else 0.0
    return before_bake.gains(*shares) and before_bake.gains(_share_from_afar(as_read, timings), shares[1])


MOST_LOW = 300_000
"""Triangles of a low mesh up to which its own surface is searched for what ends a way outward."""


def _share_from_afar(meshes: Meshes, timings: Timings) -> float:
    """The share of the low surface from which a ray meets the outside of a high mesh, as far outside as it may stand off."""
    low, space = meshes.whole_low, local_space_of([meshes.whole_low])
    places = own_hits.LowPlaces.of(meshes, before_bake.LOW_FACES)
    points = space.points(low)
    tree = BVHTree.FromPolygons(points.tolist(), low.vertices[low.triangles].tolist())
    far = traced_sides.FAR * diagonal(points)
    ways = traced_sides.clear_ways(tree, places.points(space).astype(np.float64), places.directions(), far)
    return own_hits.share_facing(meshes, places, ways * space.size, timings)


def _turned(mesh: Mesh, which: np.ndarray) -> Mesh:
    """A mesh with some of its triangles (T,) bool turned over, for what only asks for their sides."""
    normals = mesh.normals.copy()
    corners = np.unique(mesh.triangles[which])
    normals[corners] = -normals[corners]
    triangles = np.where(which[:, None], mesh.triangles[:, ::-1], mesh.triangles)
    return replace(mesh, triangles=triangles, normals=normals, face_corners=None)


MOST_TRACED = 500_000
"""The faces of the high objects up to which the panel looks at what rays hit, if they may be flipped: it takes half a second.
The bake looks in any case."""


def viewport_flipped(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object], *, is_sure: bool = True
) -> list[Finding]:
    """As `flipped_findings`, for objects as the viewport shows them.

    is_sure: whether rays are asked only where the nearest faces say it, too: a panel is drawn often.

    Empty in other modes than Object Mode, and for objects that are no meshes.
    """
    if low in highs or not highs or any(obj.type != "MESH" or obj.mode != "OBJECT" for obj in (low, *highs)):
        return []
    depsgraph = context.evaluated_depsgraph_get()
    evaluated_low, *shown = (obj.evaluated_get(depsgraph) for obj in (low, *highs))
    on_low = _some_faces(evaluated_low, before_bake.LOW_FACES)
    each = max(1, before_bake.HIGH_FACES // len(highs))
    on_high = before_bake.joined_faces([_some_faces(high, each) for high in shown])
    names = shorten_list(repr(high.name) for high in highs)
    against = before_bake.AGAINST if is_sure else before_bake.suspicion(len(on_low.centers))
    found = before_bake.find_flipped(on_low, on_high, repr(low.name), names, against=against)
    if not found or sum(len(high.data.polygons) for high in shown) > MOST_TRACED:
        return []
    aside, is_high = before_bake.aside(on_low, on_high), found[0].values["is_high"]
    surfaces = [Surface.of(high, depsgraph) for high in shown]
    shares = traced_sides.shares(
        on_low.centers,
        on_low.normals,
        Surface.of(evaluated_low, depsgraph),
        surfaces,
        aside=aside,
        size=_size(evaluated_low),
        is_high=is_high,
    )
    return found if before_bake.gains(*shares) else []


def _size(obj: bpy.types.Object) -> float:
    """The diagonal of the box of an evaluated object, in the world."""
    corners = np.array(obj.bound_box, np.float64) @ np.array(obj.matrix_world, np.float64)[:3, :3].T
    return diagonal(corners)


def viewport_material_notes(
    low: bpy.types.Object, highs: Sequence[bpy.types.Object], map_settings: MapSettings
) -> list[str]:
    """What the chosen maps will not have of the high objects' materials, in the sentences of a bake's report. Materials of
    instances are left out."""
    sockets, materials = _viewport_materials(low, highs, map_settings)
    notes = (note for each in materials for socket in (*sockets, "") for note in each.notes.get(socket, ()))
    return list(dict.fromkeys(notes))


def evaluates_materials(low: bpy.types.Object, highs: Sequence[bpy.types.Object], map_settings: MapSettings) -> bool:
    """Whether Cycles evaluates materials of the high objects for the chosen maps. Those of instances are left out."""
    sockets, materials = _viewport_materials(low, highs, map_settings)
    return any(isinstance(each.feeds.get(socket), ExactFeed) for each in materials for socket in sockets)


def _viewport_materials(
    low: bpy.types.Object, highs: Sequence[bpy.types.Object], map_settings: MapSettings
) -> tuple[set[str], list[HighMaterial]]:
    """The inputs that the chosen maps show, and what the materials of the high objects have in them."""
    sockets = {BY_NAME[name].socket for name in map_settings.drawn_maps} - {""}
    if not sockets:
        return sockets, []
    is_exact = map_settings.exact_materials == ExactMaterials.AUTO
    depsgraph = bpy.context.evaluated_depsgraph_get()
    numbers = MaterialNumbers(ImageTextures(), low.evaluated_get(depsgraph), sockets=sockets, is_exact=is_exact)
    for high in highs:
        if high.type == "MESH" and not high.data.is_editmode:
            shown = high.evaluated_get(depsgraph)
            for each in numbers.of_slots(shown, shown.data):
                numbers.read(each)
    return sockets, numbers.materials


def _some_faces(obj: bpy.types.Object, most: int) -> Faces:
    """Some faces of an evaluated object, evenly spaced, at most `most`: so few that large meshes take no longer."""
    polygons, matrix = obj.data.polygons, np.array(obj.matrix_world, np.float64)
    some = [polygons[number] for number in range(0, len(polygons), max(1, -(-len(polygons) // most)))]
    centers = np.array([each.center for each in some], np.float64).reshape(-1, 3)
    normals = np.array([each.normal * each.area for each in some], np.float64).reshape(-1, 3)
    with np.errstate(all="ignore"):  # an axis may have no scale
        try:
            turned = abs(np.linalg.det(matrix[:3, :3])) * np.linalg.inv(matrix[:3, :3]).T
        except np.linalg.LinAlgError:
            turned = np.zeros((3, 3))
    return Faces(transformed(centers, matrix), normals @ turned.T)


def finding_warnings(findings: Sequence[Finding]) -> list[Warned]:
    """The warnings about what harms."""
    kinds = {FLIPPED: severity.FLIPPED, HARD_EDGES: "hard_edges"}
    return [Warned(each.sentence, kinds.get(each.kind, "")) for each in findings if each.harms]


def soften(data: bpy.types.Mesh, soft: np.ndarray, hard: np.ndarray) -> int:
    """Make the edges `soft` (N,) int smooth, and keep the other ones in `hard` (M,) int hard. Returns how many are soft.

    Custom normals stay on all other corners; where edges become smooth, they are the mean of both sides.
    """
    is_sharp = np.zeros(len(data.edges), bool)
    is_sharp[hard] = True
    is_sharp[soft] = False
    custom = _merged(data, is_sharp) if "custom_normal" in data.attributes else None
    data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
    data.edges.foreach_set("use_edge_sharp", is_sharp)
    if custom is not None:
        _store(data, custom)
    return len(soft)


def _store(data: bpy.types.Mesh, normals: np.ndarray) -> None:
    """Replace the custom normals of `data`, in the way they are stored. normals: (C, 3) float32."""
    layer = data.attributes["custom_normal"]
    if (layer.data_type, layer.domain) == ("FLOAT_VECTOR", "CORNER"):
        layer.data.foreach_set("vector", normals.reshape(-1))
        return
    data.attributes.remove(layer)
    data.normals_split_custom_set(normals)


def _merged(data: bpy.types.Mesh, is_sharp: np.ndarray) -> np.ndarray:
    """The corner normals (C, 3) float32 with one normal for all corners of a vertex between which no edge is sharp."""
    corners = len(data.loops)
    vertex, edge = mesh_reader.corner_vertices(data), mesh_elements.corner_edges(data)
    following = mesh_elements.next_corners(data)
    order = np.argsort(edge, kind="stable")
    same = (edge[order][1:] == edge[order][:-1]) & ~is_sharp[edge[order][1:]]
    first, second = order[:-1][same], order[1:][same]
    is_same_way = vertex[first] == vertex[second]
    other, after = np.where(is_same_way, second, following[second]), np.where(is_same_way, following[second], second)
    root = topology.connected(corners, np.concatenate([first, following[first]]), np.concatenate([other, after]))
    normals = np.empty((corners, 3), np.float32)
    data.corner_normals.foreach_get("vector", normals.reshape(-1))
    return unit(topology.sums_of(root, normals, corners)[root]).astype(np.float32)


def add_triangulate(context: bpy.types.Context, report: Report) -> tuple[bpy.types.Modifier, int]:
    """Add a Triangulate modifier to the low object of a past bake. As `add`."""
    past = PastBake.of(report)
    return add_modifier(context, past.job.low, past.settings.map.modifiers, is_own_base=past.job.low in past.job.highs)


def add_modifier(
    context: bpy.types.Context, low: bpy.types.Object, modifiers: str, *, is_own_base: bool
) -> tuple[bpy.types.Modifier, int]:
    """Add a Triangulate modifier to the low object, with the triangles that Blender draws and that are baked.

    modifiers: as in Settings. is_own_base: whether it is baked without its modifiers.

    Also returns how many quads the modifier cuts along the other diagonal: Blender switches it for quads that would fold.
    Raises BakeError if the object cannot have the modifier, or already has it.
    """
    if not low.is_editable:
        raise BakeError(f"{low.name!r} is linked from another file: make it local to add a modifier.")
    if is_own_base:
        raise BakeError(
            f"{low.name!r} was baked from its own modifiers onto its base mesh: triangulate the base mesh instead."
        )
    if low.modifiers and low.modifiers[-1].type == "TRIANGULATE":
        raise BakeError(f"{low.name!r} already has a Triangulate modifier: {low.modifiers[-1].name!r}.")

    def read(depsgraph: bpy.types.Depsgraph) -> Mesh:
        with mesh_reader.evaluated(low, depsgraph) as data:
            return mesh_reader.surface(data, "", low.name, mesh_reader.matrix(low), with_faces=True)

    mesh = evaluation.evaluate(context, [low], read, modifiers=modifiers)
    modifier = low.modifiers.new("Triangulate", "TRIANGULATE")
    modifier.quad_method, modifier.ngon_method = "FIXED", "CLIP"
    modifier.keep_custom_normals = True
    return modifier, int(np.count_nonzero(face_shapes.folded(mesh)))


def triangulate_sentence(low: str, modifier: bpy.types.Modifier, folded: int) -> str:
    """What `add` did to the object `low`."""
    difference = f"; it divides {folded:,} folded quads differently from how Blender draws them" if folded else ""
    return f"{low!r} has the modifier {modifier.name!r}{difference}"


ASIDE = 1.0
"""By how much of u parts are moved: a whole tile, so that they read the same texels."""


def fix(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    kind: str,
) -> str:
    """Fix one of before_bake.KINDS, or UNWRAP. Returns a sentence about what was done.

    highs: the high objects of the bake; `low` is one of them if it is baked without its modifiers.

    Raises BakeError if that is not possible, and then nothing has changed.
    """
    if kind == before_bake.FLIPPED:
        return _flip(context, low, highs)
    _check_editable(low)
    is_own_base = low in highs
    if kind == before_bake.POLYGONS:
        modifier, folded = add_modifier(context, low, Modifiers.VIEWPORT, is_own_base=is_own_base)
        return triangulate_sentence(low.name, modifier, folded)
    return _FIXES[kind](low, settings)


def _check_editable(obj: bpy.types.Object) -> None:
    if obj.mode != "OBJECT":
        raise BakeError(f"{obj.name!r} is not in Object Mode: switch to it first.")
    for block in (obj, obj.data):
        if not block.is_editable:
            raise BakeError(f"{obj.name!r} is linked from another file: make it local to change it.")


def _flip(context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> str:
    found = viewport_flipped(context, low, highs, is_sure=False)
    if not found:
        raise BakeError(f"The faces of {low.name!r} and its high objects point to the same sides.")
    flipped = highs if found[0].values["is_high"] else [low]
    for obj in flipped:
        _check_editable(obj)
    blocks = list(dict.fromkeys(obj.data for obj in flipped))
    for data in blocks:
        flip_mesh(data)
    return f"The normals of {shorten_list(repr(obj.name) for obj in flipped)} are flipped"


def flip_mesh(data: bpy.types.Mesh) -> None:
    """Turn all faces over, with normals of their own, which Blender leaves where they are stored as vectors."""
    if "custom_normal" not in data.attributes:
        data.flip_normals()
        return
    before, order = mesh_reader.corner_normals(data), _by_face_and_vertex(data)
    data.flip_normals()
    data.update()
    wanted = np.empty_like(before)
    wanted[_by_face_and_vertex(data)] = -before[order]
    if np.abs(mesh_reader.corner_normals(data) - wanted).max(initial=0.0) > SAME_NORMAL:
        _store(data, wanted)
    data.update()


SAME_NORMAL = 1e-2
"""A difference of unit normals that Blender makes when it stores them in 16 bits."""


def _by_face_and_vertex(data: bpy.types.Mesh) -> np.ndarray:
    """The corners (C,) int, face by face, in the order of their vertices."""
    faces = np.repeat(np.arange(len(data.polygons)), mesh_reader.face_values(data, "loop_total"))
    return np.lexsort([mesh_reader.corner_vertices(data), faces])


def _activate_layer(low: bpy.types.Object, settings: Settings) -> str:
    layers = low.data.uv_layers
    if settings.map.uv_layer not in layers:
        raise BakeError(f"Modifiers make the UV map {settings.map.uv_layer!r} of {low.name!r}: apply them first.")
    layers.active = layers[settings.map.uv_layer]
    return f"{settings.map.uv_layer!r} is the active UV map of {low.name!r}"


def _soften(low: bpy.types.Object, settings: Settings) -> str:
    mesh = _own_mesh(low, settings.map)
    inside = uv_seams.hard_edges(mesh)
    if not len(inside):
        raise BakeError(f"Modifiers make the hard edges of {low.name!r}: change or apply them.")
    soft = mesh_elements.edges(low.data, inside)
    count = soften(low.data, soft, mesh_elements.edges(low.data, edges.hard_edges(mesh)[0]))
    low.data.update()
    left = len(uv_seams.hard_edges(_own_mesh(low, settings.map)))
    rest = f"; {left:,} are between vertices in the same place: merge those by distance" if left else ""
    return f"{count:,} edges of {low.name!r} are smooth, all inside UV islands{rest}"


def _move_mirrored(low: bpy.types.Object, settings: Settings) -> str:
    mesh = _own_mesh(low, settings.map)
    found = before_bake.mirrored_copies(mesh)
    if not found.any():
        mirrors = [modifier for modifier in low.modifiers if modifier.type == "MIRROR"]
        if not mirrors:
            raise BakeError(f"Modifiers make the mirrored parts of {low.name!r}: move their UVs there.")
        for modifier in mirrors:
            modifier.offset_u = ASIDE
        return f"UVs are moved aside by {shorten_list(repr(modifier.name) for modifier in mirrors)} of {low.name!r}"
    layer = low.data.uv_layers[_layer_name(low, settings.map)]
    uv = mesh_reader.uvs(low.data, layer.name)
    corners = mesh_elements.face_corners(low.data, np.unique(mesh.faces[found]))
    uv[corners, 0] += ASIDE
    layer.uv.foreach_set("vector", uv.reshape(-1))
    low.data.update()
    return f"{int(np.count_nonzero(found)):,} triangles of {low.name!r} are moved aside by one tile"


def _own_mesh(low: bpy.types.Object, map_settings: MapSettings) -> Mesh:
    """The object's own mesh, without modifiers."""
    data = low.data
    return mesh_reader.surface(data, _layer_name(low, map_settings), low.name, mesh_reader.matrix(low), with_faces=True)


def _layer_name(low: bpy.types.Object, map_settings: MapSettings) -> str:
    layers = low.data.uv_layers
    name = map_settings.uv_layer or (mesh_reader.active_uv_layer(low.data) if layers else "")
    if name not in layers:
        raise BakeError(f"{low.name!r} has no UV map {name!r} without its modifiers: apply them first.")
    return name


_FIXES: dict[str, Callable[[bpy.types.Object, Settings], str]] = {
    before_bake.LAYER: _activate_layer,
    before_bake.HARD_EDGES: _soften,
    before_bake.MIRRORED: _move_mirrored,
    UNWRAP: unwrapping.unwrap,
}


ON_TEXELS = ("overlap", "uncovered", "far", "unsure", "gaps", "backwards")
SKEWED = "skewed"
"""The kind of texels whose rays lean: they show detail from beside them. No check counts them, because that can be wanted."""
LEAN = 30.0
"""Degrees between a ray and the normal of its triangle from which a texel is skewed: shifted by half of the detail's height."""
ON_TRIANGLES = ("mirrored", "outside", "no_area", "behind")
ON_EDGES = ("hard_edges",)
ON_FACES = ("polygons", "uneven")
KINDS = (*ON_TEXELS, *ON_TRIANGLES, *ON_EDGES, *ON_FACES)
"""As in Report.checks."""
TEXELS = 1024 * 1024
"""How many texels are checked together. They take about 100 bytes each, and 200 where rays are followed farther."""


def of_low(report: Report) -> bpy.types.Object:
    """The low object of a past bake. Raises BakeError if an object of the bake was deleted."""
    return PastBake.of(report).job.low


def find(context: bpy.types.Context, report: Report, kind: str) -> np.ndarray:
    """The low object's faces (N,) int with issues of this kind, or edges (N, 2) for kinds ON_EDGES, as the objects are now.

    report: of the bake whose settings apply. Raises BakeError if the objects can no longer be baked like that, or if
    modifiers make faces that come from no face of the object.
    """
    view = _view(context, report, kind)
    if kind in ON_EDGES:
        return _in_edit_mesh(context, view, uv_seams.hard_edges(view.meshes.low), "EDGE")
    if kind in ON_FACES:
        found = np.flatnonzero(
            {"polygons": face_shapes.non_triangles, "uneven": face_shapes.non_planar}[kind](view.meshes.low)
        )
    else:
        found = np.unique(view.meshes.low.faces[_triangles(view, kind)])
    return _in_edit_mesh(context, view, found, "FACE")


def draw_mask(context: bpy.types.Context, report: Report, kind: str) -> bpy.types.Image:
    """Fill an image that is white on texels with issues of a kind ON_TEXELS. Its name has the map's name and the kind.

    report and errors: as in `find`.
    """
    view = _view(context, report, kind)
    with outputs.MapWriter("", view.settings) as writer:
        for tile, mask in progress.finish(_whole_masks(view, kind)).items():
            writer.add(tile, outputs.black_and_white(mask))
        return writer.commit()


def mask_work(context: bpy.types.Context, report: Report, kind: str) -> Task[dict[int, np.ndarray]]:
    """Find the texels (height, width) bool with issues of a kind ON_TEXELS, or SKEWED, for each UDIM tile.

    report and errors: as in `find`.
    """
    yield Progress("Reading the objects", 0.0)
    return (yield from _whole_masks(_view(context, report, kind), kind))


def _whole_masks(view: "_View", kind: str) -> Task[dict[int, np.ndarray]]:
    size = view.size[::-1]
    found: dict[int, np.ndarray] = {}
    for band, rows, _ in _masks(view, kind):
        mask = found.setdefault(band.tile, np.zeros(size, bool))
        mask[band.start : band.stop] = rows
        yield Progress("Checking the texels", (len(found) - 1 + band.stop / size[0]) / len(view.plan.tiles))
    return found


@dataclass(frozen=True)
class _View:
    """A past bake with its objects as they are now.

    Attributes:
        settings: Of the mask.
        distances: Of the bake's rays; empty for Flatten.
    """

    job: Job
    plan: Plan
    settings: Settings
    distances: dict[str, float]

    @property
    def meshes(self) -> Meshes:
        return self.plan.meshes

    @property
    def size(self) -> tuple[int, int]:
        return self.settings.sampling.width, self.settings.sampling.height

    @cached_property
    def drawing(self) -> baking.Drawing:
        """What draws it as the bake did."""
        return progress.finish(baking.draw(self.plan, Run(self.settings.traced(**self.distances))))


def _view(context: bpy.types.Context, report: Report, kind: str) -> _View:
    past = PastBake.of(report)
    # Settings of the map's appearance do not matter, because only the mask is written.
    space = Space.TANGENT if kind == "backwards" else Space.OBJECT
    settings = past.settings.without_other_maps().without_file().without_materials().mapped(space=space)
    settings = settings.stored(image=f"{settings.storing.image}_{kind}", depth=8, dither=False)
    check_job(context, past.job, settings)
    plan = plan_of(read_meshes(context, Request(past.job, settings)), settings, tiles=past.tiles)
    return _View(past.job, plan, settings, past.distances)


def _triangles(view: _View, kind: str) -> np.ndarray:
    """Which triangles of the low mesh, (T,) bool, have issues of this kind."""
    low = view.meshes.low
    if kind == "outside":
        outside = uv_layout.outside(low, uv_space(view.settings.sampling))
        harmful = outside if view.settings.sampling.udim else outside & ~uv_islands.moved_copies(low)
        return harmful if harmful.any() else outside
    if kind == "behind":
        return face_shapes.normals_behind(low)
    if kind in ON_TRIANGLES:
        areas = uv_layout.areas(low)
        return areas < 0.0 if kind == "mirrored" else areas == 0.0
    found = np.zeros(len(low.triangles) + 1, bool)
    uploaded = audit.upload_with_ids(low.triangles, low.uv)
    for band, mask, depth in _masks(view, kind):
        if mask.any():
            for numbers in audit.layers_of_triangles(uploaded, mask.shape[::-1], band.uv_to_clip, depth):
                found[numbers[mask].astype(np.int64)] = True
    return found[1:]


def _masks(view: _View, kind: str) -> Iterator[tuple[Band, np.ndarray, int]]:
    """Yields each band, which of its texels (height, width) bool have issues, and the most triangles on one of them."""
    tiles, bands = view.plan.tiles, _bands(view)
    with gpu_memory.trimmed():
        if kind == "overlap":
            yield from _shared(view, bands)
        elif kind == "unsure":
            yield from _unsure(view, bands)
        elif kind == SKEWED:
            yield from _skewed(view, bands)
        elif kind in {"gaps", "backwards"}:
            whole = dict(zip(tiles, (_close if kind == "gaps" else _backwards)(view), strict=False))
            for band in bands:
                yield band, whole[band.tile][band.start : band.stop], 1
        else:
            yield from _separated(view, kind, bands)


def _bands(view: _View) -> list[Band]:
    """The parts of all tiles that are checked together."""
    width, height = view.size
    rows = max(1, TEXELS // width)
    return [
        Band(start, min(start + rows, height), view.size, 0, tile)
        for tile in view.plan.tiles
        for start in range(0, height, rows)
    ]


def _shared(view: _View, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that triangles share, as `_masks` has them."""
    uploaded = mesh_upload.upload(view.meshes.low.triangles, uv=view.meshes.low.uv)
    for band in bands:
        drawn = target.get("overlap", band.width, band.height, "R16F")
        audit.draw_overlap(drawn, uploaded, band.uv_to_clip)
        counts = np.empty((band.height, band.width), np.float32)
        drawn.read(counts)
        yield band, counts > 1.0, int(counts.max())


def _separated(view: _View, kind: str, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that are uncovered or far, as `_masks` has them."""
    ray_cast = view.drawing.ray_cast
    probe = separation.full_probe(view.meshes, ray_cast)
    texels = separation.sample(probe, view.size, view.plan.tiles)
    method = Method.CAST if ray_cast else Method.FLATTEN
    offset, limit = separation.offset(texels, method), separation.limit(view.meshes.low, view.settings.tracing)
    for band in bands:
        texels = probe((band.width, band.height), band.uv_to_clip)
        mask = texels[..., 3] < 0.0 if kind == "uncovered" else separation.distances(texels, offset) > limit
        yield band, mask, 1


def _unsure(view: _View, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that may show the wrong layer, as `_masks` has them; none without rays."""
    ray_cast = view.drawing.ray_cast
    explorer = Explorer(ray_cast, view.meshes.whole_low) if ray_cast else None
    for band in bands:
        size = band.width, band.height
        yield band, explorer.doubts(size, band.uv_to_clip).unsure if explorer else np.zeros(size[::-1], bool), 1


def _skewed(view: _View, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels whose rays lean, as `_masks` has them; none without rays."""
    ray_cast, low = view.drawing.ray_cast, view.meshes.whole_low
    corners = local_space_of([low]).points(low)[low.vertices[low.front_triangles]]
    normals, _ = unit_normals(corners)
    for band in bands:
        skewed = np.zeros((band.height, band.width), bool)
        if ray_cast:
            drawn = target.get("audit rays", band.width, band.height, "RGBA32F", "RGBA32F")
            ray_cast.draw(drawn, band.uv_to_clip)
            places, away = drawn.texels(), drawn.texels(1)
            on_low = places[..., 3] > 0.0
            of_triangles = normals[places[on_low][:, 3].astype(np.int64) - 1]
            skewed[on_low] = (away[on_low][:, :3] * of_triangles).sum(axis=1) < np.cos(np.radians(LEAN))
        yield band, skewed, 1


def _close(view: _View) -> Iterator[np.ndarray]:
    """Tile by tile, the texels (height, width) bool that are too close to another island or to the border."""
    sparse = mip_gaps.grid(view.settings.sampling, mip_gaps.FULL_SIDE)
    columns, rows = sparse.steps
    for found in mip_gaps.find(view.meshes.low, view.plan.tiles, view.settings.sampling, sparse, overlaps=True):
        close = np.repeat(np.repeat(found.close | found.border, rows, axis=0), columns, axis=1)
        yield close[: view.settings.sampling.height, : view.settings.sampling.width]


def _backwards(view: _View) -> Iterator[np.ndarray]:
    """Tile by tile, the texels (height, width) bool whose normal points into the low mesh: drawn as in the bake."""
    for tile in view.plan.tiles:
        normals = progress.finish(view.drawing.renderer.raw(tile))[NORMAL.name]
        yield (normals[..., 2] <= 0.0) & (normals[..., 3] > 0.0)


def _in_edit_mesh(context: bpy.types.Context, view: _View, found: np.ndarray, domain: str) -> np.ndarray:
    """The object's own faces (N,), or edges (N, 2) by their vertices, for faces or edges of the baked mesh.

    domain: "FACE" or "EDGE". found: in the baked mesh, which modifiers may have changed.
    """
    low = view.job.low
    has_modifiers = low not in view.job.highs and len(low.modifiers) > 0
    if domain == "FACE" and not has_modifiers:
        return found

    def look(depsgraph: bpy.types.Depsgraph, name: str) -> tuple[np.ndarray | None, np.ndarray]:
        if not has_modifiers:
            return None, mesh_elements.edges(low.data, found)
        with mesh_reader.evaluated(low, depsgraph) as data:
            chosen = found if domain == "FACE" else mesh_elements.edges(data, found)
            return mesh_reader.numbers(data, name, domain), chosen

    modifiers = view.settings.map.modifiers
    with (
        evaluation.in_object_mode(context, [low]),
        mesh_reader.numbered(low, domain) if has_modifiers else nullcontext("") as name,
    ):
        numbers, found = evaluation.evaluate(context, [low], partial(look, name=name), modifiers=modifiers)
    if not has_modifiers:
        return found
    if numbers is None:
        raise BakeError(
            f"The modifiers of {low.name!r} make new faces, which cannot be selected: apply the modifiers first."
        )
    numbers = np.unique(numbers[found])
    return numbers[numbers >= 0]
