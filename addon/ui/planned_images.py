# SPDX-License-Identifier: GPL-3.0-or-later
"""The images that a bake fills, as panels name them before it."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import bpy

from ..core.settings import Settings
from ..jobs import bake_jobs
from ..jobs.job import Job, by_material
from ..output import datablocks, map_names
from .texts import message


def count_images(low: bpy.types.Object, settings: Settings) -> str:
    """How many images the button fills, in a line: the box keeps its height, so that lists below it do not move."""
    return message("Images of this bake: {}").format(len(planned_images(low, settings)))


@dataclass(frozen=True)
class PlannedImage:
    """An image that a bake fills.

    Attributes:
        name: That of the image.
        path: That of its file, as it is set; empty without one.
    """

    name: str
    path: str

    @property
    def folder(self) -> str:
        return self.path[: len(self.path) - len(self.file)]

    @property
    def file(self) -> str:
        """The name of its file."""
        return os.path.basename(self.path)

    @property
    def title(self) -> str:
        """The name of the file, and that of the image if it is another one."""
        is_same = not self.path or os.path.splitext(self.file)[0] == self.name
        return (self.file or self.name) if is_same else f"{self.name} ({self.file})"


def planned_images(low: bpy.types.Object, settings: Settings, name: str = "") -> list[PlannedImage]:
    """The images that a bake would fill: that of the report first, then the others.

    Args:
        settings: Valid.
        name: In place of the low object's name.
    """
    return [image for each in filled(low, settings, name) for image in _images(each)]


def _images(filled: Settings) -> list[PlannedImage]:
    """The images of one texture set."""
    by_map = map_names.settings_by_map(filled)
    first = map_names.first_map(filled.map)
    return [
        PlannedImage(of_map.storing.image, map_names.output_for(of_map))
        for of_map in [by_map.pop(first), *by_map.values()]
    ]


def filled(low: bpy.types.Object, values: Settings, low_name: str = "") -> list[Settings]:
    """The settings of each texture set, or of the whole low object, with names filled in. Raises BakeError for names that
    texture sets would share."""
    names = [job.material for job in by_material([Job(low, [])], values.storing)] if values.map.texture_sets else [""]
    return [bake_jobs.for_low(values, low_name or low.name, name) for name in names]


def of_texture(settings: Settings, low_name: str, shared_name: str, material: str) -> list[PlannedImage]:
    """The images of a part of a set, or those that parts share.

    Args:
        settings: Valid.
        shared_name: As for bake_jobs.work; empty for images of the part alone.
        material: Whose images they are; empty for all materials.
    """
    if not shared_name:
        return _images(bake_jobs.for_low(settings, low_name))
    return _images(bake_jobs.for_shared(settings, shared_name, material))


def draw_images(layout: bpy.types.UILayout, images: Sequence[PlannedImage]) -> None:
    """The names of images, or those of their files below the folder. Those that exist have another icon than new ones."""
    column = layout.column(align=True)
    if folder := next((image.folder for image in images if image.folder), ""):
        column.label(text=folder, icon="FILE_FOLDER", translate=False)
    for image in images:
        icon = "FILE_REFRESH" if datablocks.get(image.name) else "IMAGE_DATA"
        column.label(text=image.title, icon=icon, translate=False)
