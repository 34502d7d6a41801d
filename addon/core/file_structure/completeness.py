# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects truncated image files: on a full disk, Blender may write only a part of a file without an error."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from . import tiff

Check = Callable[[BinaryIO, int, tuple[int, int]], bool]
"""A function of an open file, its length in bytes, and its width and height in texels, that returns whether the file is
complete. It may raise struct.error for a file that ends inside a number."""
TARGA_END = b"TRUEVISION-XFILE.\0"
"""The last bytes of every complete Targa file of version 2 (Truevision TGA File Format Specification, 1991)."""


def is_complete(path: Path, check: Check, size: tuple[int, int]) -> bool:
    """Whether the file at `path` is complete, by the `check` of its format.

    size: width and height in texels. Raises OSError if the file cannot be read.
    """
    with path.open("rb") as file:
        try:
            return check(file, os.fstat(file.fileno()).st_size, size)
        except struct.error:
            return False


def ends_in(end: bytes) -> Check:
    """The check for a format whose complete files all end in the same bytes."""

    def check(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
        file.seek(max(0, length - len(end)))
        return file.read() == end

    return check


def targa(file: BinaryIO, length: int, size: tuple[int, int]) -> bool:
    """Check that an uncompressed file is long enough for its header of 18 bytes, its texels, and TARGA_END."""
    return length >= 18 + size[0] * size[1] * 4 + len(TARGA_END) and ends_in(TARGA_END)(file, length, size)


def tiff_strips(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
    """Check that all strips are within the file."""
    found = tiff.directory(file)
    starts, sizes = (found[tag].values for tag in (tiff.STRIP_OFFSETS, tiff.STRIP_BYTE_COUNTS))
    return all(size > 0 and start + size <= length for start, size in zip(starts, sizes, strict=True))


def open_exr(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
    """Find the table of offsets behind the header, and check that the last block of lines is within the file.

    From "The OpenEXR File Layout": an attribute has a name, a type, a size and a value; the table ends where the blocks
    begin; a block has its line, its size and its data.
    """
    header = file.read(1 << 16)
    at = 8  # past the magic number and the version
    while header[at : at + 1] not in {b"", b"\0"}:
        at = header.find(b"\0", header.find(b"\0", at) + 1) + 1
        at += 4 + struct.unpack_from("<i", header, at)[0]
    table = at + 1
    (first,) = struct.unpack_from("<Q", header, table)
    if not table < first < length:  # writers fill the table last
        return False
    file.seek(table)
    offsets = struct.unpack(f"<{(first - table) // 8}Q", file.read(first - table))
    file.seek(max(offsets))
    _, size = struct.unpack("<2i", file.read(8))
    return min(offsets) == first and max(offsets) + 8 + size <= length
