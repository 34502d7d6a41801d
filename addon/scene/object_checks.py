# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks whether objects can be baked, without evaluating their meshes."""

from collections.abc import Sequence

import bpy
import numpy as np

from ..core.declarations.choices import Method
from ..core.errors import shorten_list
from . import detail_modifiers, instances

MAX_CONDITION = 1e7
"""The largest ratio of scales in a matrix. Beyond it, the shortest axis is only rounding, in single precision."""


def problem(
    context: bpy.types.Context,
    low: bpy.types.Object | None,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None = None,
    method: str = Method.FLATTEN,
) -> str:
    """The first reason why these objects cannot be baked by `method`, as a sentence; empty if no reason is known.

    Fast enough for every redraw: it does not evaluate meshes.
    """
    if low is None:
        return "No low object: select the high objects, then the low one, or fill the slots."
    if not highs:
        return _object_problem(context, low, is_high=False) or _no_high(low)
    for obj in (low, *highs, *([cage] if cage else [])):
        reason = _object_problem(context, obj, is_high=obj in highs and obj != low)
        if reason:
            return reason
    twice = next((obj for number, obj in enumerate(highs) if obj in highs[:number]), None)
    if twice is not None:
        return f"{twice.name!r} is twice in the high objects: remove it once."
    if low in highs:
        if len(highs) > 1:
            return (
                f"{low.name!r} is both the low object and one of several high objects: remove it from the high objects."
            )
        if not low.modifiers:
            return f"{low.name!r} is both high and low and has no modifiers: choose another high object, or add some."
        if not detail_modifiers.is_added(low):
            return f"{low.name!r} is both high and low, {detail_modifiers.without(low)}: choose another high object."
    for obj in (low, *highs, *([cage] if cage else [])):
        needs_uv = obj == low or (obj in highs and method == Method.FLATTEN)
        reason = _mesh_problem(obj, evaluated=low not in highs, needs_uv=needs_uv)
        if reason:
            return reason
    if cage is not None and method == Method.FLATTEN:
        return f"The cage {cage.name!r} is for rays: choose the method Cast or Auto, or remove the cage."
    return ""


def low_problem(context: bpy.types.Context, low: bpy.types.Object | None, *, is_own_base: bool = False) -> str:
    """As `problem`, for work on the low object alone. is_own_base: whether its mesh is read without modifiers."""
    if low is None:
        return "No low object: select it, or fill the slot."
    return _object_problem(context, low, is_high=False) or _mesh_problem(low, evaluated=not is_own_base, needs_uv=True)


SWAPPED = "{low} has more faces than {highs}. Are they swapped?"
"""A warning if `seem_swapped`. The panel translates it."""


def seem_swapped(low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> bool:
    """Whether high and low seem swapped. Counts no faces that modifiers and instances add: that needs an evaluation."""
    if low in highs or any(high.type != "MESH" or high.modifiers or high.mode == "SCULPT" for high in highs):
        return False
    return len(low.data.polygons) > sum(len(high.data.polygons) for high in highs)


def warnings(low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> list[str]:
    """Why the objects may be the wrong ones, in sentences."""
    names = {"low": repr(low.name), "highs": shorten_list(repr(high.name) for high in highs)}
    return [SWAPPED.format(**names)] if seem_swapped(low, highs) else []


def own_highs(low: bpy.types.Object | None) -> list[bpy.types.Object]:
    """The high objects of `low` if no others are chosen: itself, if it has modifiers that add detail."""
    return [low] if low is not None and detail_modifiers.is_added(low) else []


def _no_high(low: bpy.types.Object) -> str:
    if low.modifiers and not detail_modifiers.is_added(low):
        why = detail_modifiers.without(low)
        return f"No high object for {low.name!r}, {why}: select the high object too, {low.name!r} last."
    return f"No high object for {low.name!r}: select one as well, or give {low.name!r} modifiers that add detail."


def _object_problem(context: bpy.types.Context, obj: bpy.types.Object, *, is_high: bool) -> str:
    reason = _kind_problem(obj, is_high=is_high)
    if reason:
        return reason
    objects = context.view_layer.objects
    # A linked object may have the name of a local one, and a look-up by name finds only one of them.
    if objects.get(obj.name) != obj and obj not in objects.values():
        if obj not in context.scene.collection.all_objects.values():
            return f"{obj.name!r} is not in scene {context.scene.name!r}: link it to one of its collections."
        return ""  # its collection is excluded from the view layer; the bake checks it
    # The matrix of a hidden object is out of date; the bake checks it.
    return matrix_problem(obj) if obj.visible_get(view_layer=context.view_layer) else ""


def _kind_problem(obj: bpy.types.Object, *, is_high: bool) -> str:
    for block in (obj, obj.data):  # Blender replaces missing data with an empty object or mesh
        if block and block.is_missing:
            file = block.library.filepath
            return (
                f"{obj.name!r} is linked from {file!r}, but is not in that file: restore it, or relocate the library."
            )
    if obj.type == "MESH" or (is_high and instances.may_show(obj)):
        return ""
    kind = obj.bl_rna.properties["type"].enum_items[obj.type].name.lower()
    if not is_high:
        return f"{obj.name!r} is of the type {kind}, which cannot be baked onto: choose a mesh, or convert it to one."
    if obj.type == "EMPTY":
        return f"{obj.name!r} is an empty that instances no collection: choose a mesh, or give it a collection."
    return f"{obj.name!r} is of the type {kind}, which has no surface to read: choose a mesh, or convert it to one."


def matrix_problem(obj: bpy.types.Object) -> str:
    """Why the object's transform cannot be baked, as a sentence; empty if it can. The dependency graph must be up to date."""
    matrix = np.array(obj.matrix_world)[:3, :3]
    if not np.isfinite(obj.matrix_world).all():
        return f"{obj.name!r} has NaN or infinite values in its transform: reset its location, rotation and scale."
    if np.linalg.cond(matrix) > MAX_CONDITION:
        return f"{obj.name!r} has zero scale on an axis: change its scale, or its parents'."
    return ""


def _mesh_problem(obj: bpy.types.Object, *, evaluated: bool, needs_uv: bool) -> str:
    # Modifiers and instances may add faces and UV layers, and in Edit Mode the mesh is out of date. The bake checks these.
    if obj.type != "MESH" or obj.data.is_editmode or (evaluated and (obj.modifiers or instances.shows_more(obj))):
        return ""
    if not obj.data.polygons:
        return f"{obj.name!r} has no faces: choose a mesh that has some."
    if needs_uv and not obj.data.uv_layers:
        return f"{obj.name!r} has no UV layer: unwrap it first."
    return ""
