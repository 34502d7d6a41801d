# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a bake, as plain data. `declarations` holds their labels, tooltips, limits and defaults."""

import re
from dataclasses import dataclass, field, fields, replace
from pathlib import PurePath
from typing import Any

from . import file_formats, udim
from .declarations import bases
from .declarations.all_settings import DECLARED
from .declarations.choices import Method, Pack, Storage
from .declarations.map_settings import ADAPTIVE_FROM
from .declarations.packing import CUSTOM_SUFFIX, PRESETS, WHITE, Packing
from .errors import BakeError
from .map_types import BY_NAME, NAMES, WIDENED_ROUGHNESS
from .names.file_names import LOW, MATERIAL
from .udim import TOKEN


def _field(name: str) -> Any:
    """A field with the default that is declared for the setting `name`."""
    return field(default=DECLARED[name].default)


@dataclass(frozen=True)
class Settings:
    """One bake. Sizes and margin in texels, depth in bits per channel, distances in scene units.

    `DECLARED` describes each field.
    """

    method: str = _field("method")
    space: str = _field("space")
    basis: str = _field("basis")
    readers: tuple[str, ...] = _field("readers")
    """Names among declarations.readers.BY_NAME, in their order."""
    uv_layer: str = _field("uv_layer")
    width: int = _field("width")
    height: int = _field("height")
    samples: int = _field("samples")
    adaptive: bool = _field("adaptive")
    """Whether samples are adaptive."""
    extrusion: float | None = _field("extrusion")
    """None to measure it. Not used with a cage."""
    max_distance: float | None = _field("max_distance")
    """None to measure it."""
    hit: str = _field("hit")
    directions: str = _field("directions")
    offset_group: str = _field("offset_group")
    """Name of a vertex group of the low mesh, or empty. With a cage, it scales the distance of the cage."""
    straight_group: str = _field("straight_group")
    """As offset_group. A cage decides the directions alone."""
    facing_only: bool = _field("facing_only")
    missed: tuple[float, float, float] = _field("missed")
    mask: bool = _field("mask")
    normal: bool = _field("normal")
    """Whether the normal map is stored."""
    maps: tuple[str, ...] = _field("maps")
    """Names among map_types.NAMES, in their order."""
    rays: int = _field("rays")
    distance_unit: str = _field("distance_unit")
    ao_distance: float | None = _field("ao_distance")
    """In distance_unit. None for no limit."""
    ao_fade: str = _field("ao_fade")
    occluders: str = _field("occluders")
    floor: bool = _field("floor")
    two_sided: bool = _field("two_sided")
    bias_angle: int = _field("bias_angle")
    """In degrees."""
    thickness_distance: float | None = _field("thickness_distance")
    """In distance_unit. None for THICKNESS_SHARE."""
    curvature_radius: float | None = _field("curvature_radius")
    """In distance_unit. None for CURVATURE_SHARE."""
    attribute: str = _field("attribute")
    """Empty for the color attribute that is set to render."""
    detail_maps: bool = _field("detail_maps")
    pack: str = _field("pack")
    pack_red: str = _field("pack_red")
    pack_green: str = _field("pack_green")
    pack_blue: str = _field("pack_blue")
    pack_alpha: str = _field("pack_alpha")
    texture_sets: bool = _field("texture_sets")
    vertex_domain: str = _field("vertex_domain")
    connect_maps: bool = _field("connect_maps")
    red: str = _field("red")
    green: str = _field("green")
    blue: str = _field("blue")
    margin: int | None = _field("margin")
    """None to fill the whole background."""
    margin_type: str = _field("margin_type")
    mips: int = _field("mips")
    stacked: str = _field("stacked")
    udim: bool = _field("udim")
    tiles: tuple[int, ...] = _field("tiles")
    """Empty for all tiles that the low mesh covers."""
    limit: float | None = _field("limit")
    """None for 5 % of the low mesh's radius."""
    depth: int = _field("depth")
    dither: bool = _field("dither")
    modifiers: str = _field("modifiers")
    image: str = _field("image")
    """Name of the image datablock. Empty to name it after the low object."""
    storage: str = _field("storage")
    output: str = _field("output")
    """The file to write, for storage FILE."""
    alpha: bool = _field("alpha")
    """Whether files have alpha."""
    mip_files: bool = _field("mip_files")
    """Whether files of mip levels are written, for storage FILE."""
    material: bool = _field("material")
    single_user: bool = _field("single_user")

    def read_by(self, engine: str) -> "Settings":
        """These settings, where basis AUTO is replaced by that of a render engine. engine: Blender's identifier."""
        if self.basis != bases.AUTO:
            return self
        return replace(self, basis=bases.of_engine(engine).name)

    def without_file(self) -> "Settings":
        """These settings for a map that goes into no file."""
        return replace(self, storage=Storage.PACK if self.udim else Storage.MEMORY, output="")

    def are_adaptive(self, method: str) -> bool:
        """Whether samples of a normal map alone are adaptive by this method."""
        return self.adaptive and method != Method.FLATTEN and self.samples >= ADAPTIVE_FROM

    @property
    def is_float(self) -> bool:
        """Whether images store floats, rather than steps from 0 to 1."""
        return file_formats.of(self.output).is_float if self.storage == Storage.FILE else self.depth > 8

    @property
    def mip_sizes(self) -> list[tuple[int, int]]:
        """The widths and heights of the mip levels that are written, from level 1 on, down to one texel."""
        if not (self.mip_files and self.storage == Storage.FILE):
            return []
        count = max(self.width, self.height).bit_length()
        return [(max(1, self.width >> level), max(1, self.height >> level)) for level in range(1, count)]

    @property
    def packing(self) -> Packing | None:
        """The layout of the packed image, or None without one."""
        if self.pack == Pack.CUSTOM:
            return Packing.of(CUSTOM_SUFFIX, self.pack_red, self.pack_green, self.pack_blue, self.pack_alpha)
        layout = PRESETS.get(self.pack)
        return layout.of_widened_roughness() if layout and WIDENED_ROUGHNESS.name in self.maps else layout

    @property
    def changes_materials(self) -> bool:
        """Whether maps are put into the materials of the low object."""
        return (self.material and self.normal) or self.connect_maps

    @property
    def drawn_maps(self) -> tuple[str, ...]:
        """The maps to draw beside the normal map: those in `maps`, and those that only the packed image stores."""
        wanted = {*self.maps, *(self.packing.maps if self.packing else ())}
        return tuple(name for name in NAMES if name in wanted)

    def for_drawing(self) -> "Settings":
        """These settings with `drawn_maps` as the maps."""
        return replace(self, maps=self.drawn_maps)

    def check(self) -> None:
        """Raise BakeError for settings that are not valid for any objects."""
        for name in (setting.name for setting in fields(self)):
            DECLARED[name].check(getattr(self, name))
        if len({axis[1] for axis in (self.red, self.green, self.blue)}) < 3:
            raise BakeError(
                f"Red, green and blue store {self.red}, {self.green} and {self.blue}: give each channel another axis."
            )
        if not (self.normal or self.drawn_maps):
            raise BakeError("No map is chosen: choose the normal map, another map, or maps to pack.")
        if self.packing and not self.packing.maps:
            raise BakeError("The packed image would hold no map: choose a map for one of its channels.")
        self._check_tiles()
        for text in (self.image, self.output):
            for placeholder in re.findall(r"\{\w*\}", text):
                if placeholder == MATERIAL and not self.texture_sets:
                    raise BakeError(f"{text!r} contains {MATERIAL} but Texture Sets is off: enable it.")
                if placeholder not in (LOW, MATERIAL):
                    raise BakeError(f"Unknown placeholder {placeholder} in {text!r}: use {LOW}, the low object's name.")
        if self.storage == Storage.FILE:
            self._check_output()

    def _check_tiles(self) -> None:
        udim.check(self.tiles)
        if self.tiles and not self.udim:
            raise BakeError("Tiles are set but UDIM Tiles is off: enable it.")
        if self.udim and self.storage == Storage.MEMORY:
            raise BakeError("Blender cannot keep UDIM tiles in memory alone: store them in a file, or packed.")

    def _check_output(self) -> None:
        if not self.output:
            raise BakeError("No file is set for the map: set one, or store the map packed.")
        depths = file_formats.of(self.output).depths
        if TOKEN in self.output and not self.udim:
            raise BakeError(f"{self.output!r} contains {TOKEN} but UDIM Tiles is off: enable it.")
        if self.udim and "%" in self.output:  # Blender takes it for a placeholder, and may crash
            raise BakeError(f"{self.output!r} contains %, which Blender does not take in the path of UDIM tiles.")
        if TOKEN in str(PurePath(self.output).parent):
            raise BakeError(
                f"{self.output!r} has {TOKEN} in a folder's name: Blender takes it only in the file's name."
            )
        stored = self.packing.channels[-1] if self.packing else WHITE
        if not self.alpha and stored != WHITE:
            what = f"the map {BY_NAME[stored.map].label}" if stored.map else "a number"
            raise BakeError(
                f"The packed image has {what} in its alpha, but the files are to have no alpha: choose one of the two."
            )
        if self.depth not in depths:
            ending = PurePath(self.output).suffix.lower()
            raise BakeError(
                f"A {ending} file stores {' or '.join(map(str, depths))} bits per channel, not {self.depth}."
            )
