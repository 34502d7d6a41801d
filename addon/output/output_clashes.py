# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that no two maps of a call are written to the same image or file.

For files, path_clashes.Places has the rules, here and on the command line. Names of images clash also if they differ in case.
"""

from collections.abc import Iterable, Sequence

import bpy

from ..core import naming
from ..core.errors import BakeError
from ..core.settings import Settings, StorageSettings
from . import datablocks
from .files.path_clashes import Places
from .map_names import map_title, planned_files, settings_by_map


def check(
    settings: StorageSettings, bakes: Sequence[Settings], objects: Sequence[str], read: Iterable[tuple[str, str]]
) -> None:
    """Raise BakeError if two maps would be written to one image or file, or if a map would replace a file that is read.

    bakes: the settings of each bake, which are `settings` with names filled in. objects: the name of its low object, or of
    another subject for messages. read: the files that the bakes read beside those of datablocks.sources, and what they are.
    """
    _check_images(bakes, objects, _advice(settings.image))
    check_files(bakes, objects, _advice(settings.output), read)


def check_files(
    bakes: Sequence[Settings], objects: Sequence[str], advice: str, read: Iterable[tuple[str, str]]
) -> None:
    """Raise WrongPlace if two files would be the same, or if a file is one that the scene uses.

    bakes, objects, read: see `check`. advice: for two files that would be the same, the end of the message.
    """
    places = Places(advice)
    for path, source in (*datablocks.sources(), *read):
        places.read(path, source)
    for settings, low in zip(bakes, objects, strict=True):
        for path, title in planned_files(settings):
            places.write(bpy.path.abspath(path), f"{title} of {low!r}")


def _check_images(bakes: Sequence[Settings], objects: Sequence[str], advice: str) -> None:
    """Raise BakeError if two maps would fill one image. See `check`."""
    owners: dict[str, str] = {}
    for settings, low in zip(bakes, objects, strict=True):
        for name, of_map in settings_by_map(settings).items():
            owner = f"{map_title(settings.map, name)} of {low!r}"
            other = owners.setdefault(of_map.storing.image.casefold(), owner)
            if other != owner:
                raise BakeError(
                    f"T{owner[1:]} and {other} would both fill the image {of_map.storing.image!r}: {advice}."
                )


def _advice(name: str) -> str:
    """How to avoid two maps with the same `name`, the one in the settings."""
    if not name or naming.LOW in name:  # without a name, an image is named after the low object
        return "rename one of the objects"
    return f"put {naming.LOW} into the name, or let them share it"
