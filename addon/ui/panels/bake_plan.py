# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about the Bake button: what it will do, or why it cannot."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import bpy

from ...core.declarations.choices import Method, Space
from ...core.errors import BakeError, shorten_list
from ...core.settings import Settings
from ...jobs import bake_jobs
from ...jobs.job import Job
from ...jobs.texture_sets import by_material
from ...output import datablocks, map_names, map_storage, materials
from ...output.files import planned_files
from ...scene import object_checks, vertex_weights
from .. import object_pairs
from ..properties import ImprintSettings
from ..translations import message


def problem(
    context: bpy.types.Context,
    low: bpy.types.Object | None,
    highs: list[bpy.types.Object],
    settings: ImprintSettings,
) -> str:
    """Why the button cannot bake, in a sentence; empty if no problem is visible."""
    values = settings.settings_for(low, highs)
    try:
        values.check()
    except BakeError as error:
        return str(error)
    missing = settings.missing(context, low, highs)
    reason = message(object_pairs.MISSING).format(repr(missing[0])) if missing else ""
    if not reason and low is not None and not highs and (waiting := settings.hidden(context, low, highs)):
        reason = hidden(waiting)
    reason = reason or object_checks.problem(context, low, highs, settings.cage_of(low, highs), values.method)
    return reason or _material_problem(low, values) or vertex_weights.problem(low, values) or _clash(low, settings)


def _material_problem(low: bpy.types.Object, values: Settings) -> str:
    """Why the maps cannot be put into the materials of `low`; empty if they can, or are not."""
    try:
        if values.changes_materials:
            materials.check(low, can_be_off=not values.connect_maps)
    except BakeError as error:
        return str(error)
    return ""


def _clash(low: bpy.types.Object, settings: ImprintSettings) -> str:
    """Why texture sets cannot have the names of the settings; empty if they can."""
    try:
        _filled(low, settings)
    except BakeError as error:
        return str(error)
    return ""


def hidden(objects: Sequence[bpy.types.Object]) -> str:
    """That these objects are hidden, in a sentence."""
    text = message("{} is hidden.") if len(objects) == 1 else message("{} are hidden.")
    return text.format(shorten_list(repr(obj.name) for obj in objects))


def is_normal_only(settings: ImprintSettings) -> bool:
    """Whether the button bakes the normal map and no other map."""
    return settings.normal and not settings.to_settings().drawn_maps


def plan(low: bpy.types.Object, highs: list[bpy.types.Object], settings: ImprintSettings) -> str:
    """What the button will do, in a sentence."""
    action = {
        Method.AUTO: message("Bakes {highs} onto {low}"),
        Method.FLATTEN: message("Flattens {highs} onto {low}"),
        Method.CAST: message("Casts rays from {low} to {highs}"),
    }[settings.rays_of(low, highs).method]
    space = {
        Space.TANGENT: message("tangent space"),
        Space.OBJECT: message("object space"),
        Space.WORLD: message("world space"),
    }[settings.space]
    objects = {
        "low": repr(low.name),
        "highs": message("its own modifiers") if low in highs else ", ".join(repr(high.name) for high in highs),
    }
    first = images(low, settings)[0]
    target = message("over the image {}") if datablocks.get(first.name) else message("into a new image {}")
    parts = [
        space,
        f"{settings.width} x {settings.height}",
        target.format(repr(first.name)),
    ]
    replaced = map_storage.replaced(first.name, [high.name for high in highs])
    if replaced:
        parts.append(message("which holds a map of {}").format(replaced))
    if first.file:
        parts.append(message("to the file {}").format(repr(first.file)))
    return f"{action.format(**objects)}: {', '.join(parts)}."


def count(low: bpy.types.Object, settings: ImprintSettings) -> str:
    """How many images the button fills, in a line: the box keeps its height, so that lists below it do not move."""
    return message("Images of this bake: {}").format(len(images(low, settings)))


@dataclass(frozen=True)
class PlannedImage:
    """An image that a bake fills. file: the name of its file; empty without one."""

    name: str
    file: str

    @property
    def title(self) -> str:
        """The names of the image and the file."""
        return f"{self.name} ({self.file})" if self.file else self.name


def images(low: bpy.types.Object, settings: ImprintSettings) -> list[PlannedImage]:
    """The images that a bake would fill: that of the report first, then the others. settings: valid."""
    return [image for filled in _filled(low, settings) for image in _images(filled)]


def _images(filled: Settings) -> list[PlannedImage]:
    """The images of one texture set."""
    by_map = planned_files.settings_by_map(filled)
    first = planned_files.first_map(filled)
    return [
        PlannedImage(of_map.image, os.path.basename(bpy.path.abspath(map_names.output_for(of_map))))
        for of_map in [by_map.pop(first), *by_map.values()]
    ]


def _filled(low: bpy.types.Object, settings: ImprintSettings) -> list[Settings]:
    """The settings of each texture set, or of the whole low object, with names filled in. Raises BakeError for names that
    texture sets would share."""
    values = settings.to_settings()
    names = [job.material for job in by_material([Job(low, [])], values)] if values.texture_sets else [""]
    return [bake_jobs.for_low(values, low.name, name) for name in names]


def warning(low: bpy.types.Object, highs: list[bpy.types.Object]) -> str:
    """Why the objects may be the wrong ones, in a sentence; empty if they seem right."""
    if not object_checks.seem_swapped(low, highs):
        return ""
    return message(object_checks.SWAPPED).format(
        low=repr(low.name), highs=shorten_list(repr(high.name) for high in highs)
    )
