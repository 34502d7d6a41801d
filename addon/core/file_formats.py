# SPDX-License-Identifier: GPL-3.0-or-later
"""The file formats of maps. To add one, add it to FORMATS: no other module names a format or a file ending."""

import math
from dataclasses import dataclass
from pathlib import PurePath
from types import MappingProxyType

from .errors import BakeError

LONGEST_SIDE = 16384
"""Texels. Direct3D 11 and later, and most GPUs, take no longer ones."""
USUAL_DEPTH = 16
"""The default bits per channel, for formats that have it."""


@dataclass(frozen=True)
class FileFormat:
    """One format.

    Attributes:
        label: Its name in Blender's interface.
        endings: Its file endings in lower case, the usual one first.
        depths: The bits per channel that it supports, in ascending order.
        is_float: Whether it stores floats, rather than steps from 0 to 1.
        is_blocks: Whether it stores blocks of texels as GPUs read them, with all mip levels in one file.
        has_alpha: Whether it can store alpha. Of blocks, their own format decides.
        clears_colors: Whether it loses colors where alpha is 0.
        has_quality: Whether it can be stored with losses, to be smaller.
        longest_side: The most texels of a side; infinite without a bound that maps reach.
        multiple: What the width and the height must be multiples of.
        is_shown: Whether Blender shows its files.
    """

    label: str
    endings: tuple[str, ...]
    depths: tuple[int, ...]
    is_float: bool = False
    is_blocks: bool = False
    has_alpha: bool = True
    clears_colors: bool = False
    has_quality: bool = False
    longest_side: float = math.inf
    multiple: int = 1
    is_shown: bool = True

    @property
    def has_map_in_alpha(self) -> bool:
        """Whether alpha can be a map, beside which all colors are kept."""
        return self.has_alpha and not self.clears_colors

    @property
    def usual_depth(self) -> int:
        """USUAL_DEPTH, or else the highest depth below it that the format has."""
        return max((depth for depth in self.depths if depth <= USUAL_DEPTH), default=self.depths[0])


PNG = FileFormat("PNG", (".png",), (8, 16))
OPEN_EXR = FileFormat("OpenEXR", (".exr",), (16, 32), is_float=True)
TIFF = FileFormat("TIFF", (".tif", ".tiff"), (8, 16))
TARGA = FileFormat("Targa", (".tga",), (8,))
DDS = FileFormat("DDS", (".dds",), (8,), is_blocks=True, longest_side=LONGEST_SIDE, multiple=4)
KTX2 = FileFormat("KTX2", (".ktx2",), (8,), is_blocks=True, longest_side=LONGEST_SIDE, is_shown=False)
# The longest side is by Google's "WebP Container Specification".
WEBP = FileFormat("WebP", (".webp",), (8,), clears_colors=True, has_quality=True, longest_side=16383)
JPEG = FileFormat("JPEG", (".jpg", ".jpeg"), (8,), has_alpha=False, has_quality=True)
FORMATS = (PNG, OPEN_EXR, TIFF, TARGA, DDS, KTX2, WEBP, JPEG)
BY_ENDING = MappingProxyType({ending: file_format for file_format in FORMATS for ending in file_format.endings})
MESHES = (".glb", ".usd", ".usda", ".usdc", ".fbx")
"""The endings of files of meshes with maps, for engines."""
OPENED = (".blend", ".obj", ".ply", ".stl", ".gltf", ".glb", ".fbx", ".usd", ".usda", ".usdc", ".usdz")
"""The endings of files whose meshes the command line bakes."""
SMOOTH_BELOW = 40
"""Degrees. Of the edges of smooth scans, 0.02 to 3 % are sharper; chamfers of hard parts have 45."""
PACKED = MappingProxyType({False: PNG, True: OPEN_EXR})
"""The formats in which Blender packs images, by whether their pixels are floats."""


def of(path: str | PurePath) -> FileFormat:
    """The format of a file by its ending. Raises BakeError for an unknown ending."""
    file_format = known(path)
    if file_format is None:
        raise BakeError(f"{str(path)!r} does not end in one of {', '.join(BY_ENDING)}.")
    return file_format


def known(path: str | PurePath) -> FileFormat | None:
    """The format of a file by its ending; None for an unknown one."""
    return BY_ENDING.get(PurePath(path).suffix.lower())


def check_size(path: str | PurePath, size: tuple[int, int]) -> None:
    """Raise BakeError for a width and a height that a file at `path` does not take, or no program loads from it."""
    file_format = of(path)
    what = f"A {file_format.label} file of {size[0]} x {size[1]} texels"
    if max(size) > file_format.longest_side:
        whose = "GPUs do not load" if file_format.is_blocks else f"{file_format.label} does not store"
        cure = (
            "choose a smaller size" if file_format.is_blocks else f"choose a smaller size, or a {PNG.endings[0]} file"
        )
        raise BakeError(f"{what} has a side above {file_format.longest_side:,}, which {whose}: {cure}.")
    if any(side % file_format.multiple for side in size):
        raise BakeError(
            f"{what} does not load in Direct3D, which takes multiples of {file_format.multiple}: choose another size, or a "
            f"{KTX2.endings[0]} file."
        )


def usual_depth(path: str) -> int:
    """The default bits per channel of the file at `path`."""
    file_format = known(path)
    return file_format.usual_depth if file_format else USUAL_DEPTH


def takes(path: str, depth: int) -> bool:
    """Whether a file at `path` stores so many bits per channel; True for a path without a known ending."""
    file_format = known(path)
    return file_format is None or depth in file_format.depths


def listed_meshes() -> str:
    """MESHES in a sentence."""
    *first, last = MESHES
    return f"{', '.join(first)} or {last}"


def listed(or_word: str = "or", bits: str = "bits") -> str:
    """All formats in a sentence, with their endings and depths. or_word, bits: these two words in the sentence's language."""
    return ", ".join(
        f"{file_format.label} ({f' {or_word} '.join(file_format.endings)}, "
        f"{f' {or_word} '.join(map(str, file_format.depths))} {bits})"
        for file_format in FORMATS
    )
