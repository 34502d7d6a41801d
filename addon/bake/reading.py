# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the objects of a bake into arrays, all of them at once, so that Blender's state is borrowed only for that."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ..mesh import extract
from ..mesh.arrays import Mesh
from . import subjects
from .casting import check_cage
from .errors import BakeError
from .settings import Settings


@dataclass(frozen=True)
class Meshes:
    """What a bake works on.

    low: as rays and checks see it. basis: the low mesh with tangents, for tangent space, else None. directions (C, 3)
    float32: by corner of `low`, away from its surface. cage: with the corners of `low`, or None. is_own_base: the high
    mesh is the low object's own surface with modifiers.
    """

    low: Mesh
    highs: list[Mesh]
    basis: Mesh | None
    directions: np.ndarray
    cage: Mesh | None
    uv_layer: str
    is_own_base: bool


def read(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    settings: Settings,
) -> Meshes:
    """Evaluate and read all objects. Raises BakeError for what only shows then: faces, UV layers, the cage's topology."""
    is_own_base = low in highs
    with subjects.ready(context, low, highs, cage, settings.modifiers) as depsgraph:
        with extract.base(low) if is_own_base else extract.evaluated(low, depsgraph) as data:
            uv_layer = _uv_layer(low, data, settings.uv_layer)
            to_world = extract.matrix(low)
            low_mesh = extract.surface(data, uv_layer, low.name, to_world)
            directions = extract.directions(data, low_mesh, settings.directions)
            basis = extract.with_tangents(data, uv_layer, low.name, to_world) if settings.space == "TANGENT" else None
            cage_mesh = cage and _cage(cage, depsgraph, low_mesh, len(data.polygons))
        high_meshes = [_high(high, depsgraph, uv_layer, settings.method) for high in highs]
    for mesh in (low_mesh, *high_meshes, *([cage_mesh] if cage_mesh else [])):
        if not len(mesh.triangles):
            raise BakeError(
                f"{mesh.name!r} has no triangle left to bake: the coordinates of all of them are NaN or infinite."
            )
    return Meshes(low_mesh, high_meshes, basis, directions, cage_mesh, uv_layer, is_own_base)


def _high(high: bpy.types.Object, depsgraph: bpy.types.Depsgraph, low_layer: str, method: str) -> Mesh:
    with extract.evaluated(high, depsgraph) as data:
        layer = ""
        if method == "FLATTEN" or (method == "AUTO" and data.uv_layers):
            # The layer of the same name is the shared one; else the one that the artist sees in the UV editor.
            layer = _uv_layer(high, data, low_layer if low_layer in data.uv_layers else "")
        elif not data.polygons:
            raise BakeError(f"{high.name!r} has no faces.")
        return extract.surface(data, layer, high.name, extract.matrix(high), is_laid_flat=method == "FLATTEN")


def _cage(cage: bpy.types.Object, depsgraph: bpy.types.Depsgraph, low: Mesh, low_faces: int) -> Mesh:
    with extract.evaluated(cage, depsgraph) as data:
        mesh = extract.surface(data, "", cage.name, extract.matrix(cage))
        check_cage(low, mesh, (low_faces, len(data.polygons)))
    return mesh


def _uv_layer(obj: bpy.types.Object, data: bpy.types.Mesh, wanted: str) -> str:
    if not data.polygons:
        raise BakeError(f"{obj.name!r} has no faces.")
    if not data.uv_layers:
        raise BakeError(f"{obj.name!r} has no UV layer: unwrap it first.")
    if wanted and wanted not in data.uv_layers:
        known = ", ".join(repr(layer.name) for layer in data.uv_layers)
        raise BakeError(f"{obj.name!r} has no UV layer {wanted!r}: it has {known}.")
    return wanted or data.uv_layers.active.name
