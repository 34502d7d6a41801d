# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a bake writes, from its settings alone. This module does not need Blender."""

from collections.abc import Iterator

from ...core import udim
from ...core.map_types import BY_NAME, MASK, NORMAL, Kind, MapType
from ...core.settings import MapSettings, Settings
from ...core.udim import TOKEN
from .. import map_names


def stored_maps(settings: MapSettings) -> dict[str, MapType]:
    """The maps that a bake stores in images of their own, by name. A packed image counts as one map."""
    names = [NORMAL.name] * settings.normal + [MASK.name] * settings.mask + list(settings.maps)
    packed = settings.packing.map_type if settings.packing else None
    return {name: BY_NAME[name] for name in names} | ({packed.name: packed} if packed else {})


def settings_by_map(settings: Settings) -> dict[str, Settings]:
    """The settings of each image that a bake writes, by the map's name."""
    return {
        name: settings if map_type is NORMAL else map_names.beside(settings, map_type)
        for name, map_type in stored_maps(settings.map).items()
    }


def first_map(settings: MapSettings) -> str:
    """The name of the map whose image stands for the bake: the normal map, or the first other map without one."""
    return next(name for name in stored_maps(settings) if name != MASK.name)


def files(settings: Settings) -> Iterator[tuple[str, str]]:
    """The files that a bake writes: paths, and titles for messages. Paths have TOKEN if the settings name no tiles."""
    for name, of_map in settings_by_map(settings).items():
        levels = [map_names.of_level(of_map, level) for level in levels_of(settings, name)]
        for path in filter(None, map(map_names.output_for, [of_map, *levels])):
            for tile in of_map.sampling.tiles or [TOKEN]:
                yield udim.fill(path, tile), title(settings.map, name)


def levels_of(settings: Settings, name: str) -> range:
    """The numbers of the mip levels that are written of a stored map. Maps without a mean have none."""
    has_mean = stored_maps(settings.map)[name].kind in (Kind.NORMAL, Kind.VALUE)
    return range(1, len(settings.mip_sizes) + 1) if has_mean else range(1, 1)


def title(settings: MapSettings, name: str) -> str:
    """The name of a stored map in a sentence."""
    return f"the {stored_maps(settings)[name].title}"
