# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a bake, as plain data. `declarations` holds their labels, tooltips, limits and defaults."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import PurePath
from typing import Any

from . import file_formats, map_types, udim
from .declarations import bases
from .declarations.all_settings import DECLARED
from .declarations.choices import Compression, Format, Method, Pack, Space, Storage, VertexDomain, Wrap
from .declarations.map_settings import ADAPTIVE_FROM
from .errors import BakeError
from .file_formats import FileFormat
from .map_types import (
    BY_NAME,
    CUSTOM_SUFFIX,
    NAMES,
    PACKINGS,
    VECTOR_DISPLACEMENT,
    WHITE,
    WIDENED_ROUGHNESS,
    MapType,
    Packing,
)
from .naming import LOW, MATERIAL, NAME
from .progress import Pace, Timings
from .udim import TOKEN


def _field(name: str) -> Any:
    """A field with the default that is declared for the setting `name`."""
    return field(default=DECLARED[name].default)


def _with_settings_of_maps(kind: type) -> type:
    """Add a field for each setting that a map declares."""
    for name in map_types.SETTINGS:
        kind.__annotations__[name] = Any
        setattr(kind, name, _field(name))
    return kind


@dataclass(frozen=True)
@_with_settings_of_maps
class MapSettings:
    """What the maps hold: which maps, of what, and how normals are written into channels; also the settings of single maps."""

    space: str = _field("space")
    basis: str = _field("basis")
    targets: tuple[str, ...] = _field("targets")
    """Names among declarations.targets.BY_NAME, in their order."""
    uv_layer: str = _field("uv_layer")
    modifiers: str = _field("modifiers")
    rest_pose: bool = _field("rest_pose")
    normal: bool = _field("normal")
    """Whether the normal map is stored."""
    mask: bool = _field("mask")
    maps: tuple[str, ...] = _field("maps")
    """Names among map_types.NAMES, in their order."""
    attribute: str = _field("attribute")
    """Empty for the color attribute that is set to render."""
    exact_materials: str = _field("exact_materials")
    detail_maps: bool = _field("detail_maps")
    edge_radius: float = _field("edge_radius")
    """In scene units. 0 leaves hard edges as they are."""
    appearance: bool = _field("appearance")
    """Whether the shading error of the normal map is measured."""
    missed: tuple[float, float, float] = _field("missed")
    red: str = _field("red")
    green: str = _field("green")
    blue: str = _field("blue")
    pack: str = _field("pack")
    pack_red: str = _field("pack_red")
    pack_green: str = _field("pack_green")
    pack_blue: str = _field("pack_blue")
    pack_alpha: str = _field("pack_alpha")
    texture_sets: bool = _field("texture_sets")

    @property
    def channels(self) -> tuple[str, str, str]:
        """The axes of normals in red, green and blue."""
        return self.red, self.green, self.blue

    @cached_property
    def packing(self) -> Packing | None:
        """The layout of the packed image, or None without one."""
        if self.pack == Pack.CUSTOM:
            return Packing.of(CUSTOM_SUFFIX, self.pack_red, self.pack_green, self.pack_blue, self.pack_alpha)
        layout = PACKINGS.get(self.pack)
        return layout.of_widened_roughness() if layout and WIDENED_ROUGHNESS.name in self.maps else layout

    def own(self, map_type: MapType) -> dict[str, Any]:
        """The settings that a map alone has, by their names."""
        return {name: getattr(self, name) for name in map_type.settings}

    @property
    def has_tangent_displacement(self) -> bool:
        """Whether the vector displacement is in tangent space."""
        is_drawn = VECTOR_DISPLACEMENT.name in self.drawn_maps
        is_turned = self.own(VECTOR_DISPLACEMENT)["tangent_displacement"]
        return is_drawn and is_turned and self.space == Space.TANGENT

    @cached_property
    def drawn_maps(self) -> tuple[str, ...]:
        """The maps to draw beside the normal map: those in `maps`, and those that only the packed image stores."""
        wanted = {*self.maps, *(self.packing.maps if self.packing else ())}
        return tuple(name for name in NAMES if name in wanted)


@dataclass(frozen=True)
class TracingSettings:
    """How the high objects are found from the low object, and what the rays of other maps meet. Distances in scene units."""

    method: str = _field("method")
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
    keep_faces: bool = _field("keep_faces")
    cut_outs: bool = _field("cut_outs")
    """Whether rays pass high meshes where the alpha of their materials is clear."""
    smooth_high: int = _field("smooth_high")
    limit: float | None = _field("limit")
    """None for 5 % of the low mesh's radius."""
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


@dataclass(frozen=True)
class SamplingSettings:
    """The texels of a map, in which sizes and the margin are counted, and the samples of each."""

    width: int = _field("width")
    height: int = _field("height")
    samples: int = _field("samples")
    adaptive: bool = _field("adaptive")
    """Whether samples are adaptive."""
    stacked: str = _field("stacked")
    margin: int | None = _field("margin")
    """None to fill the whole background."""
    margin_type: str = _field("margin_type")
    wrap: str = _field("wrap")
    mips: int = _field("mips")
    udim: bool = _field("udim")
    tiles: tuple[int, ...] = _field("tiles")
    """Empty for all tiles that the low mesh covers."""

    @property
    def size(self) -> tuple[int, int]:
        """The width and the height."""
        return self.width, self.height

    def are_adaptive(self, method: str) -> bool:
        """Whether samples of a normal map alone are adaptive by this method."""
        return self.adaptive and method != Method.FLATTEN and self.samples >= ADAPTIVE_FROM


@dataclass(frozen=True)
class StorageSettings:
    """Where the maps are stored, in how many bits per channel, and what is connected to them."""

    depth: int = _field("depth")
    dither: bool = _field("dither")
    value_range: float | None = _field("value_range")
    """In scene units. None for the largest value of each bake."""
    low_suffix: str = _field("low_suffix")
    """The ending of the low object's name, which NAME leaves out."""
    image: str = _field("image")
    """Name of the image datablock. Empty to name it after the low object."""
    storage: str = _field("storage")
    output: str = _field("output")
    """The file to write, for storage FILE."""
    alpha: bool = _field("alpha")
    """Whether files have alpha."""
    mip_files: bool = _field("mip_files")
    """Whether files of mip levels are written, for storage FILE."""
    format: str = _field("format")
    most_degrees: float = _field("most_degrees")
    most_steps: float = _field("most_steps")
    compression: str = _field("compression")
    """Of blocks. In the settings of one map, as map_names.settings_by_map has them, never AUTO."""
    quality: int = _field("quality")
    lossy_normals: bool = _field("lossy_normals")
    export_webp: bool = _field("export_webp")
    """Whether maps in an exported .glb are WebP."""
    export_ktx2: bool = _field("export_ktx2")
    """Whether they are KTX2."""
    vertex_domain: str = _field("vertex_domain")
    connect_maps: bool = _field("connect_maps")
    material: bool = _field("material")
    single_user: bool = _field("single_user")
    one_material: bool = _field("one_material")
    """Whether the maps replace all materials, whatever connect_maps and material say."""

    @property
    def is_float(self) -> bool:
        """Whether images store floats, rather than steps from 0 to 1."""
        if self.is_blocks:
            return self.compression == Compression.BC6H
        return self._file_format.is_float if self.storage == Storage.FILE else self.depth > 8

    @property
    def is_blocks(self) -> bool:
        """Whether files store blocks of texels, with their mip levels inside."""
        file_format = file_formats.known(self.output) if self.storage == Storage.FILE else None
        return file_format is not None and file_format.is_blocks

    @property
    def is_auto(self) -> bool:
        """Whether the smallest format of each map is looked for."""
        return self.format == Format.AUTO and self.storage == Storage.FILE

    @property
    def has_open_ending(self) -> bool:
        """Whether the ending of each file is chosen, too."""
        return self.is_auto and bool(self.output) and not PurePath(self.output).suffix

    @property
    def _file_format(self) -> FileFormat:
        """That of the file, of which PNG stands for one that is chosen later."""
        return file_formats.PNG if self.has_open_ending else file_formats.of(self.output)

    @property
    def is_half(self) -> bool:
        """Whether files store floats of 16 bits."""
        return self.storage == Storage.FILE and self.is_float and (self.is_blocks or self.depth == 16)

    @property
    def has_alpha(self) -> bool:
        """Whether images keep alpha. In the settings of one map: see `compression`."""
        if self.storage != Storage.FILE:
            return True
        has_room = self.compression == Compression.BC7 if self.is_blocks else self._file_format.has_alpha
        return self.alpha and has_room

    @property
    def is_lossy(self) -> bool:
        """Whether files change texels a little each time that they are written. In the settings of one map."""
        if self.storage != Storage.FILE:
            return False
        file_format = self._file_format
        return file_format.is_blocks or (
            file_format.has_quality and not (self.quality == 100 and file_format.has_alpha)
        )


@dataclass(frozen=True, init=False)
class Settings:
    """One bake, in four parts: code that needs one part alone takes that part.

    Each setting has a name of its own in all of them: reports, presets, job files and calls name it without its part.
    """

    map: MapSettings
    tracing: TracingSettings
    sampling: SamplingSettings
    storing: StorageSettings

    def __init__(self, **values: Any):
        """Take settings by their names, also beside whole parts, so that `replace` changes single settings.

        Args:
            values: settings by their names in `DECLARED`, and parts by theirs. The others have their defaults.
        """
        for part, kind in PARTS.items():
            own = {each.name: values.pop(each.name) for each in fields(kind) if each.name in values}
            object.__setattr__(self, part, replace(values.pop(part, kind()), **own))
        if values:
            raise TypeError(f"Unknown settings: {', '.join(values)}")

    @classmethod
    def of_json(cls, values: Mapping[str, Any]) -> "Settings":
        """The settings that `flat` made, also after they were stored as JSON, which has lists where settings have tuples."""
        return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})

    def flat(self) -> dict[str, Any]:
        """All settings by their names, in the order of the panels."""
        return {name: getattr(getattr(self, part), name) for name, part in PART_OF.items()}

    def read_by(self, engine: str) -> "Settings":
        """These settings, where basis AUTO is replaced by that of a render engine. engine: Blender's identifier."""
        if self.map.basis != bases.AUTO:
            return self
        return self.mapped(basis=bases.of_engine(engine).name)

    def without_file(self) -> "Settings":
        """These settings for a map that goes into no file."""
        return self.stored(storage=Storage.PACK if self.sampling.udim else Storage.MEMORY, output="")

    def without_materials(self) -> "Settings":
        """These settings for maps that are put into no material and no attribute."""
        return self.stored(material=False, connect_maps=False, one_material=False, vertex_domain=VertexDomain.NONE)

    def without_other_maps(self) -> "Settings":
        """These settings for the normal map alone."""
        return self.mapped(normal=True, mask=False, maps=(), pack=Pack.NONE)

    def of_shapes(self) -> "Settings":
        """These settings to read the shapes of high meshes alone: rays need neither UVs nor materials."""
        return self.without_other_maps().mapped(detail_maps=False, edge_radius=0.0).traced(method=Method.CAST)

    def mapped(self, **maps: Any) -> "Settings":
        """These settings with some of MapSettings: `settings.mapped(space=Space.WORLD)`."""
        return replace(self, map=replace(self.map, **maps))

    def traced(self, **tracing: Any) -> "Settings":
        """These settings with some of TracingSettings: `settings.traced(method=Method.CAST)`."""
        return replace(self, tracing=replace(self.tracing, **tracing))

    def sampled(self, **sampling: Any) -> "Settings":
        """These settings with some of SamplingSettings: `settings.sampled(samples=1)`."""
        return replace(self, sampling=replace(self.sampling, **sampling))

    def stored(self, **storing: Any) -> "Settings":
        """These settings with some of StorageSettings: `settings.stored(image="atlas")`."""
        return replace(self, storing=replace(self.storing, **storing))

    def of_at_most(self, side: int) -> "Settings":
        """These settings with at most this many texels a side, in the same proportions."""
        shrink = max(1.0, max(self.sampling.size) / side)
        width, height = (max(1, round(texels / shrink)) for texels in self.sampling.size)
        return self.sampled(width=width, height=height)

    @property
    def mip_sizes(self) -> list[tuple[int, int]]:
        """The widths and heights of the mip levels that are written, from level 1 on, down to one texel."""
        if self.storing.storage != Storage.FILE or not (self.storing.mip_files or self.storing.is_blocks):
            return []
        width, height = self.sampling.size
        return [
            (max(1, width >> level), max(1, height >> level)) for level in range(1, max(width, height).bit_length())
        ]

    @property
    def changes_materials(self) -> bool:
        """Whether maps are put into the materials of the low object."""
        return (self.storing.material and self.map.normal) or self.storing.connect_maps

    def check(self) -> None:
        """Raise BakeError for settings that are not valid for any objects."""
        if problem := next(self.problems(), ""):
            raise BakeError(problem)

    def problems(self) -> Iterator[str]:
        """Why these settings are not valid for any objects, in sentences. Wrong values hide what depends on them."""
        wrong = [text for name, value in self.flat().items() for text in _faults(partial(DECLARED[name].check, value))]
        yield from wrong
        if wrong:
            return
        red, green, blue = self.map.channels
        if len({axis[1] for axis in self.map.channels}) < 3:
            yield f"Red, green and blue store {red}, {green} and {blue}: give each channel another axis."
        if not (self.map.normal or self.map.drawn_maps):
            yield "No map is chosen: choose the normal map, another map, or maps to pack."
        if self.map.packing and not self.map.packing.maps:
            yield "The packed image would hold no map: choose a map for one of its channels."
        yield from self._wrong_tiles()
        if self.map.texture_sets and self.storing.one_material:
            yield "Texture sets have an image for each material, and one material has one: choose one of them."
        for text in (self.storing.image, self.storing.output):
            for placeholder in dict.fromkeys(re.findall(r"\{\w*\}", text)):
                if placeholder == MATERIAL and not self.map.texture_sets:
                    yield f"{text!r} contains {MATERIAL} but Texture Sets is off: enable it."
                if placeholder not in (LOW, NAME, MATERIAL):
                    yield f"Unknown placeholder {placeholder} in {text!r}: use {LOW}, the low object's name."
        if self.storing.export_webp and self.storing.export_ktx2:
            yield "The maps of an exported .glb cannot be both WebP and KTX2: choose one of them."
        if self.storing.storage == Storage.FILE:
            yield from self._wrong_output()

    def _wrong_tiles(self) -> Iterator[str]:
        yield from _faults(partial(udim.check, self.sampling.tiles))
        if self.sampling.tiles and not self.sampling.udim:
            yield "Tiles are set but UDIM Tiles is off: enable it."
        if self.sampling.wrap != Wrap.NONE and self.sampling.udim:
            yield "A map that wraps around is one tile: turn Wrap or UDIM Tiles off."
        if self.sampling.wrap != Wrap.NONE and self.tracing.method == Method.FLATTEN:
            yield "Flatten does not wrap around: choose Cast or Auto as the method, or turn Wrap off."
        if self.sampling.udim and self.storing.storage == Storage.MEMORY:
            yield "Blender cannot keep UDIM tiles in memory alone: store them in a file, or packed."

    def _wrong_output(self) -> Iterator[str]:
        storing = self.storing
        if not storing.output:
            yield "No file is set for the map: set one, or store the map packed."
            return
        output = storing.output + file_formats.PNG.endings[0] * storing.has_open_ending
        unknown = list(_faults(partial(file_formats.of, output)))
        yield from unknown
        if TOKEN in storing.output and not self.sampling.udim:
            yield f"{storing.output!r} contains {TOKEN} but UDIM Tiles is off: enable it."
        if self.sampling.udim and "%" in storing.output:  # Blender takes it for a placeholder, and may crash
            yield f"{storing.output!r} contains %, which Blender does not take in the path of UDIM tiles."
        if TOKEN in str(PurePath(storing.output).parent):
            yield f"{storing.output!r} has {TOKEN} in a folder's name: Blender takes it only in the file's name."
        stored = self.map.packing.channels[-1] if self.map.packing else WHITE
        what = (
            f"The packed image has {f'the map {BY_NAME[stored.map].label}' if stored.map else 'a number'} in its alpha"
        )
        if not storing.alpha and stored != WHITE:
            yield f"{what}, but the files are to have no alpha: choose one of the two."
        if unknown:
            return
        file_format, ending = file_formats.of(output), PurePath(output).suffix.lower()
        if storing.alpha and stored != WHITE and not file_format.has_map_in_alpha:
            lost = "lose colors where alpha is 0" if file_format.has_alpha else "have no alpha"
            yield f"{what}, but {ending} files {lost}: choose another format, such as {file_formats.PNG.endings[0]}."
        if storing.depth not in file_format.depths:
            depths = " or ".join(map(str, file_format.depths))
            yield f"A {ending} file stores {depths} bits per channel, not {storing.depth}."
        yield from _faults(partial(file_formats.check_size, output, self.sampling.size))
        if self.sampling.udim and not file_format.is_shown:
            yield f"Blender shows no UDIM tiles of {ending} files: choose a .dds file, or turn UDIM Tiles off."


def _faults(check: Callable[[], object]) -> Iterator[str]:
    """What a check raises, in a sentence."""
    try:
        check()
    except BakeError as error:
        yield str(error)


PARTS = {"map": MapSettings, "tracing": TracingSettings, "sampling": SamplingSettings, "storing": StorageSettings}
"""The parts of Settings by their names."""

_PART_OF = {each.name: part for part, kind in PARTS.items() for each in fields(kind)}
PART_OF: dict[str, str] = {name: _PART_OF[name] for name in DECLARED if name in _PART_OF}
"""The part of each setting by its name, in the order of the panels."""


@dataclass(frozen=True)
class Run:
    """A bake that is under way: what it makes, how its work is sliced, and the seconds of its stages."""

    settings: Settings
    pace: Pace = field(default_factory=Pace)
    timings: Timings = field(default_factory=Timings)
