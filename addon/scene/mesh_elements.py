# SPDX-License-Identifier: GPL-3.0-or-later
"""Elements of meshes: which belong together, their attributes, UV layers and tangents by face corner, and painted weights."""

import difflib
from collections.abc import Sequence
from operator import itemgetter, methodcaller

import bmesh
import bpy
import numpy as np

from ..core import foreach
from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.settings import Settings, TracingSettings
from . import mesh_reader
from .mesh_reader import corner_vertices


def edges(data: bpy.types.Mesh, ends: np.ndarray) -> np.ndarray:
    """The edges (N,) int of `data` between these pairs of vertices (N, 2), unordered. Pairs without an edge are left out."""
    pairs = foreach.read(data.edges, "vertices", 2)
    keys, end_keys = (
        values.min(axis=1).astype(np.int64) * len(data.vertices) + values.max(axis=1) for values in (pairs, ends)
    )
    return np.flatnonzero(np.isin(keys, end_keys))


def elements(data: bpy.types.Mesh, chosen: np.ndarray, domain: str = "FACE") -> dict[str, np.ndarray]:
    """The indices of the "polygons", "edges" and "vertices" of the `chosen` faces of `data`, or edges for the domain "EDGE"."""
    if domain == "EDGE":
        ends = foreach.read(data.edges, "vertices", 2)[chosen]
        return {"polygons": chosen[:0], "edges": chosen, "vertices": ends.reshape(-1)}
    corners = face_corners(data, chosen)
    return {"polygons": chosen, "edges": corner_edges(data)[corners], "vertices": corner_vertices(data)[corners]}


def face_corners(data: bpy.types.Mesh, chosen: np.ndarray) -> np.ndarray:
    """The corners (N,) int of the `chosen` faces of `data`, face by face."""
    starts, totals = _face_spans(data)
    totals = totals[chosen]
    within = np.arange(totals.sum()) - np.repeat(np.cumsum(totals) - totals, totals)
    return np.repeat(starts[chosen], totals) + within


def next_corners(data: bpy.types.Mesh) -> np.ndarray:
    """The corner that follows each corner in its face, (C,) int."""
    starts, totals = _face_spans(data)
    following = np.arange(1, len(data.loops) + 1)
    following[starts + totals - 1] = starts
    return following


def corner_edges(data: bpy.types.Mesh) -> np.ndarray:
    """The edge from each corner to the next one in its face, (C,) int32."""
    return foreach.read(data.attributes[".corner_edge"].data, "value")


def _face_spans(data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The first corner of each face and their number, (F,) int32 each."""
    starts, totals = (foreach.read(data.polygons, name) for name in ("loop_start", "loop_total"))
    return starts, totals


_COMPONENTS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "INT8": ("value", 1),
    "BOOLEAN": ("value", 1),
    "FLOAT2": ("vector", 2),
    "INT16_2D": ("value", 2),
    "INT32_2D": ("value", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
    "QUATERNION": ("value", 4),
}
"""By Blender's type of attributes: the property of its elements, and the number of its components."""
_DTYPES = {"INT": np.int32, "INT8": np.int32, "INT16_2D": np.int32, "INT32_2D": np.int32, "BOOLEAN": bool}


def attribute_by_corner(data: bpy.types.Mesh, name: str) -> np.ndarray | None:
    """The values of an attribute of any domain, (C, 4) float32, by corner of `data`; None if it has none of numbers.

    name: of an attribute or a UV layer; empty for the color attribute that Blender renders. A number fills three components,
    vectors leave the rest 0, and the last is 1 unless the attribute has it. Colors are linear, bytes too. A corner takes the
    mean of the two edges at it.
    """
    attribute = data.attributes.get(name or data.attributes.default_color_name or "")
    if attribute is None or attribute.data_type not in _COMPONENTS:
        return None
    values = _attribute_values(attribute)
    if len(values) != data.attributes.domain_size(attribute.domain):  # a mesh in Edit Mode
        return None
    width = values.shape[1]
    full = np.zeros((len(values), 4), np.float32)
    full[:, : width if width > 1 else 3] = values
    if width < 4:
        full[:, 3] = 1.0
    return _by_corner(data, attribute.domain, full)


def uv_by_corner(data: bpy.types.Mesh, layer: str) -> np.ndarray | None:
    """The coordinates of a UV layer, (C, 2) float32, by corner; None if `data` lacks it.

    layer: empty for the one that Blender renders. An attribute of another kind counts too, as in the Attribute node.
    """
    name = layer or render_layer(data)
    if name in data.uv_layers and len(data.uv_layers[name].uv) == len(data.loops):
        return _attribute_values(data.attributes[name])
    values = attribute_by_corner(data, name) if name else None
    return None if values is None else np.ascontiguousarray(values[:, :2])


_DEFORMING = {
    *("ARMATURE", "CAST", "CORRECTIVE_SMOOTH", "CURVE", "DISPLACE", "HOOK", "LAPLACIANDEFORM", "LAPLACIANSMOOTH"),
    *(
        "LATTICE",
        "MESH_DEFORM",
        "SHRINKWRAP",
        "SIMPLE_DEFORM",
        "SMOOTH",
        "SURFACE_DEFORM",
        "VOLUME_DISPLACE",
        "WARP",
        "WAVE",
    ),
}
_ADDING = {"ARRAY", "BEVEL", "DECIMATE", "EDGE_SPLIT", "MIRROR", "MULTIRES", "SOLIDIFY", "SUBSURF", "TRIANGULATE"}
"""Modifiers that move generated coordinates with the surface. Those of others stay where the vertices were before."""
_NEITHER = {"WEIGHTED_NORMAL", "NORMAL_EDIT", "UV_PROJECT", "UV_WARP", "DATA_TRANSFER", "VERTEX_WEIGHT_EDIT"}


def generated_by_corner(obj: bpy.types.Object, data: bpy.types.Mesh, *, for_render: bool) -> np.ndarray | None:
    """The generated texture coordinates (C, 3) float32, by corner of `data`, the evaluated mesh of the original `obj`.

    They are those before deformation, in the texture space of the object's own mesh. None where Blender does not tell them.
    for_render: whether `data` has the modifiers that renders see.
    """
    if obj.type != "MESH":
        return None
    used = (modifier for modifier in obj.modifiers if (modifier.show_render if for_render else modifier.show_viewport))
    kinds = {modifier.type for modifier in used} - _NEITHER
    is_deformed = bool(kinds & _DEFORMING) or obj.data.shape_keys is not None
    if not kinds <= _DEFORMING | _ADDING or (is_deformed and kinds & _ADDING):
        return None
    if is_deformed and len(obj.data.vertices) != len(data.vertices):
        return None
    points = mesh_reader.points(obj.data if is_deformed else data)
    middle, half = (np.array(values, np.float32) for values in (obj.data.texspace_location, obj.data.texspace_size))
    half[half == 0.0] = 1.0
    return (((points - middle) / half + 1.0) * np.float32(0.5))[corner_vertices(data)]


def render_layer(data: bpy.types.Mesh) -> str:
    """The name of the UV layer that Blender renders, or "" if there is none."""
    return next((layer.name for layer in data.uv_layers if layer.active_render), "")


def tangents_by_corner(data: bpy.types.Mesh, layer: str) -> np.ndarray | None:
    """MikkTSpace tangents of a UV layer by corner, (C, 4) float32, w the sign of the bitangent; None if `data` lacks it.

    layer: empty for the one rendered. Raises nothing for n-gons: their tangents come from their triangles, which share them.
    """
    name = layer or render_layer(data)
    if name not in data.uv_layers or not data.polygons:
        return None
    mesh = mesh_reader.with_tangents(data, name, "", np.eye(4))
    if len(mesh.tangents) == len(data.loops):
        return mesh.tangents
    tangents = np.zeros((len(data.loops), 4), np.float32)
    tangents[mesh_reader.triangles(data).reshape(-1)] = mesh.tangents
    return tangents


def _attribute_values(attribute: bpy.types.Attribute) -> np.ndarray:
    """The values of the elements, (N, components)."""
    name, width = _COMPONENTS[attribute.data_type]
    return foreach.read(attribute.data, name, width, _DTYPES.get(attribute.data_type, np.float32))


def _by_corner(data: bpy.types.Mesh, domain: str, values: np.ndarray) -> np.ndarray:
    """Values of the elements of a domain, by corner."""
    corners = len(data.loops)
    match domain:
        case "CORNER":
            return values
        case "POINT":
            return values[corner_vertices(data)]
        case "FACE":
            return np.repeat(values, np.diff(_offsets(data)), axis=0)
        case "EDGE":
            edges = values[corner_edges(data)]
            before = np.arange(corners) - 1
            offsets = _offsets(data)
            before[offsets[:-1]] = offsets[1:] - 1
            return 0.5 * (edges + edges[before])
    raise ValueError(domain)


def _offsets(data: bpy.types.Mesh) -> np.ndarray:
    """Where the corners of each face begin, and where the last ends: (F + 1,)."""
    return np.concatenate(([0], np.cumsum(foreach.read(data.polygons, "loop_total"))))


GROUPS = ("offset_group", "straight_group")
"""The settings that name a vertex group."""
UNPAINTED = 0.5
"""The weight of vertices outside the group. It changes nothing."""


def weights(
    obj: bpy.types.Object, data: bpy.types.Mesh, names: Sequence[str], *, outside: float = UNPAINTED
) -> list[np.ndarray | None]:
    """The weights (V,) float32 in the groups `names` of the vertices of `data`, 0 to 1.

    None for an empty name, and for a group that only other objects have: the settings name groups for all low objects.

    obj: the owner of `data`: an evaluated object, or the object itself for its own mesh. outside: the value for vertices that
    are not in the group. Raises BakeError for a group that no object has.
    """
    numbers = [_number(obj, name) if name else None for name in names]
    if all(number is None for number in numbers):
        return [None] * len(numbers)
    # Weights cannot be read as whole arrays. Of all ways that leave the scene as it is, this is the fastest one.
    copy = bmesh.new(use_operators=False)
    try:
        copy.from_mesh(data, face_normals=False, vertex_normals=False)
        layer = copy.verts.layers.deform.active
        # A mesh on which no vertex was ever painted has no layer.
        by_vertex = [{}] * len(copy.verts) if layer is None else list(map(itemgetter(layer), copy.verts))
        return [
            None
            if number is None
            else np.fromiter(map(methodcaller("get", number, outside), by_vertex), np.float32, len(by_vertex))
            for number in numbers
        ]
    finally:
        copy.free()


def write_weights(obj: bpy.types.Object, name: str, values: np.ndarray) -> str:
    """Give the vertices of the mesh of `obj` the weights `values` (V,) float32 in the group `name`. Creates a missing group.

    Returns the group's name, in which Blender may have cut or numbered `name`. `obj` must not be in Edit Mode.
    """
    group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
    # All vertices join the group: a brush raises the weights of others from 0, which is not neutral.
    (present,) = weights(obj, obj.data, [group.name], outside=-1.0)
    is_changed = present != values
    for value in np.unique(values[is_changed]):
        group.add(np.flatnonzero(is_changed & (values == value)).tolist(), float(value), "REPLACE")
    return group.name


def without_missing(obj: bpy.types.Object, settings: Settings) -> Settings:
    """`settings` without the groups that `obj` does not have."""
    return settings.traced(**{name: "" for name in GROUPS if getattr(settings.tracing, name) not in obj.vertex_groups})


def weights_problem(obj: bpy.types.Object, tracing: TracingSettings) -> str:
    """Why `obj` cannot be baked with the groups of `tracing`, as a sentence; empty if no reason is known.

    Fast enough for every redraw: it evaluates no modifiers, which may add groups.
    """
    if tracing.method == Method.FLATTEN or obj.modifiers:
        return ""
    names = filter(None, (getattr(tracing, name) for name in GROUPS))
    return next((missing_group(obj, name) for name in names if not _is_known(obj, name)), "")


def _is_known(obj: bpy.types.Object, name: str) -> bool:
    """Whether `obj` or another object has a vertex group of this name."""
    return name in obj.vertex_groups or any(name in other.vertex_groups for other in bpy.data.objects)


def _number(obj: bpy.types.Object, name: str) -> int | None:
    """The number of the vertex group `name`. Modifiers may have removed it, or given it another number.

    None for a group that only other objects have.
    """
    own = obj.original
    # Blender evaluates nothing for a new group, so without modifiers the object's own list is the current one.
    group = (obj if own.modifiers else own).vertex_groups.get(name)
    if group is not None:
        return group.index
    if name in own.vertex_groups:
        raise BakeError(
            f"The modifiers of {obj.name!r} remove its vertex group {name!r}: change them, or name no group."
        )
    if not _is_known(own, name):
        raise BakeError(missing_group(obj, name))
    return None


def missing_group(obj: bpy.types.Object, name: str) -> str:
    """That an object has no vertex group of this name, as a sentence."""
    close = difflib.get_close_matches(name, obj.vertex_groups.keys(), n=1)
    hint = f"did you mean {close[0]!r}?" if close else "name one that it has, or none."
    return f"{obj.name!r} has no vertex group {name!r}: {hint}"


BUILT_IN = {
    "position",
    "material_index",
    "sharp_face",
    "sharp_edge",
    "custom_normal",
    "id",
    "crease_vert",
    "crease_edge",
} | {
    *("bevel_weight_vert", "bevel_weight_edge", "freestyle_edge", "freestyle_face", "velocity"),
}
"""Attributes that Blender itself uses."""


def own_attributes(obj: bpy.types.Object) -> list[str]:
    """The names of the attributes of a mesh object that may be meant as a map: numbers by vertex, corner or face."""
    if obj.type != "MESH":
        return []
    layers = {layer.name for layer in obj.data.uv_layers} | BUILT_IN
    return [
        each.name
        for each in obj.data.attributes
        if each.domain != "EDGE"
        and each.data_type in {"FLOAT", "INT", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR"}
        and not each.name.startswith(".")
        and each.name not in layers
    ]
