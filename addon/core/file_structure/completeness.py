# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether an image file is complete: on a full disk, Blender's writers may leave the beginning of one without an error."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from . import tiff

Check = Callable[[BinaryIO, int, tuple[int, int]], bool]
"""From an open file, its length in bytes, and width and height in texels to whether all is there. May raise struct.error
for a file that ends inside a number."""
TARGA_END = b"TRUEVISION-XFILE.\0"
"""The last bytes of every complete Targa file of version 2 (Truevision TGA File Format Specification, 1991)."""


def is_complete(path: Path, check: Check, size: tuple[int, int]) -> bool:
    """Whether the file at `path` holds all that Blender writes, by its format's `check`.

    size: width and height in texels. Raises OSError if it cannot be read.
    """
    with path.open("rb") as file:
        try:
            return check(file, os.fstat(file.fileno()).st_size, size)
        except struct.error:
            return False


def ends_in(end: bytes) -> Check:
    """The check of a format whose complete files all have the same last bytes."""

    def check(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
        file.seek(max(0, length - len(end)))
        return file.read() == end

    return check


def targa(file: BinaryIO, length: int, size: tuple[int, int]) -> bool:
    """See that an uncompressed file has room for its header of 18 bytes, its texels and the end of version 2."""
    return length >= 18 + size[0] * size[1] * 4 + len(TARGA_END) and ends_in(TARGA_END)(file, length, size)


def tiff_strips(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
    """See that all strips lie within the file."""
    found = tiff.directory(file)
    starts, sizes = (found[tag].values for tag in (tiff.STRIP_OFFSETS, tiff.STRIP_BYTE_COUNTS))
    return all(size > 0 and start + size <= length for start, size in zip(starts, sizes, strict=True))


def open_exr(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
    """Walk the header to the table of offsets, and see that the last block of lines lies within the file.

    After "The OpenEXR File Layout": attributes are name, type, size and value; the table ends where the blocks begin;
    a block has its line, its size, its data.
    """
    header = file.read(1 << 16)
    at = 8  # past the magic number and the version
    while header[at : at + 1] not in {b"", b"\0"}:
        at = header.find(b"\0", header.find(b"\0", at) + 1) + 1
        at += 4 + struct.unpack_from("<i", header, at)[0]
    table = at + 1
    (first,) = struct.unpack_from("<Q", header, table)
    if not table < first < length:  # the table is filled last
        return False
    file.seek(table)
    offsets = struct.unpack(f"<{(first - table) // 8}Q", file.read(first - table))
    file.seek(max(offsets))
    _, size = struct.unpack("<2i", file.read(8))
    return min(offsets) == first and max(offsets) + 8 + size <= length
