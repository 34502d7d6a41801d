# SPDX-License-Identifier: GPL-3.0-or-later
"""Fixes what is found in a low object before a bake."""

from collections.abc import Callable, Sequence

import bpy
import numpy as np

from ..audit import before_bake
from ..core import foreach
from ..core.declarations.choices import Modifiers
from ..core.errors import BakeError, shorten_list
from ..core.progress import Task, part
from ..core.report import Report
from ..core.settings import MapSettings, Settings
from ..mesh import edges, face_shapes, topology, uv_seams
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import unit
from ..scene import evaluation, mesh_elements, mesh_reader
from ..scene.object_checks import ObjectRef
from . import unwrapping, uv_density
from .job import PastBake
from .pair_checks import viewport_flipped

UNWRAP, PACK = "UNWRAP", "PACK"
"""The operators that unwrap objects, and that pack the UV maps of several, as buttons of a sentence."""


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
    normals = foreach.vectors(data.corner_normals)
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
            f"{low.name!r} is baked onto its mesh without modifiers: triangulate that mesh instead, with Triangulate Faces."
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


ONE_TILE = 1.0
"""By how much of u parts are moved: a whole tile, so that they read the same texels."""


def fix(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    kind: str,
) -> str:
    """Fix one of before_bake.KINDS. Returns a sentence about what was done.

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


def unwrap(
    lows: Sequence[tuple[bpy.types.Object, Settings]], *, stacks: bool = False, density_group: str = ""
) -> Task[tuple[list[str], list[str]]]:
    """Give objects a UV map, each with the margin of its settings; those that share a mesh get one. Returns a sentence about
    each that got one, and why others did not. stacks, density_group: as Wanted has them.

    If it is closed before its end, or raises BakeError since none can be unwrapped, nothing has changed.
    """
    of_mesh = {low.data: (ObjectRef.of(low), settings) for low, settings in reversed(lows)}
    found, failures = [], []
    for done, (ref, settings) in enumerate(reversed(of_mesh.values())):
        try:
            low = ref.resolve()
            _check_editable(low)
            weights = uv_density.of_mesh(low, density_group)
            work = unwrapping.find(low, settings.sampling, stacks=stacks, weights=weights)
            found.append((ref, (yield from part(work, done / len(of_mesh), (done + 1) / len(of_mesh)))))
        except BakeError as error:
            failures.append(str(error))
    if not found:
        raise BakeError(failures[0])
    return [unwrapping.apply(low, each) for low, each in [(ref.resolve(), each) for ref, each in found]], failures


def _check_editable(obj: bpy.types.Object) -> None:
    if obj.mode != "OBJECT":
        raise BakeError(f"{obj.name!r} is not in Object Mode: switch to it first.")
    for block in (obj, obj.data):
        if not block.is_editable:
            raise BakeError(f"{obj.name!r} is linked from another file: make it local to change it.")


def _flip(context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> str:
    findings = viewport_flipped(context, low, highs, is_sure=False)
    if not findings:
        raise BakeError(f"The faces of {low.name!r} and its high objects point to the same sides.")
    flipped = highs if findings[0].values["is_high"] else [low]
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
    is_copy = before_bake.mirrored_copies(mesh)
    if not is_copy.any():
        mirrors = [modifier for modifier in low.modifiers if modifier.type == "MIRROR"]
        if not mirrors:
            raise BakeError(f"Modifiers make the mirrored parts of {low.name!r}: move their UVs there.")
        for modifier in mirrors:
            modifier.offset_u = ONE_TILE
        return f"UVs are moved aside by {shorten_list(repr(modifier.name) for modifier in mirrors)} of {low.name!r}"
    layer = low.data.uv_layers[_layer_name(low, settings.map)]
    uv = mesh_reader.uvs(low.data, layer.name)
    corners = mesh_elements.face_corners(low.data, np.unique(mesh.faces[is_copy]))
    uv[corners, 0] += ONE_TILE
    layer.uv.foreach_set("vector", uv.reshape(-1))
    low.data.update()
    return f"{int(np.count_nonzero(is_copy)):,} triangles of {low.name!r} are moved aside by one tile"


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
}
