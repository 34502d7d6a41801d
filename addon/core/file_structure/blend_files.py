# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads .blend files without Blender: the names of their objects, and the paths of the libraries that they link."""

import gzip
import io
import os
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

from ..file_formats import BY_ENDING
from ..map_types import MARK, ORIGIN

_HEAD_OF_4 = re.compile(rb"BLENDER([_-])([vV])(\d{3})")
_HEAD_OF_5 = re.compile(rb"BLENDER17-01v(\d{4})")
"""The first bytes of a .blend of Blender before 5.0, by the width of pointers and the order of bytes, and from 5.0 on."""
_LIBRARY = re.compile(rb"[^\0]*[/\\][^\0]*\.blend(?=\0)")
"""A path in the block of a library, which contains its bare name as well."""
_IMAGE = re.compile(rb"[^\0]+\.(?:%s)(?=\0)" % "|".join(each[1:] for each in BY_ENDING).encode(), re.IGNORECASE)
"""A path of an image in its block."""
_MARKS = tuple(f"{mark}\0".encode() for mark in (MARK, ORIGIN))
"""The custom properties of images that Imprint has baked."""
_PIECE = 1 << 20
_MOST_OF_LIBRARY = 1 << 16
"""Bytes that are read of the block of a library, which has a few paths."""
_MOST_OF_IMAGE = 1 << 12
"""Bytes that are read of a block that belongs to an image: a custom property or the path of a packed file."""
MOST_COMPRESSED = 1000
"""A compressed file has less content than so many times its bytes."""
_LONGEST_NAME = 258
"""Bytes of a name with its code, OB for objects, and the zero at its end."""
NOT_WHOLE = "{!r} is not a complete .blend file."
"""What is wrong with a file whose blocks cannot all be read."""
_POINTERS_SINCE = 293
"""From this version on, five pointers are before a name, and four in older ones."""


class _Layout(NamedTuple):
    head: struct.Struct
    """The head of a block."""
    size_at: int
    """Which of its values is the size."""
    name_at: int
    """Where the name is in the block of an object."""
    name_size: int
    """Bytes of a name with its code and the zero at its end, at most."""


def object_names(path: Path) -> set[str] | None:
    """The names of the objects in the .blend at `path`, linked ones too. None if it cannot be read.

    Of large blocks only the start is read, if the file is not compressed.
    """
    names = set()
    # A linked object has a block of its own, with its name alone.
    for layout, block in (blocks := _Blocks(path, {b"OB": _LONGEST_NAME + 40, b"ID": _LONGEST_NAME + 40})):
        name = block[layout.name_at : layout.name_at + _LONGEST_NAME].partition(b"\0")[0]
        if name.startswith(b"OB"):
            names.add(name[2:].decode(errors="surrogateescape"))
    return names if blocks.is_complete else None


def libraries(path: Path) -> list[Path]:
    """The libraries that the .blend at `path` links. This reads all its blocks."""
    # Names are in the bytes of the system, as paths are. Opening a file that is not complete will report what is wrong.
    blocks = _Blocks(path, {b"LI": _MOST_OF_LIBRARY})
    names = [os.fsdecode(name) for _, block in blocks for name in _LIBRARY.findall(block)]
    return [path.parent / name.removeprefix("//") for name in names] if blocks.is_complete else []


def images(path: Path) -> list[str]:
    """The paths of the image files that the .blend at `path` names, without those that it packs, and those that Imprint baked.

    Only files of the formats that maps have. This reads all its blocks.
    """
    blocks = _Blocks(path, {b"IM": _MOST_OF_LIBRARY, b"DATA": _MOST_OF_IMAGE}, follow=b"IM")
    names: list[bytes] = []
    for layout, block, code in blocks.with_codes():
        if code == b"IM":
            named = _IMAGE.search(
                block, layout.name_at + layout.name_size
            )  # older paths may stand behind the first one
            names.append(named[0] if named else b"")
        elif names and any(mark in block for mark in _MARKS):
            names[-1] = b""
        elif names and names[-1] and (packed := _IMAGE.search(block)):
            is_own = os.path.basename(packed[0]) == os.path.basename(names[-1])
            names[-1] = b"" if is_own else names[-1]
    texts = [os.fsdecode(name) for name in names if name]
    return [str(path.parent / text.removeprefix("//")) for text in texts] if blocks.is_complete else []


class _Blocks:
    """The blocks of some codes, each with the layout of the file. is_complete: whether all could be read."""

    def __init__(self, path: Path, wanted: dict[bytes, int], *, follow: bytes = b""):
        """wanted: codes, and how many bytes to read. follow: a code; blocks of DATA count only after one with it."""
        self._path, self._wanted, self._follow, self.is_complete = path, wanted, follow, False

    def __iter__(self) -> Iterator[tuple[_Layout, bytes]]:
        return ((layout, block) for layout, block, _ in self.with_codes())

    def with_codes(self) -> Iterator[tuple[_Layout, bytes, bytes]]:
        """The blocks, with their codes as well."""
        try:
            with _opened(self._path) as file:
                yield from self._read(file)
                self.is_complete = True
        except (OSError, EOFError, ValueError, zlib.error, struct.error):
            return

    def _read(self, file: BinaryIO) -> Iterator[tuple[_Layout, bytes, bytes]]:
        layout, left = _layout(file), MOST_COMPRESSED * (self._path.stat().st_size + _PIECE)
        owner = b""
        while (head := layout.head.unpack(file.read(layout.head.size)))[0] != b"ENDB":
            size, code = head[layout.size_at], head[0].rstrip(b"\0")
            left -= layout.head.size + size
            if size < 0 or left < 0:
                raise ValueError("no size of a block")
            owner = owner if code == b"DATA" else code
            is_wanted = code != b"DATA" or owner == self._follow
            part = min(self._wanted.get(code, 0), size) if is_wanted else 0
            if part:
                yield layout, file.read(part), code
            _skip(file, size - part)


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    """The content of a .blend, which may be compressed. Raises OSError, EOFError, ValueError or zlib.error."""
    with path.open("rb") as file:
        start = file.read(4)
        file.seek(0)
        if start[:2] == b"\x1f\x8b":  # before 3.0
            with gzip.open(file) as content:
                yield cast(BinaryIO, content)
        elif start == b"\x28\xb5\x2f\xfd":
            import zstandard  # a part of Blender

            try:
                reader = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
                yield cast(BinaryIO, io.BufferedReader(reader, _PIECE))
            except zstandard.ZstdError as error:
                raise ValueError(str(error)) from error
        else:
            yield file


def _skip(file: BinaryIO, size: int) -> None:
    if isinstance(file, io.BufferedReader) and file.raw.seekable() and isinstance(file.raw, io.FileIO):
        file.seek(size, os.SEEK_CUR)
        return
    while size > 0 and (piece := file.read(min(size, _PIECE))):
        size -= len(piece)


def _layout(file: BinaryIO) -> _Layout:
    """The layout of the blocks. Goes to the first block.

    Raises ValueError for a file of another kind. Blender 4.5 has no module for the format of 5.0, which it opens.
    """
    start = file.read(12)
    if head := _HEAD_OF_4.fullmatch(start):
        width, order, version = (4 if head[1] == b"_" else 8), (">" if head[2] == b"V" else "<"), int(head[3])
        pointers = 5 if version >= _POINTERS_SINCE else 4
        return _Layout(struct.Struct(order + ("4siIii" if width == 4 else "4siQii")), 1, width * pointers, 66)
    if _HEAD_OF_5.fullmatch(start + file.read(5)):
        return _Layout(struct.Struct("<4siQqq"), 3, 40, _LONGEST_NAME)
    raise ValueError("not a .blend")
