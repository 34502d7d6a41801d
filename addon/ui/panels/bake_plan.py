# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about the Bake button: what it will do, or why it cannot."""

import bpy

from ...core.declarations.values import Method
from ...core.errors import BakeError
from ...output import image_writer
from ...scene import object_checks
from ..properties import ImprintSettings


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
    source = "its own modifiers" if low in highs else ", ".join(repr(high.name) for high in highs)
    name = image_writer.name_for(low.name, settings.to_settings())
    known = "over the image" if bpy.data.images.get(name) else "into a new image"
    other = image_writer.replaced(name, [high.name for high in highs])
    over = f", which holds a map of {other}" if other else ""
    how = {"AUTO": "Bakes", "FLATTEN": "Flattens", "CAST": "Casts rays from"}[settings.method]
    onto = f"{low.name!r} to {source}" if settings.method == Method.CAST else f"{source} onto {low.name!r}"
    lines = [
        f"{how} {onto}: {settings.space.lower()} space, {settings.width} x {settings.height}, {known} {name!r}{over}."
    ]
    if _is_swapped(low, highs):
        lines.append(f"{low.name!r} has more faces than {source}: the low object is the active one, selected last.")
    return lines


def _is_swapped(low: bpy.types.Object, highs: list[bpy.types.Object]) -> bool:
    """Whether high and low seem swapped. Faces that modifiers and instances add are not known without evaluating them."""
    if low in highs or any(high.type != "MESH" or high.modifiers or high.mode == "SCULPT" for high in highs):
        return False
    return len(low.data.polygons) > sum(len(high.data.polygons) for high in highs)
