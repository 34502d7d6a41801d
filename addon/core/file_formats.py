# SPDX-License-Identifier: GPL-3.0-or-later
"""The file formats of maps. To add one, add it to FORMATS: no other module names a format or a file ending."""

from dataclasses import dataclass
from pathlib import PurePath
from types import MappingProxyType

from .errors import BakeError

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
    """

    label: str
    endings: tuple[str, ...]
    depths: tuple[int, ...]
    is_float: bool = False

    @property
    def usual_depth(self) -> int:
        """USUAL_DEPTH, or else the highest depth below it that the format has."""
        return max((depth for depth in self.depths if depth <= USUAL_DEPTH), default=self.depths[0])


PNG = FileFormat("PNG", (".png",), (8, 16))
OPEN_EXR = FileFormat("OpenEXR", (".exr",), (16, 32), is_float=True)
TIFF = FileFormat("TIFF", (".tif", ".tiff"), (8, 16))
TARGA = FileFormat("Targa", (".tga",), (8,))
FORMATS = (PNG, OPEN_EXR, TIFF, TARGA)
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
    ending = PurePath(path).suffix.lower()
    if ending not in BY_ENDING:
        raise BakeError(f"{str(path)!r} does not end in one of {', '.join(BY_ENDING)}.")
    return BY_ENDING[ending]


def usual_depth(path: str) -> int:
    """The default bits per channel of the file at `path`."""
    file_format = BY_ENDING.get(PurePath(path).suffix.lower())
    return file_format.usual_depth if file_format else USUAL_DEPTH


def takes(path: str, depth: int) -> bool:
    """Whether a file at `path` stores so many bits per channel; True for a path without a known ending."""
    file_format = BY_ENDING.get(PurePath(path).suffix.lower())
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
