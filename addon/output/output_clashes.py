# SPDX-License-Identifier: GPL-3.0-or-later
"""The images and files that bakes write, and whether two of them would be one.

The rule for files is path_clashes.Places, here and on the command line. Images clash where their names differ in case at most.
"""

from collections.abc import Iterator, Sequence

import bpy

from ..core import file_names, udim
from ..core.errors import BakeError
from ..core.map_types import BY_NAME, MASK, NORMAL
from ..core.settings import Settings
from ..core.udim import TOKEN
from . import datablocks, image_writer
from .path_clashes import Places


def settings_by_map(settings: Settings) -> dict[str, Settings]:
    """The settings of each image that a bake writes, by the map's name."""
    names = [MASK.name] * settings.mask + list(settings.maps)
    return {NORMAL.name: settings} | {name: image_writer.beside(settings, BY_NAME[name]) for name in names}


def files(settings: Settings) -> Iterator[tuple[str, str]]:
    """The files that a bake writes, each with what it is. TOKEN stands for tiles that the settings do not name."""
    for name, own in settings_by_map(settings).items():
        path = image_writer.output_for(own)
        for tile in own.tiles or [TOKEN] if path else ():
            yield udim.fill(path, tile), title(name)


def title(name: str) -> str:
    """What a map is called in a sentence."""
    return f"the {BY_NAME[name].title}"


def check(settings: Settings, bakes: Sequence[Settings], objects: Sequence[str]) -> None:
    """Raise BakeError if two maps of several bakes would be one, or would replace a file that the scene uses.

    bakes: the settings of each bake, which are `settings` with names filled in. objects: its low object, or what stands for it.
    """
    _check_images(bakes, objects, _advice(settings.image))
    check_files(bakes, objects, _advice(settings.output))


def check_files(bakes: Sequence[Settings], objects: Sequence[str], advice: str) -> None:
    """Raise WrongPlace if two files of several bakes would be one, or if one of them is a file that the scene uses.

    bakes, objects: see `check`. advice: what to do about two files that would be one.
    """
    places = Places(advice)
    for path, what in datablocks.sources():
        places.read(path, what)
    for settings, low in zip(bakes, objects, strict=True):
        for path, what in files(settings):
            places.write(bpy.path.abspath(path), f"{what} of {low!r}")


def _check_images(bakes: Sequence[Settings], objects: Sequence[str], advice: str) -> None:
    """Raise BakeError if two maps would fill one image. See `check`."""
    owners: dict[str, str] = {}
    for settings, low in zip(bakes, objects, strict=True):
        for name, own in settings_by_map(settings).items():
            what = f"{title(name)} of {low!r}"
            other = owners.setdefault(own.image.casefold(), what)
            if other != what:
                raise BakeError(f"T{what[1:]} and {other} would both fill the image {own.image!r}: {advice}.")


def _advice(name: str) -> str:
    """What to do about two maps in one place, which the settings call `name`."""
    if not name or file_names.LOW in name:  # without a name, an image is named after the low object
        return "rename one of the objects"
    return f"put {file_names.LOW} into the name, or let them share it"
