# SPDX-License-Identifier: GPL-3.0-or-later
"""What a .usdz contains (USDZ File Format Specification, 1.3): files one after the other, stored as they are.

USD goes from head to head and leaves the list at the end of the archive alone. So does this, or it would check other files
than those that are read.
"""

import mmap
import struct
from collections.abc import Iterator
from typing import NamedTuple

ENDING = ".usdz"
_HEAD, _LIST, _END = b"PK\3\4", b"PK\1\2", b"PK\5\6"
_END_SIZE, _LONGEST_END = 22, 22 + 65_535
"""Bytes of the end of an archive, without and with a comment."""
_HEAD_LAYOUT = struct.Struct("<4s2xHH8xIIHH")
"""Of a file's head: flags, compression, bytes as stored, bytes, and those of the name and of what is added to it."""
_LAYERS = (".usd", ".usda", ".usdc")
_NOT_STORED = 1 | 8
"""Flags of files that are encrypted, or whose sizes follow them."""
MOST_FILES = 10_000
"""Files in an archive, with those of archives in it: a hostile one can have any number."""


class Refused(ValueError):
    """An archive that no program should open. The message is a clause that follows its name."""


class Member(NamedTuple):
    """A file in an archive.

    Attributes:
        name: With slashes.
        start, stop: Where its bytes are in the file that holds the archive.
    """

    name: str
    start: int
    stop: int

    @property
    def is_layer(self) -> bool:
        return self.name.lower().endswith(_LAYERS)


def members(content: mmap.mmap) -> list[Member]:
    """The files in an archive, also those of archives in it. Raises Refused, and struct.error for one that ends too early."""
    files: list[Member] = []
    parts = [(0, len(content))]
    for start, stop in parts:  # it grows
        for each in _of_one(content, start, stop):
            files.append(each)
            if len(files) > MOST_FILES:
                raise Refused(f"holds more than {MOST_FILES:,} files")
            if each.name.lower().endswith(ENDING):
                parts.append((each.start, each.stop))
    if not files or not files[0].is_layer:
        raise Refused("is no archive of USD, whose first file is a .usd, .usda or .usdc")
    return files


def _of_one(content: mmap.mmap, start: int, stop: int) -> Iterator[Member]:
    if content[start : start + 4] != _HEAD:
        raise Refused("is no archive of USD")
    names, at = set(), start
    while content[at : at + 4] == _HEAD:
        if at + _HEAD_LAYOUT.size > stop:
            raise struct.error("the archive ends too early")
        _, flags, compression, stored, size, name_size, more = _HEAD_LAYOUT.unpack_from(content, at)
        begin = at + _HEAD_LAYOUT.size + name_size + more
        at = begin + stored
        if flags & _NOT_STORED or compression or stored != size:
            raise Refused("holds files that are compressed or encrypted, which USD does not read")
        name_at = begin - more - name_size
        name = content[name_at : name_at + name_size].decode(errors="surrogateescape")
        if name in names or not _is_inside(name):
            raise Refused(f"holds a file with the name {name!r}, which is taken or leads out of the archive")
        names.add(name)
        yield Member(name, begin, at)
    end = content.rfind(_END, max(at, stop - _LONGEST_END), stop)
    if content[at : at + 4] != _LIST or not 0 <= end <= stop - _END_SIZE:
        raise struct.error("the archive ends too early")


def _is_inside(name: str) -> bool:
    """Whether a name stays in the folder that it is unpacked to, on each system."""
    parts = name.removesuffix("/").split("/")  # the name of a folder ends with a slash
    return not any(letter in name for letter in "\0\\:") and not {"", ".", ".."} & set(parts)
