# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the weights of the vertex groups of objects at places on them, as engines can have them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import bpy
import numpy as np

from ...mesh import transfer
from ...mesh.fitting import surface_samples
from ...mesh.transfer import OnLow, Places
from ...mesh.triangles import transformed, vertex_normals
from ...scene import mesh_reader, object_checks

MOST_BONES = 4
"""The bones that move a vertex at most: engines read no more."""
SAMPLES, SAMPLES_PER_VERTEX = 20_000, 8
"""The samples of the objects, at least and for each vertex of a low mesh."""
LEAST = 1e-4
"""The weight of a bone from which it moves a vertex."""

PlacesT = TypeVar("PlacesT", OnLow, Places)


@dataclass(frozen=True)
class Found(Generic[PlacesT]):
    """What is read of the objects, at the vertices around the places.

    Attributes:
        rows: Of each object, the vertices (n,) int that have a row.
        counts: Of each object, its vertices.
        places: Where the low meshes lie, or points.
        groups: The names of the vertex groups.
        weights: (N, G), the weights.
    """

    rows: list[np.ndarray]
    counts: list[int]
    places: list[PlacesT]
    groups: list[str] = field(default_factory=list)
    weights: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


def find(
    highs: Sequence[bpy.types.Object],
    place: Callable[[np.ndarray, np.ndarray], list[PlacesT]],
    depsgraph: bpy.types.Depsgraph,
) -> Found[PlacesT] | None:
    """Places on objects, and the weights around them; None if instances alone have a surface.

    place: returns the places, from the points (V, 3) and triangles (T, 3) int of the objects in world space.
    """
    points, triangles, counts = [], [], []
    for high in highs:
        shown, corners = np.zeros((0, 3)), np.zeros((0, 3), int)
        if object_checks.shows_itself(high, for_render=depsgraph.mode == "RENDER"):
            with mesh_reader.evaluated(high, depsgraph) as data:
                matrix = mesh_reader.matrix(high.evaluated_get(depsgraph))
                shown = transformed(mesh_reader.points(data).astype(np.float64), matrix)
                corners = _outwards(mesh_reader.corner_vertices(data)[mesh_reader.triangles(data)], matrix)
                is_finite = np.isfinite(shown).all(axis=1)
                corners = corners[is_finite[corners].all(axis=1)]
                shown[~is_finite] = 0.0
        points.append(shown)
        triangles.append(corners + sum(counts))
        counts.append(len(shown))
    points, triangles = np.concatenate(points), np.concatenate(triangles)
    if not len(triangles):
        return None
    of_places = place(points, triangles)
    read = np.unique(np.concatenate([each.read for each in of_places]))
    starts = np.cumsum([0, *counts])
    rows = [read[(read >= first) & (read < end)] - first for first, end in zip(starts[:-1], starts[1:], strict=True)]
    names, weights = _weights(highs, rows, depsgraph)
    return Found(rows, counts, [each.within(read) for each in of_places], names, weights)


def of_lows(lows: Sequence[bpy.types.Object], points: np.ndarray, triangles: np.ndarray) -> list[OnLow]:
    """How low objects lie on a surface. points (P, 3), triangles (T, 3) int: of this, in world space."""
    count = max(SAMPLES, SAMPLES_PER_VERTEX * max(len(low.data.vertices) for low in lows))
    samples, result = surface_samples(points, triangles, count), []
    for low in lows:
        matrix = mesh_reader.matrix(low)
        corners = _outwards(mesh_reader.corner_vertices(low.data)[mesh_reader.triangles(low.data)], matrix)
        places = transformed(mesh_reader.points(low.data).astype(np.float64), matrix)
        result.append(transfer.lying_on(points, triangles, samples, places, corners))
    return result


def of_points(own: np.ndarray, own_triangles: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> list[Places]:
    """Where points (V, 3) of another surface lie on a surface. Arguments: as of `of_lows`."""
    found, shares = transfer.nearest_places(points, triangles, own, vertex_normals(own, own_triangles))
    return [Places(triangles[found], shares)]


def normalized(weights: np.ndarray, is_bone: np.ndarray) -> np.ndarray:
    """Weights (N, G), those of bones (G,) bool over their sum, as Blender deforms by them."""
    sums = weights[:, is_bone].sum(axis=1, keepdims=True)
    return np.where(is_bone, weights / np.where(sums > 0.0, sums, 1.0), weights)


def limited(weights: np.ndarray, is_bone: np.ndarray) -> np.ndarray:
    """Weights (V, G) from 0 to 1, of bones (G,) bool the MOST_BONES greatest, with a sum of 1.

    A vertex that moves with bones by less than a half moves with none.
    """
    result = np.clip(weights, 0.0, 1.0)
    of_bones = result[:, is_bone]
    is_moved = of_bones.sum(axis=1, keepdims=True) >= 0.5
    if of_bones.shape[1] > MOST_BONES:
        order = np.argsort(-of_bones, axis=1, kind="stable")
        np.put_along_axis(of_bones, order[:, MOST_BONES:], 0.0, axis=1)
    of_bones[of_bones < LEAST] = 0.0
    sums = of_bones.sum(axis=1, keepdims=True)
    result[:, is_bone] = np.where(is_moved, of_bones / np.where(sums > 0.0, sums, 1.0), 0.0)
    return result


def _outwards(triangles: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Triangles (T, 3) whose normals in the world are those that Blender shows, also of an object that a matrix mirrors."""
    return triangles[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else triangles


def _weights(
    highs: Sequence[bpy.types.Object], rows: Sequence[np.ndarray], depsgraph: bpy.types.Depsgraph
) -> tuple[list[str], np.ndarray]:
    """The names of the vertex groups, and the weights (N, G) of some vertices of each object. An object whose parent is a bone
    belongs to that alone."""
    numbers: dict[str, int] = {}
    found = []
    first = 0
    for high, which in zip(highs, rows, strict=True):
        if high.parent_type == "BONE":
            number = numbers.setdefault(high.parent_bone, len(numbers))
            found += [(first + row, number, 1.0) for row in range(len(which))]
        elif high.type == "MESH":
            names = [group.name for group in high.evaluated_get(depsgraph).vertex_groups]
            own = [numbers.setdefault(name, len(numbers)) for name in names]
            with mesh_reader.evaluated(high, depsgraph) as data:
                # Blender gives the weights of vertices one by one alone.
                found += [
                    (first + row, own[one.group], one.weight)
                    for row, vertex in enumerate(which.tolist())
                    for one in data.vertices[vertex].groups
                ]
        first += len(which)
    weights = np.zeros((first, len(numbers)))
    vertices, groups, values = np.array(found, np.float64).reshape(-1, 3).T
    weights[vertices.astype(int), groups.astype(int)] = values
    return list(numbers), weights
