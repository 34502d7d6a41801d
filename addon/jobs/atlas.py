# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs the UV islands of several objects into one map, at one texel density, and later those of more objects beside them.

Each object gets a UV map of its own for it, and keeps its other ones.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy
import numpy as np

from ..audit import mip_gaps
from ..core.errors import BakeError, shorten_list
from ..core.settings import Settings
from ..mesh.triangles import face_areas
from ..scene import mesh_reader
from . import temporary
from .unwrapping import editing, pack_boxes

LAYER = "Atlas"
"""The UV map of each object."""
INSIDE = 1e-5
"""By how much packed UVs may be outside of the map."""


def pack(lows: Sequence[bpy.types.Object], settings: Settings, *, is_done_once: bool = False) -> str:
    """Give objects a UV map in which their islands, as their active UV maps have them, lie side by side.

    Objects that have it already keep their places, if there are others. is_done_once: whether they also do if there are none.
    Returns a sentence. Raises BakeError, and then nothing has changed.
    """
    _check(lows)
    staying = [low for low in lows if LAYER in low.data.uv_layers]
    coming = [low for low in lows if low not in staying]
    if not coming and not is_done_once:
        staying, coming = [], list(lows)
    margin = mip_gaps.needed(settings.sampling) / 2.0 / min(settings.sampling.size)
    uv = [] if not coming else _beside(staying, coming, margin) if staying else _packed(coming, margin)
    for low, coordinates in zip(coming, uv, strict=True):
        layers = low.data.uv_layers
        layer = layers[LAYER] if LAYER in layers else layers.new(name=LAYER, do_init=False)
        layer.uv.foreach_set("vector", np.ascontiguousarray(coordinates, np.float32).reshape(-1))
    for low in lows:
        low.data.uv_layers.active = low.data.uv_layers[LAYER]
        low.data.update()
    kept = f", beside {len(staying):,} that kept their places" if staying and coming else ""
    names = shorten_list(repr(low.name) for low in coming or lows)
    return f"{names} have the UV map {LAYER!r}{kept}: {_areas(lows)[1]:.0%} of the map used"


def _check(lows: Sequence[bpy.types.Object]) -> None:
    for low in lows:
        if low.mode != "OBJECT":
            raise BakeError(f"{low.name!r} is not in Object Mode: go there first.")
        if low.type != "MESH" or not low.data.polygons:
            raise BakeError(f"{low.name!r} has no faces: leave it out.")
        if not low.data.uv_layers:
            raise BakeError(f"{low.name!r} has no UV map: unwrap it first.")
        if low.data.library is not None:
            raise BakeError(f"{low.name!r} is linked from another file: pack it there, or make it local.")
        if low.data.users > 1:
            raise BakeError(f"{low.name!r} shares its mesh with other objects: make it a single user.")
        if LAYER not in low.data.uv_layers and len(low.data.uv_layers) == MOST:
            raise BakeError(f"{low.name!r} has as many UV maps as a mesh can have: remove one.")
        if 0.0 in _areas([low]):
            raise BakeError(f"The UV map {_layer(low)!r} of {low.name!r} has no area: unwrap it anew.")


MOST = 8
"""UV maps of a mesh, in Blender."""


def _packed(lows: Sequence[bpy.types.Object], margin: float) -> list[np.ndarray]:
    """The UVs of each, packed anew as large as they fit."""
    with _joined(lows) as obj:
        with editing(obj):
            bpy.ops.uv.average_islands_scale()
            pack_boxes(margin)
        return _split(obj, lows)


def _beside(staying: Sequence[bpy.types.Object], coming: Sequence[bpy.types.Object], margin: float) -> list[np.ndarray]:
    """The UVs of those that come, as large as those that stay, between their islands."""
    with _joined(coming) as obj:
        with editing(obj):
            bpy.ops.uv.average_islands_scale()
        uv = mesh_reader.uvs(obj.data, LAYER)
        surface, used = _areas([obj])
    kept_surface, kept_used = _areas(staying)
    uv *= np.sqrt(kept_used / kept_surface / (used / surface))
    with _joined([*staying, *coming]) as obj:
        coordinates = mesh_reader.uvs(obj.data, LAYER)
        coordinates[-len(uv) :] = uv
        obj.data.uv_layers[LAYER].uv.foreach_set("vector", coordinates.reshape(-1))
        pins = obj.data.attributes.new(f".pn.{LAYER}", "BOOLEAN", "CORNER")
        pins.data.foreach_set("value", np.arange(len(coordinates)) < len(coordinates) - len(uv))
        with editing(obj):
            bpy.ops.uv.pack_islands(
                rotate=True, scale=False, margin_method="FRACTION", margin=margin, shape_method="CONCAVE",
                merge_overlap=False, pin=True, pin_method="LOCKED",
            )  # fmt: skip
        uv = _split(obj, [*staying, *coming])[len(staying) :]
    outside = [low.name for low, of in zip(coming, uv, strict=True) if of.min() < -INSIDE or of.max() > 1.0 + INSIDE]
    if outside:
        raise BakeError(
            f"{shorten_list(map(repr, outside))} do not fit between the islands of the UV map {LAYER!r}: remove it from all of "
            "them, and pack them together."
        )
    return uv


@contextmanager
def _joined(lows: Sequence[bpy.types.Object]) -> Iterator[bpy.types.Object]:
    """One object of the own meshes of `lows`, in their order and as large as the objects make them, with the UV map LAYER."""
    with temporary.scene() as scene:
        copies: list[bpy.types.Object] = []
        for low in lows:
            data = low.data.copy()
            data.transform(low.matrix_world.to_3x3().to_4x4())
            layers = data.uv_layers
            kept = _layer(low)
            for name in [layer.name for layer in layers if layer.name != kept]:
                layers.remove(layers[name])
            layers[kept].name = LAYER
            copies.append(temporary.add_object(scene, data))
        first = copies[0]
        context = {"active_object": first, "object": first, "selected_objects": copies}
        with bpy.context.temp_override(
            scene=scene, view_layer=scene.view_layers[0], selected_editable_objects=copies, **context
        ):
            if len(copies) > 1:
                meshes = [copy.data for copy in copies[1:]]
                bpy.ops.object.join()
                bpy.data.batch_remove(meshes)
        yield first


def _split(obj: bpy.types.Object, lows: Sequence[bpy.types.Object]) -> list[np.ndarray]:
    """The UVs of each of the joined objects."""
    return np.split(mesh_reader.uvs(obj.data, LAYER), np.cumsum([len(low.data.loops) for low in lows])[:-1])


def _layer(low: bpy.types.Object) -> str:
    """The UV map whose islands are packed."""
    return LAYER if LAYER in low.data.uv_layers else mesh_reader.active_uv_layer(low.data)


def _areas(lows: Sequence[bpy.types.Object]) -> tuple[float, float]:
    """The area of the surface of objects, in the world, and of their triangles in their UV maps that are packed."""
    surface = used = 0.0
    for low in lows:
        mesh = mesh_reader.surface(low.data, _layer(low), low.name, np.array(low.matrix_world, np.float64))
        corners = mesh.positions[mesh.vertices[mesh.triangles]] @ np.array(low.matrix_world, np.float64)[:3, :3].T
        surface += face_areas(corners).sum()
        edges = (mesh.uv[mesh.triangles][:, 1:] - mesh.uv[mesh.triangles][:, :1]).astype(np.float64)
        used += 0.5 * np.abs(np.linalg.det(edges)).sum()
    return float(surface), float(used)
