# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks at a low object before it is baked."""

from collections.abc import Sequence

import bpy
import numpy as np

from ...audit import before_bake, causes, facing
from ...audit.before_bake import FLIPPED, HARD_EDGES, LAYER, MIRRORED, POLYGONS, Finding
from ...audit.causes import Warned
from ...audit.facing import Faces
from ...core.errors import shorten_list
from ...core.settings import Settings
from ...mesh.inputs import Meshes
from ...mesh.triangle_mesh import Mesh
from ...scene import mesh_reader

__all__ = ["FLIPPED", "HARD_EDGES", "LAYER", "MIRRORED", "POLYGONS", "Finding"]
CURED_BY_EXPORT = (POLYGONS, LAYER)
"""The kinds that do not matter for files that Imprint exports."""
MOST_CORNERS = 400_000
"""The largest low mesh, in corners of faces, that `shown` looks at: it takes a few tenths of a second."""


def is_for_others(settings: Settings, *, is_exported: bool) -> bool:
    """Whether a program other than Blender reads the normal map. settings: as in before_bake.is_for_others.

    is_exported: whether Imprint writes the low mesh for an engine. Then it has the triangles and tangents of the bake.
    """
    return before_bake.is_for_others(settings) or (is_exported and before_bake.is_in_tangent_space(settings))


def left(findings: Sequence[Finding], *, is_exported: bool) -> list[Finding]:
    """The findings that the export does not cure. is_exported: as in `is_for_others`."""
    return [finding for finding in findings if not (is_exported and finding.kind in CURED_BY_EXPORT)]


def active_layer(low: bpy.types.Object) -> str:
    """The name of the active UV map of an object's own mesh; empty if it has none."""
    layer = low.data.uv_layers.active
    return layer.name if layer is not None else ""


def read(low: Mesh, obj: bpy.types.Object, uv_layer: str, settings: Settings) -> list[Finding]:
    """The findings for a low mesh as it was read from `obj`, for a bake of its UV map `uv_layer`."""
    return before_bake.find(low, uv_layer, active_layer(obj), settings)


def shown(context: bpy.types.Context, low: bpy.types.Object, settings: Settings, *, is_own_base: bool) -> list[Finding]:
    """The findings for a low object as the viewport shows it. is_own_base: whether it is baked without its modifiers.

    Empty in other modes than Object Mode, where its mesh is out of date, and for meshes that take long.
    """
    if low.mode != "OBJECT":
        return []
    depsgraph = context.evaluated_depsgraph_get()
    with mesh_reader.base(low) if is_own_base else mesh_reader.evaluated(low, depsgraph) as data:
        layers = data.uv_layers
        layer = settings.uv_layer or (layers.active.name if layers.active is not None else "")
        if layer not in layers or not 0 < len(data.loops) <= MOST_CORNERS:
            return []
        mesh = mesh_reader.surface(data, layer, low.name, mesh_reader.matrix(low), with_faces=True)
        return read(mesh, low, layer, settings) if len(mesh.triangles) else []


def flipped(meshes: Meshes) -> list[Finding]:
    """A finding if the faces of the meshes of a bake point to opposite sides."""
    if meshes.is_own_base or not len(meshes.low.triangles):
        return []
    low = facing.of_mesh(meshes.low, facing.LOW_FACES)
    each = max(1, facing.HIGH_FACES // len(meshes.highs))
    highs = facing.joined([facing.of_mesh(high, each) for high in meshes.highs])
    names = shorten_list(repr(high.name) for high in meshes.highs)
    return before_bake.find_flipped(low, highs, repr(meshes.low.name), names)


def shown_flipped(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object]
) -> list[Finding]:
    """As `flipped`, for objects as the viewport shows them. Empty in other modes than Object Mode, and for objects that are no
    meshes."""
    if low in highs or not highs or any(obj.type != "MESH" or obj.mode != "OBJECT" for obj in (low, *highs)):
        return []
    depsgraph = context.evaluated_depsgraph_get()
    on_low = _some_faces(low.evaluated_get(depsgraph), facing.LOW_FACES)
    each = max(1, facing.HIGH_FACES // len(highs))
    on_high = facing.joined([_some_faces(high.evaluated_get(depsgraph), each) for high in highs])
    return before_bake.find_flipped(on_low, on_high, repr(low.name), shorten_list(repr(high.name) for high in highs))


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
    return Faces(centers @ matrix[:3, :3].T + matrix[:3, 3], normals @ turned.T)


def warnings(findings: Sequence[Finding]) -> list[Warned]:
    """The warnings about what harms."""
    kinds = {FLIPPED: causes.FLIPPED, HARD_EDGES: "hard_edges"}
    return [Warned(each.sentence, kinds.get(each.kind, "")) for each in findings if each.harms]
