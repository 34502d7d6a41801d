# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a low object before a bake, and what the high objects are."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..audit import before_bake, severity
from ..audit.before_bake import LAYER, OUTSIDE, OVERLAP, POLYGONS, Faces, Finding
from ..core.declarations.choices import ExactMaterials, Modifiers
from ..core.errors import shorten_list
from ..core.map_types import BY_NAME
from ..core.material_feeds import ExactFeed, HighMaterial
from ..core.progress import Timings
from ..core.report import evaluated
from ..core.sentences import Sentence
from ..core.settings import MapSettings, SamplingSettings, Settings
from ..engine import gpu_memory, high_look, own_hits
from ..engine.high_look import HighLook
from ..engine.planning import Plan
from ..mesh import uv_overlap
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import diagonal, transformed
from ..scene import mesh_reader, object_checks, poses, traced_sides
from ..scene.high_materials import Itself, MaterialNumbers, sets_of
from ..scene.materials.material_reading import NORMAL
from ..scene.textures import ImageTextures
from ..scene.traced_sides import Surface
from . import material_inputs
from .job import Job, Request, check_job, read_meshes

SHARED = severity.SHARED
OF_LAYOUT = (OUTSIDE, OVERLAP)
"""The kinds that matter wherever the map is used."""
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
        looked = high_look.look(meshes, settings.without_other_maps())
    inputs = [*evaluated(material_inputs.ways(meshes, settings.map)), *material_inputs.notes(meshes, settings.map)]
    inputs = [*pose_notes(context, job, settings), *inputs]
    return replace(looked, notes=(*looked.notes, *inputs))


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
    with _viewport_low(context, low, settings, is_own_base=is_own_base) as read:
        if read is None:
            return []
        mesh, layer, _ = read
        return [*before_bake.find_in_layout(mesh, settings), *mesh_findings(mesh, low, layer, settings.sampling)]


def viewport_cover(
    context: bpy.types.Context, low: bpy.types.Object, settings: Settings, *, is_own_base: bool
) -> dict[tuple[str, int], np.ndarray]:
    """The texels that a low object has in each image that others may share, as uv_overlap.covered has them, by the material,
    empty without texture sets, and the UDIM tile. is_own_base, and when it is empty: as in `viewport_findings`."""
    with _viewport_low(context, low, settings, is_own_base=is_own_base) as read:
        if read is None:
            return {}
        mesh, _, data = read
        parts = {"": mesh}
        if settings.map.texture_sets:
            slots = mesh_reader.material_slots(data, mesh, max(1, len(low.material_slots)))
            sets = sets_of(low, is_own_base=is_own_base)
            parts = {one.name: mesh.with_triangles(np.isin(slots, one.slots)) for one in sets}
        covers = {
            (name, tile): uv_overlap.covered(part, tile)
            for name, part in parts.items()
            for tile in before_bake.tiles_of(part, settings.sampling)
        }
        return {image: bits for image, bits in covers.items() if bits is not None}


def lost_shares(covers: Sequence[dict[tuple[str, int], np.ndarray]]) -> list[float]:
    """The share of the texels of each low object that others of them have in the same images, too; 0 where it does no harm.
    covers: of each, as `viewport_cover` returns it."""
    return [share if share > severity.MUCH_OVERLAP else 0.0 for share in uv_overlap.shares_of_others(covers)]


@contextmanager
def _viewport_low(
    context: bpy.types.Context, low: bpy.types.Object, settings: Settings, *, is_own_base: bool
) -> Iterator[tuple[Mesh, str, bpy.types.Mesh] | None]:
    """The low mesh as the viewport shows it, the UV map of the bake, and what it was read from. None: see
    `viewport_findings`."""
    if low.mode != "OBJECT":
        yield None
        return
    depsgraph = context.evaluated_depsgraph_get()
    with mesh_reader.base(low) if is_own_base else mesh_reader.evaluated(low, depsgraph) as data:
        layers = data.uv_layers
        layer = settings.map.uv_layer or (mesh_reader.active_uv_layer(data) if layers else "")
        if layer not in layers or not 0 < len(data.loops) <= MOST_CORNERS:
            yield None
            return
        mesh = mesh_reader.surface(data, layer, low.name, mesh_reader.matrix(low), with_faces=True)
        yield (mesh, layer, data) if len(mesh.triangles) else None


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
    flipped = before_bake.find_flipped(low, highs, repr(meshes.low.name), names, against=against)
    is_mended = any(mask is not None for mask in turned)
    flipped = [each for each in flipped if not (is_mended and each.values["is_high"])]
    return [each for each in flipped if _shows_more_flipped(meshes, turned, timings, is_high=each.values["is_high"])]


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
    flipped = before_bake.find_flipped(on_low, on_high, repr(low.name), names, against=against)
    if not flipped or sum(len(high.data.polygons) for high in shown) > MOST_TRACED:
        return []
    offset, is_high = before_bake.offset_beside(on_low, on_high), flipped[0].values["is_high"]
    surfaces = [Surface.of(high, depsgraph) for high in shown]
    shares = traced_sides.shares(
        on_low.centers,
        on_low.normals,
        Surface.of(evaluated_low, depsgraph),
        surfaces,
        offset=offset,
        size=_size(evaluated_low),
        is_high=is_high,
    )
    return flipped if before_bake.gains(*shares) else []


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
    shown = [*sockets, ""] if sockets - {NORMAL} else sockets
    notes = (note for each in materials for socket in shown for note in each.notes.get(socket, ()))
    return list(dict.fromkeys(notes))


def evaluates_materials(low: bpy.types.Object, highs: Sequence[bpy.types.Object], map_settings: MapSettings) -> bool:
    """Whether Cycles evaluates materials of the high objects for the chosen maps. Those of instances are left out."""
    sockets, materials = _viewport_materials(low, highs, map_settings)
    feeds = (each.detail if socket == NORMAL else each.feeds.get(socket) for each in materials for socket in sockets)
    return any(isinstance(feed, ExactFeed) for feed in feeds)


def _viewport_materials(
    low: bpy.types.Object, highs: Sequence[bpy.types.Object], map_settings: MapSettings
) -> tuple[set[str], list[HighMaterial]]:
    """The inputs that the chosen maps show, and what the materials of the high objects have in them."""
    sockets = {BY_NAME[name].socket for name in map_settings.drawn_maps} - {""}
    sockets |= {NORMAL} if map_settings.normal and map_settings.detail_maps else set()
    if not sockets:
        return sockets, []
    is_exact = map_settings.exact_materials == ExactMaterials.AUTO
    depsgraph = bpy.context.evaluated_depsgraph_get()
    numbers = MaterialNumbers(
        ImageTextures(),
        low.evaluated_get(depsgraph),
        sockets=sockets,
        is_exact=is_exact,
        itself=Itself() if object_checks.is_itself(low, highs) else None,
    )
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


def finding_warnings(findings: Sequence[Finding]) -> list[Sentence]:
    """The warnings about what harms."""
    return [each.sentence for each in findings if each.harms]
