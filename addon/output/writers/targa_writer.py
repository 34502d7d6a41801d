# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes Targa files (Truevision TGA File Format Specification, version 2, 1991) of 8 bits, not compressed."""

import struct
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from ..quantize import steps
from .content import Content, for_rows, top_first

TRUE_COLOR, TOP_FIRST = 2, 0x20
"""The type of the image, and the bit of its descriptor for the order of rows."""
EXTENSION = 495
"""Bytes of the extension area. Its last one says what alpha is."""
NO_ALPHA, USEFUL_ALPHA = 0, 3
"""Useful: colors are not multiplied with it."""
SIGNATURE = b"TRUEVISION-XFILE.\0"


def content(texels: np.ndarray, depth: int, *, has_alpha: bool, is_color: bool = False) -> Content:
    """The file of `texels` (height, width, 4) float32 with row 0 at v = 0, as `depth` bits per channel, which are 8."""
    texels = top_first(texels, has_alpha)
    height, width, channels = texels.shape
    found = np.empty((height, width, channels), np.uint8)

    def work(blocks: Iterator[slice]) -> None:
        for rows in blocks:
            plain = steps(texels[rows], depth)
            found[rows, :, :3], found[rows, :, 3:] = plain[..., 2::-1], plain[..., 3:]

    for_rows(height, width * channels, work)
    descriptor = TOP_FIRST | (8 if has_alpha else 0)  # its lowest bits are the depth of alpha
    head = struct.pack("<3B9x2H2B", 0, 0, TRUE_COLOR, width, height, 8 * channels, descriptor)
    extension = struct.pack(f"<H{EXTENSION - 3}xB", EXTENSION, USEFUL_ALPHA if has_alpha else NO_ALPHA)
    foot = struct.pack("<2I", len(head) + found.nbytes, 0) + SIGNATURE

    def write(file: BinaryIO, results: Iterator[np.ndarray]) -> None:
        for part in (head, *results, extension, foot):
            file.write(part)

    return Content([lambda: found.data], write)
