# SPDX-License-Identifier: GPL-3.0-or-later
"""A map on its way into an image datablock, and into files."""

import re
import tempfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path, PurePath

import bpy
import numpy as np

from ..core import file_formats, udim
from ..core.errors import BakeError, shorten_list
from ..core.map_types import MapType
from ..core.settings import Settings
from ..core.udim import TOKEN
from . import atomic_file, datablocks, image_encoding, quantize
from .atomic_file import Partial, check_writable

LONGEST = 240
"""Bytes of an image's name: Blender takes 255, and the names of other maps end in a word more."""


def name_for(low_name: str, settings: Settings) -> str:
    """The name of the image datablock; "{low}" in it stands for the low object's.

    One that Blender would cut, so that the image were not found again, is cut here, and others cut alike stay apart.
    """
    name = settings.image.replace("{low}", low_name) or f"{low_name}_normal"
    letters = name.encode()
    if len(letters) <= LONGEST:
        return name
    return f"{letters[: LONGEST - 9].decode(errors='ignore')}_{zlib.crc32(letters):08x}"


def output_for(settings: Settings) -> str:
    """The path to write to as Blender takes it, with TOKEN for the tile's number in a UDIM bake; empty for no file."""
    path = settings.output
    if settings.storage != "FILE":
        return ""
    if settings.udim and TOKEN not in path:
        ending = PurePath(path).suffix
        path = f"{path.removesuffix(ending)}.{TOKEN}{ending}"
    return path


def beside(settings: Settings, map_type: MapType) -> Settings:
    """The settings of another map beside that of `settings`, whose image is named.

    A map that is stored in the lowest depth is not dithered.
    """
    path = PurePath(settings.output)
    is_file = settings.storage == "FILE"
    lowest = (file_formats.of(path) if is_file else file_formats.PACKED[False]).depths[0]
    # The number of a tile stays last, with what parts it from the name.
    stem = re.sub(rf"[._ -]?{TOKEN}|$", rf"_{map_type.suffix}\g<0>", path.stem, count=1)
    return replace(
        settings,
        image=f"{settings.image}_{map_type.suffix}",
        output=str(path.with_stem(stem)) if is_file else "",
        depth=settings.depth if map_type.is_deep else lowest,
        dither=settings.dither and map_type.is_deep,
    )


def black_and_white(where: np.ndarray) -> np.ndarray:
    """Texels (height, width, 4) float32 that are white where `where` (height, width) is true."""
    texels = np.ones((*where.shape, 4), np.float32)
    texels[..., :3] = where[..., None]
    return texels


def check(low_name: str, settings: Settings) -> None:
    """Raise BakeError if a map cannot be put where the settings want it, before anything is baked."""
    _check_image(settings.image or name_for(low_name, settings))
    output = output_for(settings)
    if output.startswith("//") and not bpy.data.filepath:
        raise BakeError(f"{output!r} is relative to a .blend file that was never saved: save it first.")
    if output:
        check_writable(_absolute(output))


def replaced(name: str, highs: Iterable[str]) -> str:
    """Whose map a bake from `highs` writes over in the image `name`, as names in a sentence: empty where it has none, where
    nobody knows, and where one of `highs` was among those that it came from."""
    before = datablocks.origin(name)
    return "" if set(before).intersection(highs) else shorten_list(map(repr, before))


class Writer:
    """A map on its way into an image datablock, and files. Nothing of the artist's changes before commit.

    Tiles for files, and for packing as UDIM, are encoded as they come, so that memory does not grow with their number.
    To be used in a with statement, or discarded in the end.

    is_normal: whether to measure what normals lose by being stored in whole numbers.
    """

    def __init__(self, low_name: str, settings: Settings, *, is_normal: bool = False):
        self.name, self.settings, self.is_normal = settings.image or name_for(low_name, settings), settings, is_normal
        self._texels: np.ndarray | None = None
        self._partials: dict[int, Partial] = {}
        self._folder: tempfile.TemporaryDirectory | None = None
        self._path = output_for(settings)
        """Of the files, as for Blender; empty where there are none."""
        if settings.storage == "PACK" and settings.udim:  # Blender packs tiles out of files alone
            self._folder = tempfile.TemporaryDirectory(prefix="imprint-")
            self._path = str(Path(self._folder.name, f"map.{TOKEN}{file_formats.PACKED[settings.is_float].endings[0]}"))
        self._angles: list[np.ndarray] = []
        self.tiles: list[int] = []
        """What was added."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.discard()

    def add(self, tile: int, texels: np.ndarray) -> None:
        """Take the map of one UDIM tile, (height, width, 4) float32 with row 0 at v = 0; of 1001 where there is but one.

        Raises BakeError if it cannot be written.
        """
        settings = self.settings
        self.tiles.append(tile)
        stored = quantize.dithered(texels) if settings.dither and settings.depth == 8 else texels  # else Blender rounds
        if self.is_normal and not settings.is_float:
            rounded = quantize.rounded(quantize.sample(stored), settings.depth)
            self._angles.append(quantize.angles(quantize.sample(texels), rounded))
        if self._path:
            partial = self._partials[tile] = Partial(self._of_tile(tile))
            # Packed as Blender packs other images, whose floats have 32 bits.
            depth = file_formats.OPEN_EXR.depths[-1] if self._folder and settings.is_float else settings.depth
            with partial.told():
                image_encoding.write(stored, partial.here, depth)
        else:
            self._texels = stored

    @property
    def paths(self) -> list[str]:
        """What is written to disk, by tile: whole paths, links as they are called."""
        return [] if self._folder else [str(self._of_tile(tile)) for tile in sorted(self._partials)]

    def _of_tile(self, tile: int) -> Path:
        return _absolute(udim.fill(self._path, tile))

    @property
    def loss(self) -> dict[str, float]:
        """Median and maximum of the degrees by which normals were turned; empty where they are stored as floats."""
        if not self._angles:
            return {}
        angles = np.concatenate(self._angles)
        return {"median": float(np.median(angles)), "maximum": float(angles.max())} if len(angles) else {}

    def commit(self) -> bpy.types.Image:
        """As `commit_all`, for this map alone."""
        return commit_all([self])[0]

    def prepare(self) -> None:
        """All that may be refused, with BakeError, and all that takes room on a disk: nothing is in its place yet."""
        _check_image(self.name)  # an artist may have painted since
        if self._path and self.settings.udim:
            self._keep_other_tiles()

    def put_files(self) -> None:
        """Put the files into their places. Raises BakeError if one cannot be."""
        for partial in self._partials.values():
            partial.commit()

    def show(self) -> bpy.types.Image:
        """The image with what was added."""
        settings = self.settings
        if self._path:
            return datablocks.show(self.name, self._path, pack=self._folder is not None)
        pack = settings.storage == "PACK"
        return datablocks.fill(self.name, self._texels, is_float=settings.is_float, pack=pack)

    def discard(self) -> None:
        """Leave nothing behind of what was not committed. May be called at any time, and again."""
        for partial in self._partials.values():
            partial.discard()
        if self._folder:
            self._folder.cleanup()

    def _keep_other_tiles(self) -> None:
        """Take along the tiles of the image that were not baked, unless their files are in the place of this map."""
        image = datablocks.get(self.name)
        if image is None or image.source != "TILED":
            return
        with next(iter(self._partials.values())).here.open("rb") as file:
            start = file.read(2)  # in which formats differ
        for tile, content in datablocks.tile_contents(image):
            partial = Partial(self._of_tile(tile))
            if tile in self._partials or (isinstance(content, Path) and content.resolve() == partial.path):
                continue
            with partial.told():
                data = content.read_bytes() if isinstance(content, Path) else content
                is_there = partial.path.exists()
                if (data != partial.path.read_bytes()) if is_there else (data[:2] != start):
                    raise BakeError(
                        f"Tile {tile} of the image {self.name!r} would be lost: bake it as well, or choose another name."
                    )
                if not is_there:
                    self._partials[tile] = partial
                    partial.here.write_bytes(data)


def commit_all(writers: Sequence[Writer]) -> list[bpy.types.Image]:
    """Put what was added to all of `writers` where their settings want it. Images are Non-Color and channel-packed.

    Raises BakeError if that cannot be done for one of them; then all images and files are as they were.
    """
    for writer in writers:
        writer.prepare()
    with atomic_file.together():
        for writer in writers:
            writer.put_files()
        return [writer.show() for writer in writers]


def _check_image(name: str) -> None:
    image = datablocks.get(name)
    if image is None:
        return
    if (
        image.source not in {"GENERATED", "FILE", "TILED", *(["SEQUENCE"] if image.get("imprint") else [])}
        or image.type not in {"IMAGE", "UV_TEST"}
        or image.is_multiview
    ):
        raise BakeError(f"The image {name!r} is no single still picture: choose another name for the map.")
    if image.source == "TILED" and image.is_dirty:
        raise BakeError(f"The image {name!r} has tiles with unsaved changes: save or pack it first.")


def _absolute(path: str) -> Path:
    return Path(bpy.path.abspath(path)).absolute()
