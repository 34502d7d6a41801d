# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the weights by which UV islands get more or fewer texels than others: of a mesh, or for low meshes of high objects."""

from collections.abc import Sequence

import bpy
import numpy as np

from ..core.errors import BakeError
from ..mesh import transfer
from ..mesh.triangles import transformed, vertex_normals
from ..scene import evaluation, mesh_reader, object_checks
from ..scene.mesh_elements import UNPAINTED, missing_group, weights


def check(objects: Sequence[bpy.types.Object], group: str) -> None:
    """Raise BakeError if no object has the vertex group. group: empty for none."""
    if group and not any(group in obj.vertex_groups for obj in objects):
        raise BakeError(missing_group(objects[0], group))


def of_mesh(obj: bpy.types.Object, group: str) -> np.ndarray | None:
    """The weights (V,) float32 of the vertices of an object's own mesh; None without a group. Raises BakeError as `check`."""
    check([obj], group)
    return weights(obj, obj.data, [group])[0]


def of_highs(
    context: bpy.types.Context,
    highs: Sequence[bpy.types.Object],
    group: str,
    low: bpy.types.Object,
    *,
    modifiers: str,
) -> np.ndarray:
    """The weights (V,) float32 for a low mesh, each of the nearest place of high objects. modifiers: as Settings has them."""

    def read(depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        points, triangles, values = [np.zeros((0, 3))], [np.zeros((0, 3), int)], [np.zeros(0, np.float32)]
        for high in highs:
            if not object_checks.shows_itself(high, for_render=depsgraph.mode == "RENDER"):
                continue
            evaluated = high.evaluated_get(depsgraph)
            with mesh_reader.evaluated(high, depsgraph) as data:
                place = transformed(mesh_reader.points(data).astype(np.float64), mesh_reader.matrix(evaluated))
                corners = mesh_reader.corner_vertices(data)[mesh_reader.triangles(data)]
                corners = corners[np.isfinite(place).all(axis=1)[corners].all(axis=1)]
                triangles.append(corners + sum(map(len, points)))
                points.append(np.nan_to_num(place))
                own = weights(evaluated, data, [group])[0] if high.type == "MESH" else None
                values.append(np.full(len(place), UNPAINTED, np.float32) if own is None else own)
        return np.concatenate(points), np.concatenate(triangles), np.concatenate(values)

    points, triangles, values = evaluation.evaluate(context, highs, read, modifiers=modifiers)
    places = transformed(mesh_reader.points(low.data).astype(np.float64), mesh_reader.matrix(low))
    if not len(triangles):
        return np.full(len(places), UNPAINTED, np.float32)
    corners = mesh_reader.corner_vertices(low.data)[mesh_reader.triangles(low.data)]
    found, shares = transfer.nearest_places(points, triangles, places, vertex_normals(places, corners))
    return (values[triangles[found]] * shares).sum(axis=1).astype(np.float32)
