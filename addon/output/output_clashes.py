# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that no two maps of a call are written to the same image or file.

For files, path_clashes.Places has the rules, here and on the command line. Names of images clash also if they differ in case.
"""

from collections.abc import Iterator, Sequence

import bpy

from ..core import udim
from ..core.errors import BakeError
from ..core.map_types import BY_NAME, MASK, NORMAL, Kind, MapType
from ..core.names import file_names
from ..core.settings import Settings
from ..core.udim import TOKEN
from . import datablocks, map_names
from .files.path_clashes import Places


def stored_maps(settings: Settings) -> dict[str, MapType]:
    """The maps that a bake stores in images of their own, by name. A packed image counts as one map."""
    names = [NORMAL.name] * settings.normal + [MASK.name] * settings.mask + list(settings.maps)
    packed = settings.packing.map_type if settings.packing else None
    return {name: BY_NAME[name] for name in names} | ({packed.name: packed} if packed else {})


def settings_by_map(settings: Settings) -> dict[str, Settings]:
    """The settings of each image that a bake writes, by the map's name."""
    return {
        name: settings if map_type is NORMAL else map_names.beside(settings, map_type)
        for name, map_type in stored_maps(settings).items()
    }


def first_map(settings: Settings) -> str:
    """The name of the map whose image stands for the bake: the normal map, or the first other map without one."""
    return next(name for name in stored_maps(settings) if name != MASK.name)


def files(settings: Settings) -> Iterator[tuple[str, str]]:
    """The files that a bake writes: paths, and titles for messages. Paths have TOKEN if the settings name no tiles."""
    for name, of_map in settings_by_map(settings).items():
        levels = [map_names.of_level(of_map, level) for level in levels_of(settings, name)]
        for path in filter(None, map(map_names.output_for, [of_map, *levels])):
            for tile in of_map.tiles or [TOKEN]:
                yield udim.fill(path, tile), title(settings, name)


def levels_of(settings: Settings, name: str) -> range:
    """The numbers of the mip levels that are written of a stored map. Maps without a mean have none."""
    has_mean = stored_maps(settings)[name].kind in (Kind.NORMAL, Kind.VALUE)
    return range(1, len(settings.mip_sizes) + 1) if has_mean else range(1, 1)


def title(settings: Settings, name: str) -> str:
    """The name of a stored map in a sentence."""
    return f"the {stored_maps(settings)[name].title}"


def check(settings: Settings, bakes: Sequence[Settings], objects: Sequence[str]) -> None:
    """Raise BakeError if two maps would be written to one image or file, or if a map would replace a file of the scene.

    bakes: the settings of each bake, which are `settings` with names filled in. objects: the name of its low object, or of
    another subject for messages.
    """
    _check_images(bakes, objects, _advice(settings.image))
    check_files(bakes, objects, _advice(settings.output))


def check_files(bakes: Sequence[Settings], objects: Sequence[str], advice: str) -> None:
    """Raise WrongPlace if two files would be the same, or if a file is one that the scene uses.

    bakes, objects: see `check`. advice: for two files that would be the same, the end of the message.
    """
    places = Places(advice)
    for path, source in datablocks.sources():
        places.read(path, source)
    for settings, low in zip(bakes, objects, strict=True):
        for path, map_title in files(settings):
            places.write(bpy.path.abspath(path), f"{map_title} of {low!r}")


def _check_images(bakes: Sequence[Settings], objects: Sequence[str], advice: str) -> None:
    """Raise BakeError if two maps would fill one image. See `check`."""
    owners: dict[str, str] = {}
    for settings, low in zip(bakes, objects, strict=True):
        for name, of_map in settings_by_map(settings).items():
            owner = f"{title(settings, name)} of {low!r}"
            other = owners.setdefault(of_map.image.casefold(), owner)
            if other != owner:
                raise BakeError(f"T{owner[1:]} and {other} would both fill the image {of_map.image!r}: {advice}.")


def _advice(name: str) -> str:
    """How to avoid two maps with the same `name`, the one in the settings."""
    if not name or file_names.LOW in name:  # without a name, an image is named after the low object
        return "rename one of the objects"
    return f"put {file_names.LOW} into the name, or let them share it"
