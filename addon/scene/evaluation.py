# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates objects for reading, and restores their state afterwards."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy

from ..core.declarations.choices import Modifiers
from ..core.errors import BakeError
from . import high_reader, object_checks, object_modes, visibility

SUBDIVIDING = {"SUBSURF", "MULTIRES"}
"""Modifier types that have levels and can smooth UVs."""


@contextmanager
def prepared(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    modifiers: str,
) -> Iterator[bpy.types.Depsgraph]:
    """Put the objects into Object Mode, visible, with modifiers as `modifiers` in Settings says, until the block ends.

    Yields the evaluated dependency graph. Raises BakeError for an object that cannot be made visible or has no valid transform.
    """
    objects = list(dict.fromkeys((low, *highs, *([cage] if cage else []))))
    with ExitStack() as restore:
        for obj in objects:
            visibility.reveal(context, obj, restore)
        read = [*objects, *_instanced(context, [high for high in highs if object_checks.shows_more(high)], objects)]
        object_modes.leave(context.view_layer, {obj.data for obj in read if obj.data}, restore)
        for obj in read:
            if obj.data and getattr(obj.data, "is_editmode", False):
                raise BakeError(f"The mesh of {obj.name!r} is in Edit Mode outside this view layer: leave it there.")
            if modifiers == Modifiers.RENDER:
                _set_for_render(obj, restore)
        if low in highs:
            _fix_uvs(low, restore)
        yield _evaluated(context, objects)


@contextmanager
def with_visible_instances(
    context: bpy.types.Context, highs: Sequence[bpy.types.Object]
) -> Iterator[bpy.types.Depsgraph]:
    """Make the instances of `highs` visible until the block ends. Yields the evaluated dependency graph.

    Blender evaluates objects that the eye icon hides, but not their instances.
    """
    with ExitStack() as restore:
        for high in highs:
            if object_checks.shows_more(high) and high.hide_get():
                high.hide_set(False)
                restore.callback(high.hide_set, True)
        yield context.evaluated_depsgraph_get()


def smooths_uvs(obj: bpy.types.Object) -> bool:
    """Whether a modifier of `obj` moves its UVs. Bakes onto its own base mesh prevent that."""
    return any(modifier.type in SUBDIVIDING and modifier.uv_smooth != "NONE" for modifier in obj.modifiers)


@contextmanager
def with_fixed_uvs(context: bpy.types.Context, obj: bpy.types.Object) -> Iterator[bpy.types.Depsgraph]:
    """Keep modifiers of `obj` from moving its UVs until the block ends. Yields the evaluated dependency graph."""
    with ExitStack() as restore:
        _fix_uvs(obj, restore)
        yield context.evaluated_depsgraph_get()


def _instanced(
    context: bpy.types.Context, owners: Sequence[bpy.types.Object], excluded: Sequence[bpy.types.Object]
) -> list[bpy.types.Object]:
    """The objects that `owners` show as instances, except those in `excluded`."""
    if not owners:
        return []
    found = {
        obj.original.session_uid: obj.original
        for _, obj, _ in high_reader.instances_shown(context.evaluated_depsgraph_get(), owners)
    }
    return [obj for obj in found.values() if obj not in excluded]


def _evaluated(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> bpy.types.Depsgraph:
    """The evaluated dependency graph. Raises BakeError for an object without a valid transform."""
    depsgraph = context.evaluated_depsgraph_get()
    reason = next(filter(None, map(object_checks.matrix_problem, objects)), "")
    if reason:
        raise BakeError(reason)
    return depsgraph


def _set_for_render(obj: bpy.types.Object, restore: ExitStack) -> None:
    for modifier in obj.modifiers:
        visibility.put(modifier, "show_viewport", modifier.show_render, restore)
        if modifier.type in SUBDIVIDING:
            visibility.put(modifier, "levels", modifier.render_levels, restore)


def _fix_uvs(obj: bpy.types.Object, restore: ExitStack) -> None:
    # Subdivision can move UVs. Then the detail would not be in its place in the UV layout of the base mesh.
    for modifier in obj.modifiers:
        if modifier.type in SUBDIVIDING:
            visibility.put(modifier, "uv_smooth", "NONE", restore)
