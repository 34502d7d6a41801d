# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of a high object that the part ID map tells apart, by the setting ID By."""

from dataclasses import replace

import bpy
import numpy as np

from ..core import foreach
from ..core.declarations.choices import IdBy
from ..mesh import topology, uv_islands
from ..mesh.triangle_mesh import Mesh
from . import mesh_reader, render_view

FACE_SETS = ".sculpt_face_set"
"""The attribute of faces in which Blender keeps the face sets of Sculpt Mode."""


def of_triangles(mesh: Mesh, data: bpy.types.Mesh, obj: bpy.types.Object, by: str) -> tuple[np.ndarray, list[str]]:
    """The part (T,) int of each triangle of `mesh`, from 0, and the names of the parts.

    Args:
        mesh: what was read of `data`, with its faces.
        obj: the evaluated object that shows it.
        by: an IdBy.
    """
    if by == IdBy.COLLECTION:
        names = [each.name for each in obj.original.users_collection if each.name != render_view.NAME]
        return np.zeros(len(mesh.triangles), np.int64), [*names, obj.name][:1]
    if by == IdBy.COLOR:
        colors, parts = np.unique(_face_colors(data), axis=0, return_inverse=True)
        return _used(parts.reshape(-1)[mesh.faces], ["#" + bytes(color).hex() for color in colors.astype(np.uint8)])
    if by == IdBy.FACE_SET:
        numbers, parts = np.unique(_face_sets(data), return_inverse=True)
        return _used(parts[mesh.faces], [f"{obj.name} face set {number}" for number in numbers.tolist()])
    if by == IdBy.UV_ISLAND and data.uv_layers:
        layer = mesh_reader.uvs(data, data.uv_layers.active.name)
        parts, what = uv_islands.islands(mesh if mesh.uv is not None else replace(mesh, uv=layer)), "UV island"
    else:
        corners = mesh.vertices[mesh.triangles]
        parts, what = topology.components(tuple(corners.T), len(mesh.positions))[0], "part"
    names = [f"{obj.name} {what} {number}" for number in range(1, int(parts.max(initial=-1)) + 2)]
    return parts, names


def _used(parts: np.ndarray, names: list[str]) -> tuple[np.ndarray, list[str]]:
    """The parts that triangles have, numbered anew, with their names."""
    used, numbers = np.unique(parts, return_inverse=True)
    return numbers.reshape(-1), [names[number] for number in used.tolist()]


def _face_sets(data: bpy.types.Mesh) -> np.ndarray:
    """The face set (F,) int of each face; 1 if it has none, as in Sculpt Mode."""
    attribute = data.attributes.get(FACE_SETS)
    return np.ones(len(data.polygons), np.int32) if attribute is None else foreach.read(attribute.data, "value")


def _face_colors(data: bpy.types.Mesh) -> np.ndarray:
    """The mean color (F, 3) of each face, in steps of 1/255; white without a color attribute."""
    attribute = data.color_attributes.active_color
    if attribute is None:
        return np.full((len(data.polygons), 3), 255)
    colors = foreach.vectors(attribute.data, "color_srgb", 4)[:, :3]
    if attribute.domain == "POINT":
        colors = colors[mesh_reader.corner_vertices(data)]
    counts = foreach.read(data.polygons, "loop_total")
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    means = np.add.reduceat(colors.astype(np.float64), starts, axis=0) / counts[:, None]
    return np.rint(means.clip(0.0, 1.0) * 255.0).astype(np.int64)
