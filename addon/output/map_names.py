# SPDX-License-Identifier: GPL-3.0-or-later
"""The names of maps, of their image datablocks and of their files, and which files a bake writes. Needs no Blender."""

import os
import re
import zlib
from collections.abc import Iterator
from itertools import product
from pathlib import PurePath

from ..core import file_formats, naming, udim
from ..core.declarations import targets
from ..core.declarations.choices import Compression, Space, Storage
from ..core.map_types import BY_NAME, EMISSION, MASK, NORMAL, WHITE, Kind, MapType
from ..core.naming import MATERIAL, USUAL, fill_low, of_texture_sets
from ..core.settings import MapSettings, Settings, StorageSettings
from ..core.udim import TOKEN

LONGEST = 240
"""The most bytes of an image's name. Blender allows 255, and the names of other maps get a suffix."""

_TILE = rf"(?=[._ -]?{TOKEN}|$)"
"""Before the tile's number with its separator, which stays; without one the end of a name."""
_NORMAL = re.compile(rf"(?:[._ -](?:normal|ddn))?{_TILE}", re.IGNORECASE)
"""What the suffix of another map replaces at the end of a name: "normal", CryEngine's "ddn", or nothing."""
_SHORT_NORMAL = re.compile(rf"(?<=_)N{_TILE}")
"""What the short suffix of another map replaces at the end of a name that starts with T_, as Unreal's textures are named."""

_PAINTER_NORMAL = re.compile(rf"_normal_base{_TILE}", re.IGNORECASE)
"""What the painter_suffix of another map replaces at the end of a name that Substance 3D Painter takes for a normal map."""


def name_for(low_name: str, storing: StorageSettings, material: str = "") -> str:
    """The name of the image datablock, with the names of the low object and of the material in place of placeholders.

    Blender would shorten long names, and the image would not be found by its name. So they are shortened here, with a
    checksum that keeps them distinct.
    """
    pattern = storing.image or (of_texture_sets(USUAL) if material else USUAL)
    filled = pattern.replace(MATERIAL, material) if material else pattern
    name = fill_low(filled, low_name, storing.low_suffix)
    letters = name.encode()
    if len(letters) <= LONGEST:
        return name
    return f"{letters[: LONGEST - 9].decode(errors='ignore')}_{zlib.crc32(letters):08x}"


def output_for(settings: Settings) -> str:
    """The path to write to, as Blender spells it, with TOKEN for the tile's number in a UDIM bake. Empty without a file.

    A path whose ending is open gets the first of open_endings.
    """
    if settings.storing.storage != Storage.FILE:
        return ""
    path = settings.storing.output
    if endings := open_endings(settings):
        path = with_ending(path, endings[0])
    if settings.sampling.udim and TOKEN not in path:
        ending = PurePath(path).suffix
        path = f"{path.removesuffix(ending)}.{TOKEN}{ending}"
    return path


def open_endings(settings: Settings) -> list[str]:
    """The endings of which each map gets the one with the smallest file; none if the path has one.

    They are those of pictures that all target engines load, with the alpha that the settings want. Maps without a limit get the
    first. settings: of all maps.
    """
    storing, packing = settings.storing, settings.map.packing
    if not storing.has_open_ending:
        return []
    formats, engines = [file_formats.PNG], [targets.BY_NAME[name] for name in settings.map.targets]
    if all(engine.has_webp for engine in engines) and max(settings.sampling.size) <= file_formats.WEBP.longest_side:
        formats.append(file_formats.WEBP)
    if not storing.alpha:
        formats.append(file_formats.JPEG)
    needs_alpha = packing is not None and packing.channels[-1] != WHITE
    return [each.endings[0] for each in formats if each.has_map_in_alpha or not needs_alpha]


def with_ending(path: str, ending: str) -> str:
    """The path of a file with another ending."""
    return os.path.splitext(path)[0] + ending  # Blender's // is no root of Windows


def of_level(settings: Settings, level: int) -> Settings:
    """The settings of a mip level of a map, from the map's own: rock_normal.png has rock_normal_mip1.png beside it."""
    path = PurePath(settings.storing.output)
    stem = re.sub(rf"([._ -]?{TOKEN}|$)", rf"_mip{level}\g<1>", path.stem, count=1)
    return settings.stored(output=str(path.with_stem(stem)))


def beside(settings: Settings, map_type: MapType) -> Settings:
    """The settings of another map, from those of the normal map, whose image must have a name.

    Its suffix takes the place of "normal" at the end of the name: rock_normal.png has rock_height.png beside it, and
    T_rock_N.png has T_rock_H.png.

    Maps that are stored in the lowest depth are not dithered. In files of floats, maps whose numbers can be of any size have
    the highest depth: 16-bit floats have steps of half a unit at 1,000, and end at 65,504. Inside Blender, the colors of a
    material have 8 bits instead of 16: there, 16 bits are floats, which hold linear values, and glTF's exporter writes those
    as if they were sRGB.
    """
    path = PurePath(settings.storing.output)
    is_file = settings.storing.storage == Storage.FILE
    own_format = file_formats.of(path) if is_file else file_formats.PACKED[False]
    lowest = own_format.depths[0]
    depth = settings.storing.depth if map_type.is_deep else lowest
    if map_type.is_unbounded and own_format.is_float:
        depth = own_format.depths[-1]
    if map_type.is_color and map_type.socket and not is_file:
        depth = lowest if depth <= file_formats.USUAL_DEPTH else depth
    return _of_map(settings, map_type).stored(
        image=_named(settings.storing.image, map_type),
        output=str(path.with_stem(_named(path.stem, map_type))) if is_file else "",
        depth=depth,
        dither=settings.storing.dither and map_type.is_deep,
    )


def _of_map(settings: Settings, map_type: MapType) -> Settings:
    """The settings of one map, with the format of its blocks and its quality."""
    storing = settings.storing
    file_format = file_formats.known(storing.output) if storing.storage == Storage.FILE else None
    if file_format is None or not (file_format.is_blocks or file_format.has_quality):
        return settings
    quality = 100 if map_type.kind is Kind.NORMAL and not storing.lossy_normals else storing.quality
    return settings.stored(compression=_compression(settings, map_type), quality=quality)


def _compression(settings: Settings, map_type: MapType) -> Compression:
    """The format of the blocks of a map: the one of the settings if the map fits into it, or else the usual one."""
    is_packed = map_type.name not in BY_NAME
    is_normal, is_gray = map_type.kind is Kind.NORMAL, map_type.is_gray and not is_packed
    fits = {Compression.BC7}
    if is_gray:
        fits.add(Compression.BC4)
    if is_normal and settings.map.space == Space.TANGENT and settings.map.blue == "+Z":  # elsewhere z may be below 0
        fits.add(Compression.BC5)
    if not is_packed and map_type.kind is not Kind.LABEL:
        fits.add(Compression.BC6H)
    chosen = Compression(settings.storing.compression)
    if chosen in fits:
        return chosen
    usual = [
        Compression.BC4,
        Compression.BC5,
        *([Compression.BC6H] if map_type is EMISSION or map_type.is_vector else []),
    ]
    return next((each for each in usual if each in fits), Compression.BC7)


def _named(name: str, map_type: MapType) -> str:
    """The name of another map, from that of the normal map."""
    if _is_short(name):
        return _SHORT_NORMAL.sub(map_type.short_suffix or map_type.suffix, name)
    if _PAINTER_NORMAL.search(name):
        return _PAINTER_NORMAL.sub(f"_{map_type.painter_suffix or map_type.suffix}", name)
    return _NORMAL.sub(f"_{map_type.suffix}", name, count=1)


def _is_short(name: str) -> bool:
    """Whether names of other maps have their short suffixes."""
    # Only with T_: objects such as Wall_N and Wall_E, for north and east, keep their names.
    return name.startswith("T_") and bool(_SHORT_NORMAL.search(name))


def stored_maps(map_settings: MapSettings) -> dict[str, MapType]:
    """The maps that a bake stores in images of their own, by name. A packed image counts as one map."""
    names = [NORMAL.name] * map_settings.normal + [MASK.name] * map_settings.mask + list(map_settings.maps)
    packed = map_settings.packing.map_type if map_settings.packing else None
    return {name: BY_NAME[name] for name in names} | ({packed.name: packed} if packed else {})


def settings_by_map(settings: Settings) -> dict[str, Settings]:
    """The settings of each image that a bake writes, by the map's name."""
    if endings := open_endings(settings):
        settings = settings.stored(output=with_ending(settings.storing.output, endings[0]))
    return {
        name: _of_map(settings, map_type) if map_type is NORMAL else beside(settings, map_type)
        for name, map_type in stored_maps(settings.map).items()
    }


def first_map(map_settings: MapSettings) -> str:
    """The name of the map whose image stands for the bake: the normal map, or the first other map without one."""
    return next(name for name in stored_maps(map_settings) if name != MASK.name)


def planned_files(settings: Settings) -> Iterator[tuple[str, str]]:
    """The files that a bake writes: paths, and titles for messages. Paths have TOKEN if the settings name no tiles."""
    for name, of_map in settings_by_map(settings).items():
        levels = [of_level(of_map, level) for level in level_files(settings, name)]
        for path in filter(None, map(output_for, [of_map, *levels])):
            endings = open_endings(settings) or [PurePath(path).suffix]
            for tile, ending in product(of_map.sampling.tiles or [TOKEN], endings):
                yield udim.fill(with_ending(path, ending), tile), map_title(settings.map, name)


def levels_of(settings: Settings, name: str) -> range:
    """The numbers of the mip levels that are stored of a map. Maps without a mean have none."""
    has_mean = stored_maps(settings.map)[name].kind in (Kind.NORMAL, Kind.VALUE)
    return range(1, len(settings.mip_sizes) + 1) if has_mean else range(1, 1)


def level_files(settings: Settings, name: str) -> range:
    """The numbers of the mip levels of a stored map that have files of their own."""
    return range(1, 1) if settings.storing.is_blocks else levels_of(settings, name)


def map_title(map_settings: MapSettings, name: str) -> str:
    """The name of a stored map in a sentence."""
    return f"the {stored_maps(map_settings)[name].title}"


def output_of_frame(output: str, frame: int) -> str:
    """The file of a frame: its number replaces the last run of # in the name, or is added before the ending, as _0001."""
    path = PurePath(output)
    runs = list(re.finditer("#+", path.stem))
    if not runs:
        return str(path.with_stem(f"{path.stem}_{frame:04}"))
    start, stop = runs[-1].span()
    return str(path.with_stem(f"{path.stem[:start]}{frame:0{stop - start}}{path.stem[stop:]}"))


def with_low_name(settings: Settings, low_name: str) -> Settings:
    """The settings with the low object's name in the path. A # in that name is replaced, because it means a frame."""
    storing = settings.storing
    output = naming.fill(storing.output, low_name.replace("#", "_"), low_suffix=storing.low_suffix)
    return settings.stored(output=output)


def of_frame(settings: Settings, frame: int) -> Settings:
    """The settings of one frame, from those with the low object's name filled in."""
    return settings.stored(output=output_of_frame(settings.storing.output, frame))
