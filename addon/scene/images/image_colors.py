# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts colors to linear Rec.709, in which Imprint computes, from Blender's working space and from those of images."""

import struct
import zlib
from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Color

from ...mesh.threads import for_blocks

ROWS_AT_ONCE = 2**22
"""Pixels that `from_space` converts at once, to bound its memory."""


def from_working(values: Sequence[float]) -> np.ndarray:
    """A color (3,) of Blender's working space in linear Rec.709, float64. They differ only if the file says so."""
    return np.array(values[:3], np.float64) @ working_matrix() if is_converting() else np.array(values[:3], np.float64)


def is_converting() -> bool:
    """Whether Blender's working space is another than linear Rec.709."""
    return not np.allclose(working_matrix(), np.eye(3), atol=1e-5)


def working_matrix() -> np.ndarray:
    """The matrix (3, 3) that takes row vectors from Blender's working space to linear Rec.709."""
    return np.array([Color(axis).from_scene_linear_to_rec709_linear() for axis in np.eye(3)], np.float64)


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


def to_rec709(pixels: np.ndarray) -> None:
    """Convert the color of pixels (N, 4) float32 from Blender's working space in place."""
    if not is_converting():
        return
    matrix = working_matrix().astype(np.float32)

    def convert(part: slice) -> None:
        pixels[part, :3] = pixels[part, :3] @ matrix

    for_blocks(len(pixels), convert)


def from_space(pixels: np.ndarray, width: int, space: str) -> None:
    """Convert the color of byte pixels (H * width, 4) float32 from a color space of Blender's configuration, in place.

    Blender has no function for this. It converts images of 16 bits while it loads them, so temporary ones go through it.
    """
    step = max(1, ROWS_AT_ONCE // width) * width
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
    to_rec709(pixels)


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
