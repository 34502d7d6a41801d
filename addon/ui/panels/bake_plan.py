# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about the Bake button: what it will do, or why it cannot."""

import bpy

from ...core.declarations.choices import Method, Space
from ...core.errors import BakeError
from ...output import map_names, map_storage
from ...scene import object_checks
from ..properties import ImprintSettings
from ..translations.lookup import message


def problem(
    context: bpy.types.Context,
    low: bpy.types.Object | None,
    highs: list[bpy.types.Object],
    settings: ImprintSettings,
) -> str:
    """Why the button cannot bake, in a sentence; empty if no problem is visible."""
    try:
        settings.to_settings().check()
    except BakeError as error:
        return str(error)
    return object_checks.problem(context, low, highs, settings.cage_for(settings.method), settings.method)


def lines(low: bpy.types.Object, highs: list[bpy.types.Object], settings: ImprintSettings) -> list[str]:
    """What the button will do, in sentences."""
    action = {
        Method.AUTO: message("Bakes {highs} onto {low}"),
        Method.FLATTEN: message("Flattens {highs} onto {low}"),
        Method.CAST: message("Casts rays from {low} to {highs}"),
    }[settings.method]
    space = {
        Space.TANGENT: message("tangent space"),
        Space.OBJECT: message("object space"),
        Space.WORLD: message("world space"),
    }[settings.space]
    objects = {
        "low": repr(low.name),
        "highs": message("its own modifiers") if low in highs else ", ".join(repr(high.name) for high in highs),
    }
    name = map_names.name_for(low.name, settings.to_settings())
    target = message("over the image {}") if bpy.data.images.get(name) else message("into a new image {}")
    parts = [
        space,
        f"{settings.width} x {settings.height}",
        target.format(repr(name)),
    ]
    other = map_storage.replaced(name, [high.name for high in highs])
    if other:
        parts.append(message("which holds a map of {}").format(other))
    lines = [f"{action.format(**objects)}: {', '.join(parts)}."]
    if _is_swapped(low, highs):
        text = message("{low} has more faces than {highs}: the low object is the active one, selected last.")
        lines.append(text.format(**objects))
    return lines


def _is_swapped(low: bpy.types.Object, highs: list[bpy.types.Object]) -> bool:
    """Whether high and low seem swapped. Counts no faces that modifiers and instances add: that needs an evaluation."""
    if low in highs or any(high.type != "MESH" or high.modifiers or high.mode == "SCULPT" for high in highs):
        return False
    return len(low.data.polygons) > sum(len(high.data.polygons) for high in highs)
