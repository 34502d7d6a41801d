# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the first directory of a TIFF file (TIFF 6.0, Adobe, 1992)."""

import struct
from typing import BinaryIO, NamedTuple

_TYPES = {1: "B", 3: "H", 4: "I"}
"""The struct formats of BYTE, SHORT and LONG."""


class Entry(NamedTuple):
    """The integers of one tag. at: the position of the first in the file, in bytes."""

    at: int
    values: tuple[int, ...]


def directory(file: BinaryIO) -> dict[int, Entry]:
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
            entries[tag] = Entry(at, struct.unpack(layout, _read(file, at, size)))
    return entries


def _order(file: BinaryIO) -> str:
    """The byte order, as a character for struct."""
    return ">" if _read(file, 0, 2) == b"MM" else "<"


def _read(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(at)
    return file.read(size)
