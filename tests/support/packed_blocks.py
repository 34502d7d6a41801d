# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of textures bit by bit, and other programs that read them. Shares no code with addon/blocks."""

import io
import struct

import numpy as np
from PIL import Image


def packed(*fields, size=16):
    """A block (bytes,) uint8 of values and their widths, from the lowest bit on; the rest is 0."""
    value = at = 0
    for number, width in fields:
        assert 0 <= number < 1 << width, (number, width)
        value |= number << at
        at += width
    assert at <= 8 * size
    return np.frombuffer(value.to_bytes(size, "little"), np.uint8)


def dds(blocks, dxgi):
    """The bytes of a DDS file of blocks (R, C, bytes), without mip levels: DDS_HEADER and DDS_HEADER_DXT10."""
    rows, columns, _ = blocks.shape
    header = struct.pack("<7I44x", 124, 0x81007, 4 * rows, 4 * columns, blocks.size, 0, 0)
    pixels = struct.pack("<2I4s5I", 32, 4, b"DX10", 0, 0, 0, 0, 0)
    caps = struct.pack("<5I", 0x1000, 0, 0, 0, 0)
    return b"DDS " + header + pixels + caps + struct.pack("<5I", dxgi, 3, 0, 1, 0) + blocks.tobytes()


def random_blocks(name, seed, of_each_mode=64):
    """Random blocks (modes, N, bytes) uint8 of a format: a row for each mode, the reserved ones too.

    BC4 and BC5 have one row, with both orders of the ends.
    """
    random = np.random.default_rng(seed)
    modes = {"bc7": 9, "bc6h": 18}.get(name.split("-")[0], 1)
    blocks = random.integers(0, 256, (modes, of_each_mode, 8 if name == "bc4" else 16), dtype=np.uint8)
    if name == "bc7":
        for mode, row in enumerate(blocks):
            row[:, 0] = row[:, 0] & (0xFF << mode + 1 & 0xFF) | (1 << mode & 0xFF)
    elif name.startswith("bc6h"):
        codes = [0, 1, *(high << 2 | low for high in range(8) for low in (2, 3))]
        for code, row in zip(codes, blocks, strict=True):
            low = 3 if code < 2 else 31
            row[:, 0] = row[:, 0] & (0xFF - low) | code
    return blocks


def pillow(blocks, dxgi):
    """What Pillow reads of blocks: (4R, 4C, channels) uint8."""
    with Image.open(io.BytesIO(dds(blocks, dxgi))) as picture:
        values = np.asarray(picture)
    return values.reshape(*values.shape[:2], -1)
