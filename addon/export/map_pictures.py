# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps of a bake as PNG files of 8 bits, as engines take them, and files of a material's other textures."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, count
from pathlib import Path

import bpy
import numpy as np

from ..core import file_formats, foreach
from ..core.errors import BakeError
from ..core.naming import file_name
from ..core.udim import FIRST
from ..output import datablocks, image_file, value_encoding
from ..output.value_encoding import SRGB

CHANNELS = ("+X", "+Y", "+Z")
"""The axes in red, green and blue that glTF and USD expect."""


def pixels(image: bpy.types.Image) -> np.ndarray:
    """The pixels (height, width, 4) float32 of an image without tiles, row 0 at v = 0: stored values, or linear floats.

    Raises BakeError if it has none.
    """
    if not min(image.size):
        raise BakeError(f"The image {image.name!r} has no pixels: its file is missing, or was not read.")
    return foreach.pixels(image)


@contextmanager
def one_tile(image: bpy.types.Image, tile: int, folder: Path) -> Iterator[bpy.types.Image]:
    """An image without tiles that shows one UDIM tile of `image`; `image` itself if it has no tiles. Raises BakeError.

    folder: for temporary files.
    """
    if image.source != "TILED":
        yield image
        return
    source = next((content for number, content in datablocks.tile_contents(image) if number == tile), None)
    if source is None:
        raise BakeError(f"The image {image.name!r} has no tile {tile}: bake it as well.")
    if not isinstance(source, Path):
        path = folder / f"one tile{Path(image.filepath).suffix}"
        path.write_bytes(source)
        source = path
    with loaded(source) as part:
        part.colorspace_settings.name = image.colorspace_settings.name
        datablocks.keep_values(part, "" if image.colorspace_settings.is_data else image.colorspace_settings.name)
        yield part


@contextmanager
def loaded(path: Path) -> Iterator[bpy.types.Image]:
    """The file at `path` as an image of data, which is removed at the end of the block. Raises BakeError."""
    try:
        image = bpy.data.images.load(str(path), check_existing=False)
    except RuntimeError as error:
        raise BakeError(f"{str(path)!r} could not be read: {error}.") from error
    try:
        datablocks.keep_values(image)
        yield image
    finally:
        bpy.data.images.remove(image)


def turned(texels: np.ndarray, stored: Sequence[str], wanted: Sequence[str] = CHANNELS) -> np.ndarray:
    """Texels (..., 4) of a normal map whose channels store the axes `stored`, with those that are `wanted` instead."""
    if tuple(stored) == tuple(wanted):
        return texels
    result = texels.copy()
    for channel, axis in enumerate(wanted):
        source = next(number for number, other in enumerate(stored) if other[1] == axis[1])
        values = texels[..., source]
        result[..., channel] = values if stored[source] == axis else 1.0 - values
    return result


def directions(texels: np.ndarray) -> np.ndarray:
    """The tangent-space vectors (..., 3) float64 of texels whose channels store CHANNELS."""
    return texels[..., :3].astype(np.float64) * 2.0 - 1.0


class PictureFiles:
    """Writes maps and other textures as files into a folder, each once, and shows them in temporary images."""

    def __init__(self, folder: Path, made: list[bpy.types.ID], before_names: str):
        """made: receives the images, which the caller removes. before_names: what the files' names begin with."""
        self._folder, self._made, self._before_names = folder, made, before_names
        self._images: dict[tuple, bpy.types.Image] = {}
        self._names: set[str] = set()

    def normal_map(
        self, image: bpy.types.Image, tile: int, stored: Sequence[str], wanted: Sequence[str], *, dither: bool
    ) -> bpy.types.Image:
        """A normal map in 8 bits, with other channels. stored, wanted: as in `turned`. Raises BakeError."""
        key = (image.name, tile)
        if key not in self._images:
            with one_tile(image, tile, self._folder) as part:
                texels = turned(pixels(part), stored, wanted)
                is_fine = part.is_float
            if dither and is_fine:
                texels = value_encoding.dithered(texels)
            self._images[key] = self._written(texels, self._name(image, tile), "", has_alpha=False)
        return self._images[key]

    def other_map(self, image: bpy.types.Image, tile: int, *, has_alpha: bool) -> bpy.types.Image:
        """Another map in 8 bits; colors in sRGB. Raises BakeError."""
        key = (image.name, tile)
        if key not in self._images:
            is_data = image.colorspace_settings.is_data
            with one_tile(image, tile, self._folder) as part:
                texels = pixels(part)
                if part.is_float and not is_data:
                    texels[..., :3] = _srgb(texels[..., :3])
            color_space = "" if is_data else "sRGB"
            self._images[key] = self._written(texels, self._name(image, tile), color_space, has_alpha=has_alpha)
        return self._images[key]

    def own_file(self, image: bpy.types.Image) -> bpy.types.Image:
        """Another texture of a material, with a file whose name no other one has. Raises BakeError.

        It is the image itself if that has no file, or several, or is one of these files.
        """
        key = (image.name_full, None)
        if image in self._images.values() or image.source not in {"FILE", "GENERATED"}:
            return image
        if key not in self._images:
            if image.source == "GENERATED" or image.is_dirty:
                return self.other_map(image, FIRST, has_alpha=True)
            source = Path(bpy.path.abspath(image.filepath, library=image.library))
            if image.packed_file is None and not source.is_file():
                return image
            content = image.packed_file.data if image.packed_file is not None else source.read_bytes()
            path = self._path(image.name.removesuffix(source.suffix), source.suffix)
            path.write_bytes(content)
            self._images[key] = self._shown(path)
            self._images[key].colorspace_settings.name = image.colorspace_settings.name
            self._images[key].alpha_mode = image.alpha_mode
        return self._images[key]

    def _name(self, image: bpy.types.Image, tile: int) -> str:
        return f"{image.name}_{tile}" if image.source == "TILED" else image.name

    def _written(self, texels: np.ndarray, name: str, color_space: str, *, has_alpha: bool) -> bpy.types.Image:
        path = self._path(name, file_formats.PNG.endings[0])
        image_file.write(texels, path, 8, has_alpha=has_alpha, is_color=color_space == SRGB)
        image = self._shown(path)
        image.alpha_mode = "CHANNEL_PACKED"
        datablocks.assign_color_space(image, color_space)
        return image

    def _path(self, name: str, ending: str) -> Path:
        """A path for a new file. Names that differ in case alone count as equal: some file systems do so."""
        stem = file_name(self._before_names + name)
        names = (f"{stem}{number}{ending}" for number in chain([""], (f"_{other}" for other in count(2))))
        free = next(one for one in names if one.casefold() not in self._names)
        self._names.add(free.casefold())
        return self._folder / free

    def _shown(self, path: Path) -> bpy.types.Image:
        image = bpy.data.images.load(str(path), check_existing=False)
        self._made.append(image)
        return image


def _srgb(linear: np.ndarray) -> np.ndarray:
    """Linear values as sRGB stores them (IEC 61966-2-1)."""
    clipped = linear.clip(0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055).astype(np.float32)
