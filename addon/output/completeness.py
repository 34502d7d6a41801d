# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a picture's file is all there: on a full disk, Blender's writers may leave the beginning of one and say nothing."""

import os
import struct
from pathlib import Path
from typing import BinaryIO

from . import tiff

PNG_END = b"IEND\xae\x42\x60\x82"
"""The last bytes of every whole PNG file."""
TARGA_END = b"TRUEVISION-XFILE.\0"
"""The last bytes of every whole Targa file of version 2 (Truevision TGA File Format Specification, 1991)."""


def is_whole(path: Path, size: tuple[int, int]) -> bool:
    """Whether the file at `path`, in the format that its ending names, holds all that Blender writes.

    size: width and height in texels. Raises OSError if it cannot be read.
    """
    check = {".png": _png, ".tga": _targa, ".tif": _tiff, ".tiff": _tiff, ".exr": _exr}[path.suffix.lower()]
    with path.open("rb") as file:
        try:
            return check(file, os.fstat(file.fileno()).st_size, size)
        except struct.error:  # it ends in the midst of a number
            return False


def _ends_in(file: BinaryIO, length: int, end: bytes) -> bool:
    file.seek(max(0, length - len(end)))
    return file.read() == end


def _png(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
    return _ends_in(file, length, PNG_END)


def _targa(file: BinaryIO, length: int, size: tuple[int, int]) -> bool:
    # Without compression: a header of 18 bytes, the texels, and what version 2 adds.
    return length >= 18 + size[0] * size[1] * 4 + len(TARGA_END) and _ends_in(file, length, TARGA_END)


def _tiff(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
    found = tiff.directory(file)
    starts, sizes = (found[tag].values for tag in (tiff.STRIP_OFFSETS, tiff.STRIP_BYTE_COUNTS))
    return all(size > 0 and start + size <= length for start, size in zip(starts, sizes, strict=True))


def _exr(file: BinaryIO, length: int, _: tuple[int, int]) -> bool:
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
