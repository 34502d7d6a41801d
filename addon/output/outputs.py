# SPDX-License-Identifier: GPL-3.0-or-later
"""The images that a bake fills: the normal map and what was asked for beside it."""

from collections.abc import Sequence
from contextlib import ExitStack

import bpy
import numpy as np

from ..core import file_names, texel_state, udim
from ..core.errors import BakeError, shorten_list
from ..core.map_types import BY_NAME, MASK, NORMAL, Labeled
from ..core.report import Report
from ..core.settings import Settings
from ..core.texel_state import Map
from ..core.udim import TOKEN
from . import datablocks, image_writer, materials, value_encoding
from .path_clashes import Places


def wanted(settings: Settings) -> dict[str, Settings]:
    """The settings of each image that a bake fills, by the map's name."""
    names = [MASK.name] * settings.mask + list(settings.maps)
    return {NORMAL.name: settings} | {name: image_writer.beside(settings, BY_NAME[name]) for name in names}


def label(name: str) -> str:
    """What an image of `wanted` is called in a sentence."""
    return f"the {BY_NAME[name].title}"


def check_apart(settings: Settings, each: Sequence[Settings], names: Sequence[str]) -> None:
    """Raise BakeError if two of a bake's maps would be one, or replace a file that the scene is made of.

    each, names: of each image that is baked the settings, those of `settings` filled in, and its object.
    """
    _check_images(each, names, _advice(settings.image))
    check_places(each, names, _advice(settings.output))


def _advice(name: str) -> str:
    """What to do about two maps that would go into one place, called `name` in the settings."""
    if not name or file_names.LOW in name:  # images are called after the low object where nobody says how
        return "rename one of the objects"
    return f"put {file_names.LOW} into the name, or let them share it"


def _check_images(each: Sequence[Settings], names: Sequence[str], advice: str) -> None:
    """Raise BakeError if two maps would fill one image; see `check_apart`."""
    owners: dict[str, str] = {}
    for own, low in zip(each, names, strict=True):
        for kind, one in wanted(own).items():
            what = f"{label(kind)} of {low!r}"
            other = owners.setdefault(one.image.casefold(), what)
            if other != what:
                raise BakeError(f"T{what[1:]} and {other} would both fill the image {one.image!r}: {advice}.")


def check_places(each: Sequence[Settings], names: Sequence[str], advice: str) -> None:
    """Raise WrongPlace if two files that bakes write would be one, or one of them is a file that the scene is made of.

    each, names: as for `check_apart`. advice: what to do about two that would be one.
    """
    places = Places(advice)
    for path, what in datablocks.sources():
        places.read(path, what)
    for own, low in zip(each, names, strict=True):
        for kind, one in wanted(own).items():
            path = image_writer.output_for(one)
            for tile in one.tiles or [TOKEN] if path else ():
                places.write(bpy.path.abspath(udim.fill(path, tile)), f"{label(kind)} of {low!r}")


class Outputs:
    """Used in a `with` block: nothing of the artist's changes before commit, and nothing is left behind without it."""

    def __init__(self, settings: Settings):
        self.settings = settings
        self._writers = {
            name: image_writer.Writer("", own, is_normal=name == NORMAL.name) for name, own in wanted(settings).items()
        }
        self._kept: dict[str, dict[int, np.ndarray]] = {name: {} for name in settings.maps}

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, *_) -> None:
        with ExitStack() as all_of_them:
            for writer in self._writers.values():
                all_of_them.callback(writer.discard)

    def add(self, tile: int, maps: dict[str, Map]) -> None:
        """Take one UDIM tile of all maps, unless it stayed empty: triangles may pass by a tile without a texel in it."""
        texels, state = maps[NORMAL.name]
        if not state.any():
            return
        self._writers[NORMAL.name].add(tile, texels)
        if MASK.name in self._writers:
            self._writers[MASK.name].add(tile, image_writer.black_and_white(state == texel_state.MISSED))
        for name, kept in self._kept.items():
            kept[tile] = maps[name][0]  # until the range of all tiles is known

    def commit(
        self, lows: Sequence[bpy.types.Object], reports: Sequence[Report], materials_seen: Sequence[str]
    ) -> None:
        """Put all images in their places, or none, and the map into the materials of `lows`. Raises BakeError.

        materials_seen: what the numbers of a material map stand for.
        """
        settings = self.settings
        maps = {name: self._encode(name, tiles, reports, materials_seen) for name, tiles in self._kept.items()}
        stored = dict(zip(self._writers, image_writer.commit_all(list(self._writers.values())), strict=True))
        sign(stored[NORMAL.name], reports)
        for low, report in zip(lows, reports, strict=True):
            report.image = stored[NORMAL.name].name
            report.output = [path for writer in self._writers.values() for path in writer.paths]
            report.tiles = [tile for tile in report.tiles if tile in self._writers[NORMAL.name].tiles]
            report.loss = self._writers[NORMAL.name].loss
            report.maps = {name.lower(): {"image": stored[name].name} | how for name, how in maps.items()}
            if settings.material:
                report.warnings += hook_up(low, stored[NORMAL.name], report, settings)

    def _encode(
        self, name: str, tiles: dict[int, np.ndarray], reports: Sequence[Report], materials_seen: Sequence[str]
    ) -> dict:
        map_type = BY_NAME[name]
        labels = {Labeled.OBJECTS: dict.fromkeys(_highs(reports)), Labeled.MATERIALS: materials_seen}
        names = list(labels.get(map_type.labeled, ()))
        how = value_encoding.encoding(map_type, list(tiles.values()), names, self.settings)
        for tile, texels in tiles.items():
            value_encoding.encode(texels, how)
            self._writers[name].add(tile, texels)
        return how


def _highs(reports: Sequence[Report]) -> list[str]:
    """The names of all that was baked from."""
    return [high for report in reports for high in report.high]


def sign(image: bpy.types.Image, reports: Sequence[Report]) -> None:
    """Note in `image` which high objects its new map came from; the first report warns of one from others that it replaced."""
    highs = list(dict.fromkeys(_highs(reports)))
    before = image_writer.replaced(image.name, highs)
    datablocks.sign(image, highs)
    if before:
        reports[0].warnings.append(
            f"The image {image.name!r} held a map of {before}, which the one of {shorten_list(map(repr, highs))} replaced."
        )


def hook_up(low: bpy.types.Object, image: bpy.types.Image, report: Report, settings: Settings) -> list[str]:
    """Show `image` in the materials of `low`; returns what there is to say about it."""
    return materials.hook_up(
        low,
        image,
        space=settings.space,
        uv_layer=report.uv_layer,
        channels=(settings.red, settings.green, settings.blue),
        single_user=settings.single_user,
    )
