# SPDX-License-Identifier: GPL-3.0-or-later
"""Joins objects into the first one, unless that would lose or change anything but their names."""

from collections.abc import Iterable, Iterator, Sequence

import bpy
from bpy.types import Object

from .. import older_blender
from ..core.errors import BakeError, shorten_list
from ..scene import dependencies, evaluation, object_checks

NOT_COMPARED = {
    *("rna_type", "is_active", "persistent_uid", "execution_time", "show_expanded"),
    *("bakes", "panels", "node_warnings", "point_cache", "domain_settings"),
}
"""Properties of modifiers and of their parts that do not decide what they do, or hold what they have computed."""
_PARTS_DEEP = 5
"""How deep the parts of a modifier are nested at most: a point of a curve of a curve mapping is 3 below it."""
_NO_PART = bpy.types.Scene, bpy.types.Collection, bpy.types.WindowManager, bpy.types.WorkSpace, bpy.types.Screen
"""What may refer to an object without depending on where it is."""


def check(
    context: bpy.types.Context,
    lows: Sequence[Object],
    layers: Sequence[str],
    *,
    are_copied: bool = False,
    has_own_mesh: bool = False,
) -> None:
    """Raise BakeError if joining the objects would lose or change more than their names.

    Args:
        layers: The UV map of each, which the material reads.
        are_copied: Whether copies of them are joined, which nothing else refers to.
        has_own_mesh: Whether the first one gets a mesh of its own before.
    """
    if names := list(dict.fromkeys(layers))[1:]:
        raise BakeError(
            f"The maps are on UV maps of several names, {shorten_list(map(repr, [layers[0], *names]))}: give these one name to "
            "join the objects."
        )
    context.view_layer.update()
    first, *others = lows
    for low in others:
        if _modifiers(low) != _modifiers(first):
            raise BakeError(
                f"{low.name!r} has other modifiers than {first.name!r}, or other settings of them, and would lose them: apply "
                "them to join the objects."
            )
        if (low.matrix_world.determinant() < 0.0) != (first.matrix_world.determinant() < 0.0):
            raise BakeError(
                f"A negative scale mirrors either {low.name!r} or {first.name!r}, and joining would turn its faces over: apply "
                "the scale to join the objects."
            )
    if not are_copied:
        _check_others(first, others, has_own_mesh=has_own_mesh)


def _check_others(first: Object, going: Sequence[Object], *, has_own_mesh: bool) -> None:
    """Raise BakeError if other objects would change. going: those that are joined into `first`, and removed."""
    sharers = [] if has_own_mesh else object_checks.with_mesh_of(first, [first, *going])
    if sharers:
        raise BakeError(
            f"The mesh of {first.name!r} is also that of {_names(sharers)}, which would get all faces, too: turn Single User "
            "on, or join copies."
        )
    for low in going:
        if dependents := _dependents(low, going):
            verb = "depend" if dependents[1:] else "depends"
            raise BakeError(
                f"{_names(dependents)} {verb} on {low.name!r}, which would go, as children, constraints, modifiers or drivers "
                "do: clear that, or join copies."
            )


def _names(blocks: Iterable[bpy.types.ID]) -> str:
    return shorten_list(repr(each.name) for each in blocks)


def join(context: bpy.types.Context, lows: Sequence[Object]) -> None:
    """Join the objects, which are checked, into the first one."""
    with evaluation.in_object_mode(context, lows):
        for low in lows:
            evaluation.show_object(context, low)
        with context.temp_override(
            active_object=lows[0], object=lows[0], selected_objects=lows, selected_editable_objects=lows
        ):
            bpy.ops.object.join()


def _dependents(low: Object, going: Sequence[Object]) -> list[bpy.types.ID]:
    """The datablocks that would miss an object, without those that go with it. Imprint's own notes do not count."""
    found = []
    for user in bpy.data.user_map(subset=[low]).get(low, ()):
        if user in going or isinstance(user, _NO_PART):
            continue
        if isinstance(user, Object) and (object_checks.is_deleted(user) or low in dependencies.noted_by(user)):
            continue
        found.append(user)
    return sorted(found, key=lambda user: user.name)


def _modifiers(low: Object) -> list[tuple]:
    return [_settings(each, _PARTS_DEEP) for each in low.modifiers]


def _settings(part: bpy.types.bpy_struct, depth: int) -> tuple:
    """All settings of a modifier or of a part of it, in such a way that equal ones do the same."""
    names = [each.identifier for each in part.bl_rna.properties if each.identifier not in NOT_COMPARED]
    return tuple((name, _value(getattr(part, name), depth)) for name in names), *_inputs(part)


def _inputs(part: bpy.types.bpy_struct) -> Iterator[object]:
    """The values of the inputs of a modifier's nodes."""
    if isinstance(part, bpy.types.NodesModifier) and part.node_group is not None:
        for item in part.node_group.interface.items_tree:
            if item.item_type == "SOCKET" and item.in_out == "INPUT":
                yield _value(older_blender.modifier_input(part, item.identifier), 0)


def _value(value: object, depth: int) -> object:
    if isinstance(value, bpy.types.ParticleSystem):  # it holds all its particles
        value = value.settings
    if isinstance(value, bpy.types.ID):
        return value.session_uid
    if isinstance(value, bpy.types.bpy_struct):
        return _settings(value, depth - 1) if depth else None
    if hasattr(value, "__len__") and not isinstance(value, str | bytes | set):
        return tuple(_value(each, depth) for each in value)
    return value
