# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of images, also packed ones: where they are, what their headers state, and what space their colors are in."""

import io
import struct
import zlib
from typing import BinaryIO

import bpy
import numpy as np
from bpy.types import Image
from mathutils import Color

from ..core import udim
from ..core.file_structure.whole_files import image_size, is_of_whole_numbers
from ..core.threads import for_blocks


def location(image: Image, tile: int) -> str:
    """The path of the file of an image, or of a UDIM tile if `tile` is not 0; empty for an image without one."""
    if not image.filepath:
        return ""
    path = udim.fill_all(image.filepath, tile) if tile else image.filepath
    return bpy.path.abspath(path, library=image.library)


def packed_data(image: Image, tile: int) -> bytes | None:
    """The packed file of an image, or of a tile if `tile` is not 0; None if it is not packed."""
    files = (file for file in image.packed_files if file.packed_file and tile in (0, file.tile_number))
    return next((file.packed_file.data for file in files), None)


def header_size(image: Image, tile: int) -> tuple[int, int] | None:
    """Width and height by the header of the file: (0, 0) without a file, None for a header that is not known."""
    try:
        with _opened(image, tile) as file:
            return image_size(file)
    except OSError:
        return 0, 0


def has_whole_numbers(image: Image, tile: int) -> bool:
    """Whether the file, by its header, stores shares of a largest number: no value is below 0 or above 1."""
    try:
        with _opened(image, tile) as file:
            return is_of_whole_numbers(file)
    except OSError:
        return False


def _opened(image: Image, tile: int) -> BinaryIO:
    """The file, packed or not. Raises OSError if there is none."""
    data = packed_data(image, tile)
    return open(location(image, tile), "rb") if data is None else io.BytesIO(data)


PIXELS_AT_ONCE = 2**22
"""Pixels that `from_space` converts at once, to bound its memory."""


def srgb_to_linear(values: np.ndarray) -> np.ndarray:
    """Linear values of sRGB ones (IEC 61966-2-1), of any shape."""
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4)


def linearize_bytes(pixels: np.ndarray) -> None:
    """Make the color of sRGB pixels (N, 4) float32 linear in place. Takes their values as multiples of 1/255."""
    table = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)

    def convert(part: slice) -> None:
        colors = pixels[part, :3]
        np.take(table, (colors * 255.0 + 0.5).astype(np.uint8), out=colors, mode="clip")

    for_blocks(len(pixels), convert)


def is_converting() -> bool:
    """Whether Blender's working space is another than linear Rec.709, because the file says so."""
    return not np.allclose(_matrix(), np.eye(3), atol=1e-5)


def from_rec709(pixels: np.ndarray) -> None:
    """Convert the color of pixels (N, 4) float32 from linear Rec.709 to Blender's working space in place."""
    if not is_converting():
        return
    matrix = _matrix()

    def convert(part: slice) -> None:
        pixels[part, :3] = pixels[part, :3] @ matrix

    for_blocks(len(pixels), convert)


def _matrix() -> np.ndarray:
    """Takes row vectors of linear Rec.709 to Blender's working space, (3, 3) float32."""
    return np.array([Color(axis).from_rec709_linear_to_scene_linear() for axis in np.eye(3)], np.float32)


def from_space(pixels: np.ndarray, width: int, space: str) -> None:
    """Convert the color of byte pixels (H * width, 4) float32 from a color space of Blender's configuration, in place.

    Blender has no function for this. It converts images of 16 bits while it loads them, so temporary ones go through it.
    """
    step = max(1, PIXELS_AT_ONCE // width) * width
    for start in range(0, len(pixels), step):
        part = pixels[start : start + step]
        data = _png(np.rint(part[:, :3] * 255.0).astype(np.uint16) * 257, width)
        image = bpy.data.images.new("Imprint pixels", 1, 1)
        try:
            image.pack(data=data, data_len=len(data))
            image.source = "FILE"
            image.colorspace_settings.name = space
            converted = np.empty((len(part), 4), np.float32)
            image.pixels.foreach_get(converted.reshape(-1))
        finally:
            bpy.data.images.remove(image)
        part[:, :3] = converted[:, :3]


def _png(values: np.ndarray, width: int) -> bytes:
    """An uncompressed PNG file of 16 bits of the colors (H * width, 3) uint16, the lowest row first."""
    rows = values.astype(">u2").view(np.uint8).reshape(-1, width * 6)[::-1]
    lines = np.zeros((len(rows), 1 + rows.shape[1]), np.uint8)  # the first byte of a line: no filter
    lines[:, 1:] = rows
    header = struct.pack(">IIBBBBB", width, len(rows), 16, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes(), 0)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )
