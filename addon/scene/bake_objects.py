# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects of a bake: can they be baked, and how they are made ready for it and put back."""

import difflib
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from ..core.errors import BakeError
from . import detail_modifiers, instances, object_modes, visibility

MAX_CONDITION = 1e7
"""Matrices are in single precision: beyond this ratio of scales their shortest axis is no more than rounding."""

SUBDIVIDING = {"SUBSURF", "MULTIRES"}
"""Modifiers with levels, which smooth UVs as well."""


def named(name: str) -> bpy.types.Object:
    """The object of that name. Raises BakeError if there is none, with the names that are like it."""
    if name not in bpy.data.objects:
        close = difflib.get_close_matches(name, bpy.data.objects.keys(), n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(map(repr, close))}?" if close else f"it has {len(bpy.data.objects)} objects."
        raise BakeError(f"There is no object called {name!r} in the file: {hint}")
    return bpy.data.objects[name]


@dataclass(frozen=True)
class ObjectRef:
    """An object that may be renamed, or deleted and brought back, before it is asked for: a plain reference does not outlive
    that, and the name may be another's as well, whether linked or made later.

    uid: its session_uid; 0 for whichever object has the name. name: what it was called. library: of a linked object the
    library's whole path; from there it comes with another session_uid when the library is reloaded.
    """

    uid: int
    name: str
    library: str = ""

    def find(self) -> bpy.types.Object | None:
        """The object, or None if it was deleted."""
        found = bpy.data.objects.get(self.name)  # nearly always it, and then not all of them are looked at
        if found is None or self.uid not in {0, found.session_uid}:
            found = next((obj for obj in bpy.data.objects if obj.session_uid == self.uid), None)
        if found is None and self.library:
            found = next(
                (obj for obj in bpy.data.objects if obj.name == self.name and _library(obj) == self.library), None
            )
        return found

    def resolve(self) -> bpy.types.Object:
        """The object. Raises BakeError if it was deleted."""
        if not self.uid:
            return named(self.name)
        found = self.find()
        if found is None:
            raise BakeError(f"{self.name!r} was deleted: bring it back with Undo, or choose another object.")
        return found


def hold(obj: bpy.types.Object) -> ObjectRef:
    """A reference to `obj` that may be kept."""
    return ObjectRef(obj.session_uid, obj.name, _library(obj))


def _library(obj: bpy.types.Object) -> str:
    """The whole path of the library that `obj` is linked from; empty for one that is not."""
    return os.path.abspath(bpy.path.abspath(obj.library.filepath)) if obj.library else ""


def scene_of(uid: int) -> bpy.types.Scene | None:
    """The scene of that session_uid, or None if it was deleted."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


def problem(
    context: bpy.types.Context,
    low: bpy.types.Object | None,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None = None,
    method: str = "FLATTEN",
) -> str:
    """The first reason why these objects cannot be baked by `method`, as a sentence; empty when none shows.

    Cheap enough to be asked at every redraw: meshes are not evaluated.
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
        return f"{twice.name!r} is named twice as a high object: take it out once."
    if low in highs:
        if len(highs) > 1:
            return f"{low.name!r} is the low object and one of several high ones: take it out of the high ones."
        if not low.modifiers:
            return f"{low.name!r} is both high and low and has no modifiers: choose another high object, or add some."
        if not detail_modifiers.is_added(low):
            return f"{low.name!r} is both high and low, {detail_modifiers.without(low)}: choose another high object."
    for obj in (low, *highs, *([cage] if cage else [])):
        needs_uv = obj == low or (obj in highs and method == "FLATTEN")
        reason = _mesh_problem(obj, evaluated=low not in highs, needs_uv=needs_uv)
        if reason:
            return reason
    if cage is not None and method == "FLATTEN":
        return f"The cage {cage.name!r} is for rays: choose the method Cast or Auto, or take the cage out."
    return ""


def own_highs(low: bpy.types.Object | None) -> list[bpy.types.Object]:
    """The high objects of `low` where no others are named: itself, if it has modifiers that add detail."""
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
    # A linked object may share its name with a local one, and only one of them is found by it.
    if objects.get(obj.name) != obj and obj not in objects.values():
        if obj not in context.scene.collection.all_objects.values():
            return f"{obj.name!r} is not in scene {context.scene.name!r}: link it to one of its collections."
        return ""  # its collection is left out of the view layer: then the bake itself will see
    # The matrix of what is hidden is out of date: then the bake itself will see.
    return _matrix_problem(obj) if obj.visible_get(view_layer=context.view_layer) else ""


def may_be_high(obj: bpy.types.Object) -> bool:
    """Whether Blender may make a surface of `obj`, its own or by instances."""
    return instances.may_show(obj)


def shown_by(owners: Sequence[bpy.types.Object]) -> dict[int, set[int]]:
    """The session_uid of the objects that `owners` show by instances, each with those of the owners."""
    found: dict[int, set[int]] = {}
    for owner in owners:
        for obj in instances.sources(owner):
            found.setdefault(obj.session_uid, set()).add(owner.session_uid)
    return found


def _kind_problem(obj: bpy.types.Object, *, is_high: bool) -> str:
    for block in (obj, obj.data):  # Blender puts an empty object, or an empty mesh, in the place of what it misses
        if block and block.is_missing:
            file = block.library.filepath
            return (
                f"{obj.name!r} is linked from {file!r}, where it is not found: bring it back, or relocate the library."
            )
    if obj.type == "MESH" or (is_high and may_be_high(obj)):
        return ""
    kind = obj.bl_rna.properties["type"].enum_items[obj.type].name.lower()
    if not is_high:
        return f"{obj.name!r} is of the type {kind}, which cannot be baked onto: choose a mesh, or convert it to one."
    if obj.type == "EMPTY":
        return f"{obj.name!r} is an empty that instances no collection: choose a mesh, or give it a collection."
    return f"{obj.name!r} is of the type {kind}, which has no surface to read: choose a mesh, or convert it to one."


def _matrix_problem(obj: bpy.types.Object) -> str:
    matrix = np.array(obj.matrix_world)[:3, :3]
    if not np.isfinite(obj.matrix_world).all():
        return f"{obj.name!r} is nowhere: set anew its location, rotation and scale, which are NaN or infinite."
    if np.linalg.cond(matrix) > MAX_CONDITION:
        return f"{obj.name!r} is pressed flat: make its scale, and its parents', other than zero along every axis."
    return ""


def _mesh_problem(obj: bpy.types.Object, *, evaluated: bool, needs_uv: bool) -> str:
    # Modifiers may make faces and UV layers, instances stand for others, and in Edit Mode the mesh is out of date: then the
    # bake itself will see.
    if obj.type != "MESH" or obj.data.is_editmode or (evaluated and (obj.modifiers or instances.shows_more(obj))):
        return ""
    if not obj.data.polygons:
        return f"{obj.name!r} has no faces: choose a mesh that has some."
    if needs_uv and not obj.data.uv_layers:
        return f"{obj.name!r} has no UV layer: unwrap it first."
    return ""


@contextmanager
def ready(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    modifiers: str,
) -> Iterator[bpy.types.Depsgraph]:
    """In Object Mode, visible to the dependency graph, modifiers at the levels asked for; afterwards as before.

    Yields the evaluated dependency graph. Raises BakeError for an object that cannot be made visible.
    """
    objects = list(dict.fromkeys((low, *highs, *([cage] if cage else []))))
    with ExitStack() as restore:
        for obj in objects:
            visibility.reveal(context, obj, restore)
        read = [*objects, *_instanced(context, [high for high in highs if instances.shows_more(high)], objects)]
        object_modes.leave(context.view_layer, {obj.data for obj in read if obj.data}, restore)
        for obj in read:
            if obj.data and getattr(obj.data, "is_editmode", False):
                raise BakeError(f"The mesh of {obj.name!r} is in Edit Mode outside this view layer: leave it there.")
            if modifiers == "RENDER":
                _set_for_render(obj, restore)
        if low in highs:
            _keep_uvs(low, restore)
        yield _evaluated(context, objects)


@contextmanager
def instances_shown(context: bpy.types.Context, highs: Sequence[bpy.types.Object]) -> Iterator[bpy.types.Depsgraph]:
    """With the instances of `highs` to be seen; afterwards as before. Yields the evaluated dependency graph, which has what is
    hidden by the eye, but for its instances."""
    with ExitStack() as restore:
        for high in highs:
            if instances.shows_more(high) and high.hide_get():
                high.hide_set(False)
                restore.callback(high.hide_set, True)
        yield context.evaluated_depsgraph_get()


def _instanced(
    context: bpy.types.Context, owners: Sequence[bpy.types.Object], without: Sequence[bpy.types.Object]
) -> list[bpy.types.Object]:
    """The objects that `owners` show by instances, but for those in `without`."""
    if not owners:
        return []
    found = {
        obj.original.session_uid: obj.original
        for _, obj, _ in instances.shown(context.evaluated_depsgraph_get(), owners)
    }
    return [obj for obj in found.values() if obj not in without]


def _evaluated(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> bpy.types.Depsgraph:
    """The dependency graph, evaluated. Raises BakeError for an object of which it shows that it has no place in space."""
    depsgraph = context.evaluated_depsgraph_get()
    reason = next(filter(None, map(_matrix_problem, objects)), "")
    if reason:
        raise BakeError(reason)
    return depsgraph


def hides_detail(obj: bpy.types.Object) -> bool:
    """Whether Blender gives nobody the detail of `obj` for now: Sculpt Mode keeps that of Multires to itself."""
    return obj.mode == "SCULPT" and any(modifier.type == "MULTIRES" for modifier in obj.modifiers)


def holds_strokes(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    """Whether Blender keeps strokes on `obj` to itself until it is asked: those of Dyntopo, and those where Sculpt Mode shows
    deforming modifiers alone."""
    if obj.mode != "SCULPT":
        return False
    only_deforms = obj.modifiers and context.scene.tool_settings.sculpt.use_deform_only
    return bool(obj.use_dynamic_topology_sculpting or only_deforms)


def smooths_uvs(obj: bpy.types.Object) -> bool:
    """Whether a modifier of `obj` moves its UVs: a bake onto its own base keeps it from that."""
    return any(modifier.type in SUBDIVIDING and modifier.uv_smooth != "NONE" for modifier in obj.modifiers)


@contextmanager
def kept_uvs(context: bpy.types.Context, obj: bpy.types.Object) -> Iterator[bpy.types.Depsgraph]:
    """With no modifier of `obj` moving its UVs; afterwards as before. Yields the evaluated dependency graph."""
    with ExitStack() as restore:
        _keep_uvs(obj, restore)
        yield context.evaluated_depsgraph_get()


def _set_for_render(obj: bpy.types.Object, restore: ExitStack) -> None:
    for modifier in obj.modifiers:
        visibility.put(modifier, "show_viewport", modifier.show_render, restore)
        if modifier.type in SUBDIVIDING:
            visibility.put(modifier, "levels", modifier.render_levels, restore)


def _keep_uvs(obj: bpy.types.Object, restore: ExitStack) -> None:
    # Subdivision smooths UVs as well: the detail would be drawn beside the place where the base mesh looks for it.
    for modifier in obj.modifiers:
        if modifier.type in SUBDIVIDING:
            visibility.put(modifier, "uv_smooth", "NONE", restore)
