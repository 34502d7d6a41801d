# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects of a bake: can they be baked, and how they are made ready for it and put back."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from .errors import BakeError


def problem(context: bpy.types.Context, low: bpy.types.Object | None, highs: Sequence[bpy.types.Object]) -> str:
    """The first reason why these objects cannot be baked, as a sentence; empty when none shows.

    Cheap enough to be asked at every redraw: meshes are not evaluated.
    """
    if low is None:
        return "No low object: select the high objects, then the low one, or fill the slots."
    if not highs:
        return f"No high object for {low.name!r}: select one as well, or give {low.name!r} modifiers that add detail."
    for obj in (low, *highs):
        reason = _object_problem(context, obj)
        if reason:
            return reason
    if len({obj.name_full for obj in highs}) < len(highs):
        return "A high object is named twice."
    if low in highs:
        if len(highs) > 1:
            return f"{low.name!r} is the low object and one of several high ones: take it out of the high ones."
        if not low.modifiers:
            return f"{low.name!r} is both high and low and has no modifiers: there is no detail to bake."
    if low.mode != "EDIT" and not low.data.uv_layers:
        return f"{low.name!r} has no UV layer: unwrap it first."
    return ""


def _object_problem(context: bpy.types.Context, obj: bpy.types.Object) -> str:
    if obj.type != "MESH":
        return f"{obj.name!r} is not a mesh but a {obj.type.lower().replace('_', ' ')}."
    # `find` and not `in`: linked objects may share a name with local ones.
    if context.view_layer.objects.get((obj.name, obj.library.filepath) if obj.library else obj.name) != obj:
        return (
            f"{obj.name!r} is not in view layer {context.view_layer.name!r}: its collection is excluded or not linked."
        )
    if (
        np.linalg.matrix_rank(np.array(obj.matrix_world)[:3, :3], tol=0.0) < 3
        or not np.isfinite(obj.matrix_world).all()
    ):
        return f"{obj.name!r} has no volume to bake: its scale is zero along an axis."
    return ""


@contextmanager
def ready(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object], modifiers: str
) -> Iterator[bpy.types.Depsgraph]:
    """In Object Mode, visible to the dependency graph, modifiers at the levels asked for; afterwards as before.

    Yields the evaluated dependency graph. Raises BakeError for an object that cannot be made visible.
    """
    objects = list(dict.fromkeys((low, *highs)))
    with ExitStack() as restore:
        for obj in objects:
            if obj.mode != "OBJECT":
                _leave_mode(context, obj, restore)
        for obj in objects:
            _reveal(context, obj, restore)
            if modifiers == "RENDER":
                _set_for_render(obj, restore)
        if low in highs:
            _keep_uvs(low, restore)
        yield context.evaluated_depsgraph_get()


def _set(owner, name: str, value, restore: ExitStack) -> None:
    """Set a property if it differs, and put it back when the bake is done: an unchanged one costs no evaluation."""
    before = getattr(owner, name)
    if before != value:
        setattr(owner, name, value)
        restore.callback(setattr, owner, name, before)


def _leave_mode(context: bpy.types.Context, obj: bpy.types.Object, restore: ExitStack) -> None:
    # The mesh of an object in Edit Mode or Sculpt Mode lags behind what is on screen until the mode is left.
    mode = obj.mode

    def switch(to: str) -> None:
        with context.temp_override(
            object=obj, active_object=obj, selected_objects=[obj], selected_editable_objects=[obj]
        ):
            bpy.ops.object.mode_set(mode=to)

    switch("OBJECT")
    restore.callback(switch, mode)


def _reveal(context: bpy.types.Context, obj: bpy.types.Object, restore: ExitStack) -> None:
    if obj.visible_get():
        return
    _set(obj, "hide_viewport", False, restore)
    if obj.hide_get():
        obj.hide_set(False)
        restore.callback(obj.hide_set, True)
    context.view_layer.update()
    if not obj.visible_get():
        raise BakeError(
            f"{obj.name!r} is in a hidden collection: show the collection, so that the object is evaluated."
        )


def _set_for_render(obj: bpy.types.Object, restore: ExitStack) -> None:
    for modifier in obj.modifiers:
        _set(modifier, "show_viewport", modifier.show_render, restore)
        if modifier.type in {"SUBSURF", "MULTIRES"}:
            _set(modifier, "levels", modifier.render_levels, restore)


def _keep_uvs(obj: bpy.types.Object, restore: ExitStack) -> None:
    # Subdivision smooths UVs as well: the detail would be drawn beside the place where the base mesh looks for it.
    for modifier in obj.modifiers:
        if modifier.type in {"SUBSURF", "MULTIRES"}:
            _set(modifier, "uv_smooth", "NONE", restore)
