# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples maps onto attributes of the low mesh, with a value for each face corner or for each vertex."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ..core import foreach, udim
from ..core.declarations.choices import VertexDomain
from ..core.errors import BakeError
from ..core.map_types import BY_NAME, NORMAL, Kind, Map, MapType
from ..core.settings import Settings
from . import journal, value_encoding

INWARD = 0.75
"""How far a corner moves into its face before its texel is read, in texels: more than half the diagonal of one."""
REACH = 2
"""How far from this texel a known one may be, in texels along each axis."""
BUILT_IN = frozenset({"position", "material_index"})
"""Attributes of meshes that have a meaning in Blender. A map of such a name, or of that of a UV map or a vertex group, gets
PREFIX."""
PREFIX = "baked_"
UV_TYPE = "FLOAT2"
FIELDS = {"FLOAT": "value", "FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color"}
"""The property of the values of each type of attribute."""


def check(low: bpy.types.Object) -> None:
    """Raise BakeError if the mesh of `low` cannot get attributes. Called before the bake."""
    if not low.data.is_editable or low.data.override_library:
        raise BakeError(
            f'The mesh "{low.data.name}" is linked from a library and cannot be given attributes: make it local first.'
        )
    if low.mode == "EDIT":
        raise BakeError(f'"{low.name}" is in Edit Mode, where its attributes cannot be set: leave Edit Mode first.')


@dataclass
class _Samples:
    """One map at the corners.

    Attributes:
        values: (C, 3) float32.
        known (C,) bool: Where they are known.
    """

    values: np.ndarray
    known: np.ndarray


class VertexMaps:
    """Reads the maps of one bake at the corners of a mesh, tile by tile, and stores them in attributes at the end."""

    def __init__(
        self,
        low: bpy.types.Object,
        uv_layer: str,
        settings: Settings,
        *,
        is_own_base: bool = False,
        slots: Sequence[int] | None = None,
    ):
        """uv_layer: that is baked. is_own_base: whether the modifiers of `low` make the high mesh. slots: the numbers of the
        material slots whose faces are baked; None for all.

        Raises BakeError if the mesh has no such layer of its own.
        """
        self.settings = settings
        self._names = [NORMAL.name] * settings.map.normal + list(settings.map.drawn_maps)
        self._samples: dict[str, _Samples] = {}
        mesh = low.data
        self._vertices, counts = foreach.read(mesh.loops, "vertex_index"), foreach.read(mesh.polygons, "loop_total")
        evaluated = low.evaluated_get(bpy.context.evaluated_depsgraph_get())
        self._is_changed = not is_own_base and len(evaluated.data.loops) != len(mesh.loops)
        self._is_baked = np.repeat(_are_in(low if is_own_base or self._is_changed else evaluated, slots), counts)
        self._tiles, self._uv = self._places(mesh, uv_layer, counts)

    def _places(self, mesh: bpy.types.Mesh, uv_layer: str, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The UDIM tiles (C,) of the corners, and their places (C, 2) float64 in them, moved a bit into their faces.

        counts (F,): the corners of each face.
        """
        layer = mesh.uv_layers.get(uv_layer)
        if layer is None:
            raise BakeError(
                f'The UV map "{uv_layer}" of "{mesh.name}" comes from modifiers: apply them to store maps in attributes.'
            )
        uv = foreach.vectors(layer.uv, width=2).astype(np.float64)
        faces = np.repeat(np.arange(len(counts)), counts)
        centers = np.stack([np.bincount(faces, weights=part) / counts for part in uv.T], axis=-1)[faces]
        toward = centers - uv
        texels = np.linalg.norm(toward * self.settings.sampling.size, axis=-1)
        uv += toward * np.minimum(0.5, INWARD / np.maximum(texels, 1e-9))[:, None]
        columns, rows = np.floor(centers).astype(np.int64).T
        tiles = udim.number(columns, rows) if self.settings.sampling.udim else np.full(len(uv), udim.FIRST)
        return tiles, uv - np.stack([columns, rows], axis=-1)

    def add(self, tile: int, maps: dict[str, Map]) -> None:
        """Sample one UDIM tile of all maps, by name, before they are encoded. The texels do not change."""
        corners = np.flatnonzero((self._tiles == tile) & self._is_baked)
        for name in self._names:
            texels, _ = maps[name]
            rows, columns, has_texel = _nearest(self._uv[corners], texels[..., 3] > 0.0)
            count = len(self._vertices)
            samples = self._samples.setdefault(name, _Samples(np.zeros((count, 3), np.float32), np.zeros(count, bool)))
            samples.known[corners] = has_texel
            samples.values[corners] = np.where(has_texel[:, None], texels[rows, columns, :3], np.float32(0.0))

    def store(self, low: bpy.types.Object) -> tuple[dict[str, str], list[str]]:
        """Store the attributes in the mesh of `low`. Returns their names by map, in lower case, and warnings."""
        mesh = low.data
        if len(mesh.loops) != len(self._vertices):
            return {}, [f'The mesh "{mesh.name}" changed during the bake, so the maps are not in its attributes.']
        names = {}
        for name, samples in self._samples.items():
            names[name.lower()] = self._store(low, BY_NAME[name], samples)
        return names, self._warnings(low)

    def _store(self, low: bpy.types.Object, map_type: MapType, samples: _Samples) -> str:
        """Store one map in an attribute, and return its name."""
        values, is_baked = self._decoded(map_type, samples), self._is_baked
        if self.settings.storing.vertex_domain == VertexDomain.POINT:
            count = len(low.data.vertices)
            values = self._by_vertex(map_type, values, samples.known, count)
            is_baked = np.bincount(self._vertices[is_baked], minlength=count) > 0
        if map_type.kind is Kind.LABEL:  # the first value of a vertex has no fraction
            values = value_encoding.palette(int(values.max(initial=0.0)))[values[:, 0].astype(np.int32)]
        kind = _type_of(map_type)
        if kind == "FLOAT":
            values = values[:, 0]
        elif kind == "FLOAT_COLOR":
            values = np.concatenate([values, np.ones((len(values), 1), np.float32)], axis=1)
        name, domain = map_type.suffix or NORMAL.name.lower(), self.settings.storing.vertex_domain
        return put_values(low, name, values, is_baked, kind=kind, domain=str(domain))

    def _decoded(self, map_type: MapType, samples: _Samples) -> np.ndarray:
        """The values (C, 3); normals as x, y and z, whatever channels store them."""
        if map_type.kind is not Kind.NORMAL:
            return samples.values
        normals = np.zeros_like(samples.values)
        for number, axis in enumerate(self.settings.map.channels):
            sign = np.float32(-1.0 if axis[0] == "-" else 1.0)
            normals[:, "XYZ".index(axis[1])] = sign * (samples.values[:, number] * 2.0 - 1.0)
        return np.where(samples.known[:, None], normals, np.float32(0.0))

    def _by_vertex(self, map_type: MapType, values: np.ndarray, known: np.ndarray, count: int) -> np.ndarray:
        """The values (`count`, 3) of vertices: the mean of their known corners, or the first known label."""
        vertices = self._vertices[known]
        if map_type.kind is Kind.LABEL:
            first = np.zeros((count, 3), np.float32)
            first[vertices[::-1]] = values[known][::-1]  # the last one that is set stays
            return first
        sums = np.stack([np.bincount(vertices, weights=part, minlength=count) for part in values[known].T], axis=-1)
        is_normal = map_type.kind is Kind.NORMAL
        divisors = np.linalg.norm(sums, axis=-1) if is_normal else np.bincount(vertices, minlength=count)
        return (sums / np.maximum(divisors, 1e-30)[:, None]).astype(np.float32)

    def _warnings(self, low: bpy.types.Object) -> list[str]:
        warnings = []
        if self._is_changed:
            warnings.append(
                f'Modifiers change the topology of "{low.name}": the attributes are on its mesh without them, and the '
                "modifiers interpolate them."
            )
        if low.data.users > 1:
            warnings.append(
                f'The mesh "{low.data.name}" has {low.data.users} users: the attributes are on all objects that use it.'
            )
        unknown = max((int((self._is_baked & ~samples.known).sum()) for samples in self._samples.values()), default=0)
        if unknown:
            warnings.append(
                f'{unknown:,} of {self._is_baked.sum():,} face corners of "{low.name}" have no known texel near them: their '
                "attributes are 0, or the mean of the other corners."
            )
        return warnings


def _are_in(low: bpy.types.Object, slots: Sequence[int] | None) -> np.ndarray:
    """Which faces (F,) bool of the mesh of `low` are in material slots; all of them for None. Evaluated, it also has the
    materials that its modifiers set."""
    if slots is None:
        return np.ones(len(low.data.polygons), bool)
    indices = foreach.read(low.data.polygons, "material_index")
    # A face whose index is too high shows the last slot.
    return np.isin(indices.clip(0, max(0, len(low.material_slots) - 1)), slots)


def _nearest(uv: np.ndarray, is_known: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rows and columns (N,) of the known texels nearest to places (N, 2), and whether there is one (N,) bool."""
    height, width = is_known.shape
    places = uv * (width, height)
    columns, rows = np.clip(np.floor(places).astype(np.int64), 0, (width - 1, height - 1)).T
    has_texel = is_known[rows, columns]
    nearest_rows, nearest_columns = rows.copy(), columns.copy()
    left = np.flatnonzero(~has_texel)
    if not len(left):
        return nearest_rows, nearest_columns, has_texel
    steps = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1].reshape(2, -1).T
    around = np.stack([rows[left], columns[left]], axis=-1)[:, None] + steps
    around = np.clip(around, 0, (height - 1, width - 1))
    is_there = is_known[around[..., 0], around[..., 1]]
    distances = np.linalg.norm(around[..., ::-1] + 0.5 - places[left, None], axis=-1)
    best = np.where(is_there, distances, np.inf).argmin(axis=1)
    chosen = around[np.arange(len(left)), best]
    nearest_rows[left], nearest_columns[left] = chosen.T
    has_texel[left] = is_there.any(axis=1)
    return nearest_rows, nearest_columns, has_texel


def _type_of(map_type: MapType) -> str:
    """The type of attribute that holds a map."""
    if map_type.kind is Kind.NORMAL or map_type.is_vector:
        return "FLOAT_VECTOR"
    return "FLOAT" if map_type.is_scalar else "FLOAT_COLOR"


@journal.recorded
def put_values(
    low: bpy.types.Object, name: str, values: np.ndarray, is_baked: np.ndarray, *, kind: str, domain: str
) -> str:
    """Put values into an attribute where `is_baked` (N,) bool. Returns its name.

    name: that it gets if it can. kind, domain: Blender's identifiers. values: (N,) or (N, 3 or 4) float32, of as many elements
    as the mesh has; nothing happens if it has others by now.
    """
    if len(values) != len(low.data.vertices if domain == VertexDomain.POINT else low.data.loops):
        return ""
    attribute = _attribute(low, name, kind, domain)
    stored = np.empty(values.size, np.float32)
    attribute.data.foreach_get(FIELDS[kind], stored)
    stored.reshape(len(values), -1)[is_baked] = values.reshape(len(values), -1)[is_baked]
    attribute.data.foreach_set(FIELDS[kind], stored)
    low.data.update()
    return attribute.name


def _attribute(low: bpy.types.Object, name: str, kind: str, domain: str) -> bpy.types.Attribute:
    """The attribute of a map. One of the same name that has another type or domain is replaced."""
    mesh = low.data
    attribute = mesh.attributes.get(name)
    if name in BUILT_IN or name in low.vertex_groups or (attribute is not None and attribute.data_type == UV_TYPE):
        name = PREFIX + name
        attribute = mesh.attributes.get(name)
    if attribute is not None and (attribute.data_type, attribute.domain) != (kind, domain):
        mesh.attributes.remove(attribute)
        attribute = None
    return attribute or mesh.attributes.new(name, kind, domain)
