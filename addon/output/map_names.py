# SPDX-License-Identifier: GPL-3.0-or-later
"""The names of maps: of their image datablocks and of their files."""

import re
import zlib
from dataclasses import replace
from pathlib import PurePath

from ..core import file_formats
from ..core.declarations.choices import Storage
from ..core.map_types import MapType
from ..core.settings import Settings
from ..core.udim import TOKEN

LONGEST = 240
"""The most bytes of an image's name. Blender allows 255, and the names of other maps get a suffix."""


def name_for(low_name: str, settings: Settings) -> str:
    """The name of the image datablock, with the low object's name in place of "{low}".

    Blender would shorten long names, and the image would not be found by its name. So they are shortened here, with a
    checksum that keeps them distinct.
    """
    name = settings.image.replace("{low}", low_name) or f"{low_name}_normal"
    letters = name.encode()
    if len(letters) <= LONGEST:
        return name
    return f"{letters[: LONGEST - 9].decode(errors='ignore')}_{zlib.crc32(letters):08x}"


def output_for(settings: Settings) -> str:
    """The path to write to, as Blender spells it, with TOKEN for the tile's number in a UDIM bake. Empty without a file."""
    path = settings.output
    if settings.storage != Storage.FILE:
        return ""
    if settings.udim and TOKEN not in path:
        ending = PurePath(path).suffix
        path = f"{path.removesuffix(ending)}.{TOKEN}{ending}"
    return path


def beside(settings: Settings, map_type: MapType) -> Settings:
    """The settings of another map, from those of the normal map, whose image must have a name.

    Maps that are stored in the lowest depth are not dithered.
    """
    path = PurePath(settings.output)
    is_file = settings.storage == Storage.FILE
    lowest = (file_formats.of(path) if is_file else file_formats.PACKED[False]).depths[0]
    # The tile's number stays at the end, with its separator.
    stem = re.sub(rf"[._ -]?{TOKEN}|$", rf"_{map_type.suffix}\g<0>", path.stem, count=1)
    return replace(
        settings,
        image=f"{settings.image}_{map_type.suffix}",
        output=str(path.with_stem(stem)) if is_file else "",
        depth=settings.depth if map_type.is_deep else lowest,
        dither=settings.dither and map_type.is_deep,
    )
