# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake is asked to do, as plain data."""

import re
from dataclasses import dataclass, replace
from pathlib import PurePath

from . import file_formats, map_types, udim
from .errors import BakeError
from .udim import TOKEN

SPACES = ("TANGENT", "OBJECT", "WORLD")
BASES = ("AUTO", "BLENDER", "MIKKTSPACE")
METHODS = ("AUTO", "FLATTEN", "CAST")
DIRECTIONS = ("SMOOTH", "SPLIT")
AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
MARGINS = ("EXTEND", "ADJACENT_FACES")
SAMPLES = (1, 2, 4, 8, 16, 64)
MODIFIERS = ("RENDER", "VIEWPORT")
STORAGES = ("PACK", "FILE", "MEMORY")
MIN_SIZE, MAX_SIZE = 16, 16384
MAX_MIPS = 8
FARTHEST = 1e18
"""Of distances: a float holds its square."""


def is_number(text: str) -> bool:
    """Whether a word is a whole number, without a sign and of a length that Python reads."""
    return text.isdecimal() and len(text) < 100


@dataclass(frozen=True)
class Settings:
    """One bake. Sizes and margin in texels, depth in bits a channel."""

    method: str = "AUTO"
    space: str = "TANGENT"
    basis: str = "AUTO"
    """What the tangent-space map is decoded with: BLENDER is Cycles' Normal Map node, MIKKTSPACE the reference, as EEVEE
    and game engines have it, AUTO the one that the scene's render engine has."""
    uv_layer: str = ""
    """The low mesh's UV layer; empty for its active one."""
    width: int = 2048
    height: int = 2048
    samples: int = 1
    """How many samples a texel takes; the mean of several is antialiased."""
    extrusion: float | None = None
    """How far outside the low mesh rays start, in scene units; None measures it. A cage takes its place."""
    max_distance: float | None = None
    """How far rays go from where they start, in scene units; None measures it."""
    directions: str = "SMOOTH"
    """Rays along the low mesh's vertex normals, or along its own split ones, which leave gaps at hard edges."""
    facing_only: bool = False
    """Whether rays pass through high triangles that turn their back on them."""
    missed: tuple[float, float, float] = (0.5, 0.5, 1.0)
    """The colour of texels whose ray hit nothing; their alpha is 0."""
    mask: bool = False
    """Whether a second image shows which texels were missed."""
    maps: tuple[str, ...] = ()
    """What else is baked, some of map_types.NAMES: an image each, named after the map."""
    red: str = "+X"
    green: str = "+Y"
    blue: str = "+Z"
    """Which component of the normal each channel holds: one of AXES."""
    margin: int | None = 16
    """How far around the islands texels are filled; None for as far as the map goes."""
    margin_type: str = "EXTEND"
    """With the nearest texel, or with what lies across the seam on the surface."""
    mips: int = 3
    """The smallest mip level on which UV islands are to keep apart: it takes 2 to its power texels between them."""
    udim: bool = False
    """Whether each UDIM tile that the low mesh covers gets a map of its own."""
    tiles: tuple[int, ...] = ()
    """Of these tiles alone, as 1002; empty for all that the low mesh covers."""
    limit: float | None = None
    """How far from the low surface the high one may lie, in scene units, before it is told; None for 5 % of the low
    mesh's radius."""
    depth: int = file_formats.USUAL_DEPTH
    dither: bool = False
    """Whether 8 bits are dithered, or rounded."""
    modifiers: str = "RENDER"
    """Whether modifiers count as they are set for rendering or for the viewport."""
    image: str = ""
    """Name of the image datablock; empty for one named after the low object."""
    storage: str = "PACK"
    output: str = ""
    """The file to write, for storage FILE."""
    material: bool = True
    """Whether to hook the map into the low object's material."""
    single_user: bool = False
    """Whether materials that other objects use as well are copied first."""

    def read_by(self, engine: str) -> "Settings":
        """With the basis that a render engine reads, by Blender's name for it, where the basis is AUTO."""
        if self.basis != "AUTO":
            return self
        return replace(self, basis="BLENDER" if engine == "CYCLES" else "MIKKTSPACE")

    @property
    def is_float(self) -> bool:
        """Whether images store values as they are, rather than steps from 0 to 1."""
        return file_formats.of(self.output).is_float if self.storage == "FILE" else self.depth > 8

    def check(self) -> None:
        """Raise BakeError for what no bake can do, whatever the objects are."""
        for name, value, known in (
            ("method", self.method, METHODS),
            ("space", self.space, SPACES),
            ("basis", self.basis, BASES),
            ("directions", self.directions, DIRECTIONS),
            ("red channel", self.red, AXES),
            ("green channel", self.green, AXES),
            ("blue channel", self.blue, AXES),
            ("margin type", self.margin_type, MARGINS),
            ("modifiers", self.modifiers, MODIFIERS),
            ("storage", self.storage, STORAGES),
            ("depth", self.depth, file_formats.DEPTHS),
            ("number of samples", self.samples, SAMPLES),
        ):
            if value not in known:
                raise BakeError(f"The {name} {value!r} is not one of {', '.join(map(str, known))}.")
        self._check_map()
        self._check_distances()
        for text in (self.image, self.output):
            for word in re.findall(r"\{\w*\}", text):
                if word != "{low}":
                    raise BakeError(
                        f"Nothing is known to stand for {word} in {text!r}: {{low}} is the low object's name."
                    )
        if self.storage == "FILE":
            self._check_output()

    def _check_map(self) -> None:
        if not all(MIN_SIZE <= side <= MAX_SIZE for side in (self.width, self.height)):
            raise BakeError(
                f"A map of {self.width} x {self.height} texels cannot be baked: each side takes {MIN_SIZE} to {MAX_SIZE}."
            )
        if self.margin is not None and not 0 <= self.margin <= MAX_SIZE:
            raise BakeError(f"A margin of {self.margin} texels cannot be baked: it takes 0 to {MAX_SIZE}, or no limit.")
        if not 0 <= self.mips <= MAX_MIPS:
            raise BakeError(f"Mip level {self.mips} is not one of 0 to {MAX_MIPS}.")
        if len({axis[1] for axis in (self.red, self.green, self.blue)}) < 3:
            raise BakeError(
                f"Red, green and blue hold {self.red}, {self.green} and {self.blue}: each axis takes a channel of its own."
            )
        unknown = [name for name in self.maps if name not in map_types.NAMES]
        if unknown:
            raise BakeError(f"The map {unknown[0]!r} is not one of {', '.join(map_types.NAMES)}.")
        udim.check(self.tiles)
        if self.tiles and not self.udim:
            raise BakeError("Tiles are named, but the map is to have one tile alone: choose UDIM as well.")
        if self.udim and self.storage == "MEMORY":
            raise BakeError("Blender keeps UDIM tiles in files or packed, not in memory alone: choose one of the two.")
        if not all(0.0 <= value <= 1.0 for value in self.missed):
            raise BakeError(f"The colour of misses {self.missed} is none: it takes three numbers from 0 to 1.")

    def _check_distances(self) -> None:
        if self.extrusion is not None and not 0.0 <= self.extrusion <= FARTHEST:
            raise BakeError(f"The extrusion of {self.extrusion} is no distance: it takes 0 to {FARTHEST:g}.")
        if self.max_distance is not None and not 0.0 < self.max_distance <= FARTHEST:
            raise BakeError(
                f"The maximum distance of {self.max_distance} is no distance: it takes more than 0, up to {FARTHEST:g}."
            )
        if self.limit is not None and not 0.0 < self.limit <= FARTHEST:
            raise BakeError(f"The limit of {self.limit} is no distance: it takes more than 0, up to {FARTHEST:g}.")

    def _check_output(self) -> None:
        if not self.output:
            raise BakeError(
                "The map is to be saved to a file, but no file is named: give a path, or choose to pack it."
            )
        file_format = file_formats.of(self.output)
        if TOKEN in self.output and not self.udim:
            raise BakeError(
                f"{self.output!r} holds {TOKEN}, but the map is to have one tile alone: choose UDIM as well."
            )
        if TOKEN in str(PurePath(self.output).parent):
            raise BakeError(
                f"{self.output!r} has {TOKEN} in a folder's name: Blender looks for it in the file's alone."
            )
        depths = file_format.depths
        if self.depth not in depths:
            ending = PurePath(self.output).suffix.lower()
            raise BakeError(f"A {ending} file holds {' or '.join(map(str, depths))} bits a channel, not {self.depth}.")
