# SPDX-License-Identifier: GPL-3.0-or-later
"""Primitives of meshes in a glTF: their triangles as Blender's importer reads them, new values at their corners, and several of
them made one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from .binary_gltf import Glb


@dataclass(frozen=True)
class Part:
    """A primitive of a mesh, as Blender's importer reads it."""

    number: int
    """Its place in the mesh."""
    triangles: np.ndarray
    """Its vertices (T, 3) int."""
    share: slice
    """Its triangles among those of the mesh."""
    vertex: int
    """The number that Blender's importer gives the first of its vertices."""


def parts_of(file: Glb, mesh: int) -> list[Part]:
    """The primitives of a mesh that have triangles."""
    result, begin, vertex = [], 0, 0
    for number, primitive in enumerate(file.tree["meshes"][mesh]["primitives"]):
        if "POSITION" not in primitive["attributes"]:
            continue
        if "indices" in primitive:
            indices = file.whole(primitive["indices"])[:, 0].astype(np.int64)
        else:
            indices = np.arange(file.tree["accessors"][primitive["attributes"]["POSITION"]]["count"])
        if (triangles := _triangles(indices, primitive.get("mode", 4))) is not None:
            result.append(Part(number, triangles, slice(begin, begin + len(triangles)), vertex))
            begin += len(triangles)
        vertex += len(np.unique(indices if triangles is None else triangles))  # also those of points and lines
    return result


def _triangles(indices: np.ndarray, mode: int) -> np.ndarray | None:
    """The triangles (T, 3) of a primitive, in the order of Blender's importer; None for points and lines."""
    if mode == 4:
        return indices.reshape(-1, 3)
    if mode == 5:  # each second one runs the other way round
        strip = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
        strip[1::2, 1:] = strip[1::2, :0:-1]
        return strip
    if mode == 6:
        return np.stack([np.broadcast_to(indices[0], len(indices) - 2), indices[1:-1], indices[2:]], axis=1)
    return None


def as_imported(parts: Sequence[Part]) -> np.ndarray:
    """The triangles (T, 3) of all parts, by the numbers that Blender's importer gives their vertices."""
    numbers = [np.unique(part.triangles, return_inverse=True)[1].reshape(-1, 3) + part.vertex for part in parts]
    return np.concatenate([np.zeros((0, 3), np.int64), *numbers])


def surface_of(
    file: Glb, primitives: Sequence[dict], parts: Sequence[Part]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The points (T, 3, 3), vertices (T, 3) and normals (T, 3, 3) at the corners of all parts, in the axes of glTF.

    The vertices are those of `as_imported`. Primitives without normals have those of their faces, as glTF says.
    """
    points, normals = [np.zeros((0, 3, 3))], [np.zeros((0, 3, 3))]
    for part in parts:
        attributes = primitives[part.number]["attributes"]
        points.append(numbers_of(file, attributes["POSITION"])[part.triangles])
        if "NORMAL" in attributes:
            normals.append(numbers_of(file, attributes["NORMAL"])[part.triangles])
        else:
            a, b, c = points[-1].transpose(1, 0, 2)
            across = np.cross(b - a, c - a)
            across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.finfo(float).tiny)
            normals.append(across[:, None].repeat(3, axis=1))
    return np.concatenate(points), as_imported(parts), np.concatenate(normals)


def faces_kept(triangles: np.ndarray, data: bpy.types.Mesh) -> np.ndarray | None:
    """Which triangles (T,) bool of a file are the faces of a mesh: Blender leaves out those that have a vertex twice, and those
    that are there twice. None if the faces are others."""
    loops = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", loops)
    if len(loops) != 3 * len(data.polygons):
        return None
    if len(loops) == triangles.size:
        return np.ones(len(triangles), bool) if np.array_equal(triangles.reshape(-1), loops) else None
    if len(loops) > triangles.size:
        return None
    ordered = np.sort(triangles, axis=1)
    whole = (ordered[:, 1:] != ordered[:, :-1]).all(axis=1)
    first = np.zeros(len(triangles), bool)
    first[np.unique(ordered, axis=0, return_index=True)[1]] = True
    fitting = (kept for kept in (whole, whole & first) if np.array_equal(triangles[kept].reshape(-1), loops))
    return next(fitting, None)


def numbers_of(file: Glb, accessor: int) -> np.ndarray:
    """The values of an accessor as float64, also of normalized whole numbers."""
    how, values = file.tree["accessors"][accessor], file.whole(accessor)
    if not how.get("normalized"):
        return values.astype(np.float64)
    return np.maximum(values.astype(np.float64) / np.iinfo(values.dtype).max, -1.0)


def write_corners(file: Glb, primitive: dict, part: Part, values: Mapping[str, np.ndarray], known: np.ndarray) -> None:
    """Write attributes of a primitive. values: by their names (T, 3, n). known (T,): which triangles have them."""
    widths = [each.shape[-1] for each in values.values()]
    rows = np.concatenate(list(values.values()), axis=-1).reshape(-1, sum(widths)).astype(np.float32)
    attributes = primitive["attributes"]
    count = file.tree["accessors"][attributes["POSITION"]]["count"]
    indices, origin, rows = _split(part.triangles.reshape(-1), rows, np.repeat(known, 3), count)
    if len(origin) > count:
        _repeat_vertices(file, primitive, origin)
        primitive.pop("mode", None)
        primitive["indices"] = file.add_indices(indices)
    for name, each in zip(values, np.split(rows, np.cumsum(widths)[:-1], axis=1), strict=True):
        attributes[name] = file.add_accessor(np.ascontiguousarray(each))


STEPS = 1e5
"""Of values of corners, by which vertices are told apart: tangents of one vertex may differ by rounding."""


def _split(
    indices: np.ndarray, rows: np.ndarray, known: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices whose corners agree.

    indices (C,), rows (C, n), known (C,): the vertex of each corner, its values, and whether they are known. count: of
    vertices. Returns the new vertex of each corner, which old one each new vertex (V,) is, and their values (V, n).
    """
    keys = np.column_stack([indices[known], np.round(rows[known] * STEPS).astype(np.int64)])
    found, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    owner = found[:, 0]
    is_new = np.r_[np.zeros(min(1, len(owner)), bool), owner[1:] == owner[:-1]]
    number = np.where(is_new, count + np.cumsum(is_new) - 1, owner)
    result, values = indices.copy(), np.zeros((count + int(is_new.sum()), rows.shape[1]), np.float32)
    result[known] = number[inverse.reshape(-1)]
    values[number] = rows[known][first]
    return result, np.concatenate([np.arange(count), owner[is_new]]), values


def _repeat_vertices(file: Glb, primitive: dict, origin: np.ndarray) -> None:
    """Give a primitive the vertices `origin` (V,) of those that it has."""
    for owner in (primitive["attributes"], *primitive.get("targets", ())):
        for name, number in owner.items():
            how = file.tree["accessors"][number]
            like = {key: how[key] for key in ("normalized", "min", "max", "name") if key in how}
            owner[name] = file.add_accessor(file.whole(number)[origin], **like)


def join_primitives(file: Glb, mesh: dict) -> None:
    """Make one primitive of those with one material, if they have the same attributes and nothing of their own."""
    groups: dict[object, list[dict]] = {}
    for number, primitive in enumerate(mesh["primitives"]):
        is_plain = primitive.get("mode", 4) == 4 and not {"extras", "extensions"} & primitive.keys()
        has_all = {"indices", "material"} <= primitive.keys() and "POSITION" in primitive["attributes"]
        groups.setdefault(_shape(file, primitive) if is_plain and has_all else number, []).append(primitive)
    mesh["primitives"] = [_joined(file, group) if len(group) > 1 else group[0] for group in groups.values()]


def _shape(file: Glb, primitive: dict) -> tuple:
    """What primitives must have in common to become one."""

    def kinds(owner: dict) -> tuple:
        hows = {name: file.tree["accessors"][number] for name, number in owner.items()}
        return tuple((name, *map(hows[name].get, ("componentType", "type", "normalized"))) for name in sorted(hows))

    return primitive["material"], kinds(primitive["attributes"]), tuple(map(kinds, primitive.get("targets", ())))


def _joined(file: Glb, group: Sequence[dict]) -> dict:
    """One primitive of several of the same shape, with their vertices one after the other."""
    first, begin, indices = group[0], 0, []
    owners = [[each["attributes"], *each.get("targets", ())] for each in group]
    share_vertices = all(each == owners[0] for each in owners)
    for primitive in group:
        indices.append(file.whole(primitive["indices"])[:, 0].astype(np.int64) + begin)
        begin += 0 if share_vertices else file.tree["accessors"][primitive["attributes"]["POSITION"]]["count"]
    for same in zip(*owners, strict=True) if not share_vertices else ():
        for name in same[0]:
            numbers = [owner[name] for owner in same]
            how, values = file.tree["accessors"][numbers[0]], np.concatenate([file.whole(number) for number in numbers])
            like = {"normalized": how["normalized"]} if "normalized" in how else {}
            if "min" in how:
                like |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
            same[0][name] = file.add_accessor(values, **like)
    first["indices"] = file.add_indices(np.concatenate(indices))
    return first
