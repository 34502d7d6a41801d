# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the first directory of a TIFF file (TIFF 6.0, Adobe, 1992)."""

import struct
from typing import BinaryIO, NamedTuple

_TYPES = {1: "B", 3: "H", 4: "I"}
"""The struct formats of BYTE, SHORT and LONG."""


class TiffEntry(NamedTuple):
    """The integers of one tag. at: the position of the first in the file, in bytes."""

    at: int
    values: tuple[int, ...]


def tiff_directory(file: BinaryIO) -> dict[int, TiffEntry]:
    """The entries with integers of the file's first directory, by tag. Raises struct.error if the file ends before them."""
    order = _order(file)
    (start,) = struct.unpack(order + "I", _read(file, 4, 4))
    if not start:
        raise struct.error("there is no directory yet")
    (count,) = struct.unpack(order + "H", _read(file, start, 2))
    entries = {}
    for row in range(count):
        at = start + 2 + 12 * row + 8  # the position of the value, or of an offset to it
        tag, kind, length, value = struct.unpack(order + "HHII", _read(file, at - 8, 12))
        if kind in _TYPES:
            layout = f"{order}{length}{_TYPES[kind]}"
            size = struct.calcsize(layout)
            at = at if size <= 4 else value
            entries[tag] = TiffEntry(at, struct.unpack(layout, _read(file, at, size)))
    return entries


def _order(file: BinaryIO) -> str:
    """The byte order, as a character for struct."""
    return ">" if _read(file, 0, 2) == b"MM" else "<"


def _read(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(at)
    return file.read(size)


_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that start a frame (ITU-T T.81, table B.1)."""
_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_WIDTH, _HEIGHT = 256, 257
"""Tags of TIFF 6.0."""


def image_size(file: BinaryIO) -> tuple[int, int] | None:
    """Width and height of a PNG, JPEG or TIFF file; None for other formats, and for files that end too early."""
    start = file.read(8)
    try:
        if start == _PNG:
            return struct.unpack(">8xII", file.read(16))
        if start[:3] == _JPEG:
            return _jpeg(file)
        if start[:4] in {b"II*\0", b"MM\0*"}:
            found = tiff_directory(file)
            return found[_WIDTH].values[0], found[_HEIGHT].values[0]
    except (struct.error, KeyError):
        return None
    return None


def is_of_whole_numbers(file: BinaryIO) -> bool:
    """Whether a file is of a format that is known here to have no floats: PNG or JPEG."""
    start = file.read(8)
    return start == _PNG or start[:3] == _JPEG


def _jpeg(file: BinaryIO) -> tuple[int, int] | None:
    """Go from segment to segment to the first frame header. Raises struct.error at the end of the file."""
    at = 2
    while True:
        file.seek(at)
        mark, marker, length = struct.unpack(">BBH", file.read(4))
        if mark != 0xFF:
            return None
        if marker in _FRAMES:
            height, width = struct.unpack(">xHH", file.read(5))
            return (width, height) if height else None
        at += 1 if marker == 0xFF else 2 + length  # any number of 0xFF may come before a marker
