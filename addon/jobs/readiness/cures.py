# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes a low object so that other programs show its map as it was baked."""

from collections.abc import Callable, Sequence

import bpy
import numpy as np

from ...audit import before_bake
from ...core.declarations.choices import Modifiers
from ...core.errors import BakeError, shorten_list
from ...core.settings import Settings
from ...mesh import edges, uv_seams
from ...mesh.triangle_mesh import Mesh
from ...scene import mesh_reader
from ...scene.elements import mesh_elements
from .. import triangulate
from . import low_findings, soft_edges

ASIDE = 1.0
"""By how much of u parts are moved: a whole tile, so that they read the same texels."""


def cure(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    settings: Settings,
    kind: str,
) -> str:
    """Cure one of before_bake.KINDS. Returns a sentence about what was done.

    highs: the high objects of the bake; `low` is one of them if it is baked without its modifiers.

    Raises BakeError if that is not possible, and then nothing has changed.
    """
    if kind == before_bake.FLIPPED:
        return _flip(context, low, highs)
    _check_editable(low)
    is_own_base = low in highs
    if kind == before_bake.POLYGONS:
        modifier, folded = triangulate.add(context, low, Modifiers.VIEWPORT, is_own_base=is_own_base)
        return triangulate.sentence(low.name, modifier, folded)
    return _CURES[kind](low, settings)


def _check_editable(obj: bpy.types.Object) -> None:
    if obj.mode != "OBJECT":
        raise BakeError(f"{obj.name!r} is not in Object Mode: switch to it first.")
    for block in (obj, obj.data):
        if not block.is_editable:
            raise BakeError(f"{obj.name!r} is linked from another file: make it local to change it.")


def _flip(context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> str:
    found = low_findings.shown_flipped(context, low, highs)
    if not found:
        raise BakeError(f"The faces of {low.name!r} and its high objects point to the same sides.")
    flipped = highs if found[0].values["is_high"] else [low]
    for obj in flipped:
        _check_editable(obj)
    blocks = list(dict.fromkeys(obj.data for obj in flipped))
    for data in blocks:
        data.flip_normals()
    return f"The normals of {shorten_list(repr(obj.name) for obj in flipped)} are flipped"


def _activate_layer(low: bpy.types.Object, settings: Settings) -> str:
    layers = low.data.uv_layers
    if settings.uv_layer not in layers:
        raise BakeError(f"Modifiers make the UV map {settings.uv_layer!r} of {low.name!r}: apply them first.")
    layers.active = layers[settings.uv_layer]
    return f"{settings.uv_layer!r} is the active UV map of {low.name!r}"


def _soften(low: bpy.types.Object, settings: Settings) -> str:
    mesh = _own_mesh(low, settings)
    inside = uv_seams.hard_edges(mesh)
    if not len(inside):
        raise BakeError(f"Modifiers make the hard edges of {low.name!r}: change or apply them.")
    soft = mesh_elements.edges(low.data, inside)
    count = soft_edges.soften(low.data, soft, mesh_elements.edges(low.data, edges.hard_edges(mesh)[0]))
    low.data.update()
    left = len(uv_seams.hard_edges(_own_mesh(low, settings)))
    rest = f"; {left:,} are between vertices in the same place: merge those by distance" if left else ""
    return f"{count:,} edges of {low.name!r} are smooth, all inside UV islands{rest}"


def _move_mirrored(low: bpy.types.Object, settings: Settings) -> str:
    mesh = _own_mesh(low, settings)
    found = before_bake.mirrored_copies(mesh)
    if not found.any():
        mirrors = [modifier for modifier in low.modifiers if modifier.type == "MIRROR"]
        if not mirrors:
            raise BakeError(f"Modifiers make the mirrored parts of {low.name!r}: move their UVs there.")
        for modifier in mirrors:
            modifier.offset_u = ASIDE
        return f"UVs are moved aside by {shorten_list(repr(modifier.name) for modifier in mirrors)} of {low.name!r}"
    layer = low.data.uv_layers[_layer(low, settings)]
    uv = mesh_reader.uvs(low.data, layer.name)
    corners = mesh_elements.face_corners(low.data, np.unique(mesh.faces[found]))
    uv[corners, 0] += ASIDE
    layer.uv.foreach_set("vector", uv.reshape(-1))
    low.data.update()
    return f"{int(np.count_nonzero(found)):,} triangles of {low.name!r} are moved aside by one tile"


def _own_mesh(low: bpy.types.Object, settings: Settings) -> Mesh:
    """The object's own mesh, without modifiers."""
    data = low.data
    return mesh_reader.surface(data, _layer(low, settings), low.name, mesh_reader.matrix(low), with_faces=True)


def _layer(low: bpy.types.Object, settings: Settings) -> str:
    layers = low.data.uv_layers
    name = settings.uv_layer or (layers.active.name if layers.active is not None else "")
    if name not in layers:
        raise BakeError(f"{low.name!r} has no UV map {name!r} without its modifiers: apply them first.")
    return name


_CURES: dict[str, Callable[[bpy.types.Object, Settings], str]] = {
    before_bake.LAYER: _activate_layer,
    before_bake.HARD_EDGES: _soften,
    before_bake.MIRRORED: _move_mirrored,
}
