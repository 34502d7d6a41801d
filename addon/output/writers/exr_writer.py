# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes OpenEXR files ("The OpenEXR File Layout") of 16- or 32-bit floats, in lines, not compressed."""

import struct
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from .content import Content, for_rows, top_first

MAGIC = b"v/1\x01\x02\0\0\0"
HALF = 16
"""Bits of the floats that cannot hold all values."""
KINDS = {HALF: (1, np.dtype("<f2")), 32: (2, np.dtype("<f4"))}
"""The number of the kind of pixels, and their type, by bits."""
MOST_HALF = np.float32(65504.0)
"""The highest 16-bit float. Higher values become this."""
SPACE = b"lin_rec709_scene"
"""The color space that Blender names in its own files."""


def content(texels: np.ndarray, depth: int, *, has_alpha: bool, is_color: bool = False) -> Content:
    """The file of `texels` (height, width, 4) float32 with row 0 at v = 0, as floats of `depth` bits."""
    texels = top_first(texels, has_alpha)
    height, width, channels = texels.shape
    number, kind = KINDS[depth]
    data_bytes = width * channels * kind.itemsize
    lines = np.empty((height, 8 + data_bytes), np.uint8)
    head = lines[:, :8].view("<i4")
    head[:, 0], head[:, 1] = np.arange(height), data_bytes
    planes = lines[:, 8:].view(kind).reshape(height, channels, width)  # in the order of their names: A, B, G, R

    def work(blocks: Iterator[slice]) -> None:
        for rows in blocks:
            for plane, channel in enumerate(reversed(range(channels))):
                values = texels[rows, :, channel]
                planes[rows, plane] = np.clip(values, -MOST_HALF, MOST_HALF) if depth == HALF else values

    for_rows(height, lines.shape[1], work)
    header = _header(width, height, channels, number)
    first = len(header) + 8 * height
    offsets = (first + lines.shape[1] * np.arange(height, dtype=np.int64)).astype("<u8").tobytes()

    def write(file: BinaryIO, results: Iterator[np.ndarray]) -> None:
        for part in (header, offsets, *results):
            file.write(part)

    return Content([lambda: lines.data], write)


def _header(width: int, height: int, channels: int, kind: int) -> bytes:
    names = (b"A", b"B", b"G", b"R")[4 - channels :]
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    attributes = (
        (b"channels", b"chlist", b"".join(name + struct.pack("<xiB3x2i", kind, 0, 1, 1) for name in names) + b"\0"),
        (b"colorInteropID", b"string", SPACE),
        (b"compression", b"compression", b"\0"),
        (b"dataWindow", b"box2i", window),
        (b"displayWindow", b"box2i", window),
        (b"lineOrder", b"lineOrder", b"\0"),
        (b"pixelAspectRatio", b"float", struct.pack("<f", 1.0)),
        (b"screenWindowCenter", b"v2f", bytes(8)),
        (b"screenWindowWidth", b"float", struct.pack("<f", 1.0)),
    )
    parts = (name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value for name, kind, value in attributes)
    return MAGIC + b"".join(parts) + b"\0"
