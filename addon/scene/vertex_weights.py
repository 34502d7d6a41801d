# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the weights of vertex groups."""

import difflib
from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter, methodcaller

import bmesh
import bpy
import numpy as np

from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.settings import Settings, TracingSettings

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


def write(obj: bpy.types.Object, name: str, values: np.ndarray) -> str:
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
    return replace(
        settings, **{name: "" for name in GROUPS if getattr(settings.tracing, name) not in obj.vertex_groups}
    )


def problem(obj: bpy.types.Object, settings: TracingSettings) -> str:
    """Why `obj` cannot be baked with the groups of `settings`, as a sentence; empty if no reason is known.

    Fast enough for every redraw: it evaluates no modifiers, which may add groups.
    """
    if settings.method == Method.FLATTEN or obj.modifiers:
        return ""
    names = filter(None, (getattr(settings, name) for name in GROUPS))
    return next((_missing(obj, name) for name in names if not _is_known(obj, name)), "")


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
        raise BakeError(_missing(obj, name))
    return None


def _missing(obj: bpy.types.Object, name: str) -> str:
    close = difflib.get_close_matches(name, obj.vertex_groups.keys(), n=1)
    hint = f"did you mean {close[0]!r}?" if close else "name one that it has, or none."
    return f"{obj.name!r} has no vertex group {name!r}: {hint}"
