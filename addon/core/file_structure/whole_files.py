# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a file is there, is what it should be, and has its end, by its structure. Pixels and points are not decoded."""

import json
import mmap
import os
import re
import struct
from collections.abc import Callable
from typing import BinaryIO

from ..file_formats import TARGA
from . import image_files, usd_archives, usd_layers
from .image_files import MOST_PARTS, is_tga, unpack

MISSING, EMPTY, CUT = "cannot be found", "is empty", "ends too early"
"""Clauses."""
NO_IMAGE = "is no image"
NO_PIXELS = "cannot be read"
POINTER = "is only a pointer of Git LFS: fetch the file with git lfs pull"
_LFS = b"version https://git-lfs.github.com/spec/"
_START = 32
"""Bytes that tell formats apart."""


def problem(path: str, *, is_image: bool = False) -> str:
    """What is wrong with the file at `path`, as a clause that follows its name; empty if nothing is known to be.

    is_image: whether it must be an image. What cannot be looked at is left to the program that opens it.
    """
    try:
        if not os.path.isfile(path):
            return MISSING
        with open(path, "rb") as file:
            size, start = os.fstat(file.fileno()).st_size, file.read(_START)
            if not start:
                return EMPTY
            if start.startswith(_LFS[:_START]):
                return POINTER
            ending = os.path.splitext(path)[1].lower()
            if is_image and not image_files.is_image(start):
                return NO_IMAGE
            for is_format, is_whole in _FORMATS:
                if is_format(start, ending):
                    return "" if is_whole(file, size) else CUT
    except usd_archives.Refused as error:
        return str(error)
    except (OSError, ValueError):
        return ""
    except (struct.error, IndexError, KeyError):  # a part of the file that says where others are is not there
        return CUT
    return ""


def says_end(path: str) -> bool:
    """Whether `problem` knows where the image at `path` must end. Of others, only who decodes them sees it. Raises OSError."""
    with open(path, "rb") as file:
        start = file.read(_START)
    is_known = any(is_format(start, os.path.splitext(path)[1].lower()) for is_format, is_whole in _FORMATS[:_OF_IMAGES])
    return is_known and not (is_tga(start) and start[2] > image_files.PLAIN_TGA)


def _mdd(file: BinaryIO, size: int) -> bool:
    frames, points = unpack(file, ">II", 0)
    return 8 + 4 * frames + 12 * frames * points <= size


def _pc2(file: BinaryIO, size: int) -> bool:
    points, frames = unpack(file, "<i8xi", 16)
    return 32 + 12 * frames * points <= size


def _points(file: BinaryIO, size: int) -> bool:
    """A frame of the cache of a simulation: arrays, of which those that are compressed say how long they are."""
    flags, count, kinds = unpack(file, "<III", 8)
    if flags & 0xFFFF == _DYNAMIC_PAINT:
        at, widths = 28, [0]
    else:
        at, widths = 20, [wide for bit, wide in enumerate(_POINT_BYTES) if kinds >> bit & 1]
        if not flags & _IS_COMPRESSED:
            return at + count * sum(widths) <= size
    for wide in widths:
        is_compressed, length = unpack(file, "<BI", at)
        at += 5 + length if is_compressed else 1 + count * wide
    return at <= size


_DYNAMIC_PAINT, _IS_COMPRESSED = 5, 1 << 16
_POINT_BYTES = 4, 12, 12, 16, 12, 12, 4, 12
"""The bytes of a point in each array."""


def _stl(file: BinaryIO, size: int) -> bool:
    return 84 + 50 * unpack(file, "<I", 80)[0] <= size


def _solid(file: BinaryIO, size: int) -> bool:
    """An .stl of text, or a binary one whose title begins as text does."""
    (count,) = unpack(file, "<I", 80) if size >= 84 else (0,)
    if 84 + 50 * count <= size:  # in text, these bytes are a number that no file reaches
        return True
    last = _tail(file, size).rstrip().rpartition(b"\n")[2].strip().lower()
    return last.startswith((b"endsolid", b"endfacet")) or last == b"solid"


def _tail(file: BinaryIO, size: int) -> bytes:
    """The last 64 KiB of a file."""
    file.seek(max(0, size - (1 << 16)))
    return file.read()


def _obj(file: BinaryIO, size: int) -> bool:
    """Lines are complete except the last one, which may lack its end, but no part of what it says."""
    *before, last = _tail(file, size).split(b"\n")
    words = last.split()
    if not words or not before:
        return True
    key, *values = words
    if key == b"f":
        slots = {value.count(b"/") for value in values}
        return len(values) >= 3 and len(slots) == 1 and not (values[-1].endswith(b"/") or values[-1] == b"-")
    if key in (b"v", b"vn", b"vt"):
        others = [line.split() for line in before if line.startswith(key + b" ")]
        is_number = re.fullmatch(
            rb"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", values[-1] if values else b""
        )
        return bool(is_number) and len(words) >= (len(others[-1]) if others else 2)
    return bool(values) or not any(word.startswith(key) for word in (b"usemtl", b"mtllib"))


def _usda(file: BinaryIO, size: int) -> bool:
    """A USD file of text: each bracket has its other one."""
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        depth = 0
        for match in usd_layers.PARTS.finditer(text):
            depth += {b"{": 1, b"(": 1, b"[": 1, b"}": -1, b")": -1, b"]": -1}.get(match[0], 0)
    return depth <= 0


def _json(file: BinaryIO, size: int) -> bool:
    if size > MOST_PARTS:
        return True
    file.seek(0)
    text = file.read().decode(errors="replace").rstrip()
    try:
        json.loads(text)
    except json.JSONDecodeError as error:  # which stands at the end, or at the start of the last text or word
        return error.pos < len(text) - len("false") and not error.msg.startswith("Unterminated")
    return True


def _volume(file: BinaryIO, size: int) -> bool:
    """An OpenVDB file: each grid says where it ends."""
    version, has_offsets = unpack(file, "<I8x?", 8)
    if version < 222 or not has_offsets:
        return True

    def text() -> bytes:
        (length,) = unpack(file, "<I")
        if length > MOST_PARTS:
            raise struct.error("no length")
        return file.read(length)

    file.seek(21 + 36)
    for _ in range(min(unpack(file, "<I")[0], MOST_PARTS)):
        for _part in ("name", "type", "value"):
            text()
    end = 0
    for _ in range(min(unpack(file, "<I")[0], MOST_PARTS)):
        for _part in ("name", "type", "the name of the grid whose tree it shares"):
            text()
        (end,) = unpack(file, "<16xq")
        file.seek(end)
    return end <= size


def _external_detail(file: BinaryIO, size: int) -> bool:
    """The file of an external Multiresolution modifier: each layer says how long it is."""
    order = ">" if unpack(file, "4sB", 0)[1] else "<"
    length, _, count = unpack(file, order + "3i", 8)
    at = length + unpack(file, order + "i", length)[0]
    for _ in range(count):
        length, data = unpack(file, order + "i4xQ", at)
        at += length + data
    return at <= size


def _font(file: BinaryIO, size: int) -> bool:
    """All tables of a TrueType or OpenType font are in the file."""
    count = unpack(file, ">4sH", 0)[1]
    tables = [unpack(file, ">8xII", 12 + 16 * row) for row in range(count)]
    return all(start + length <= size for start, length in tables)


def _archive(file: BinaryIO, size: int) -> bool:
    """An archive of USD. Raises as usd_archives.members."""
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return bool(usd_archives.members(content))


def _crate(file: BinaryIO, size: int) -> bool:
    """A binary USD file, whose table of contents is at its end."""
    (start,) = unpack(file, "<q", 16)
    (count,) = unpack(file, "<Q", start)
    sections = [unpack(file, "<16xqq", start + 8 + 32 * row) for row in range(min(count, 64))]
    return all(first + length <= size for first, length in sections)


def _ogawa(file: BinaryIO, size: int) -> bool:
    """An Alembic file: its root, and what that refers to, are in the file."""
    (start,) = unpack(file, "<Q", 8)
    (count,) = unpack(file, "<Q", start)
    children = unpack(file, f"<{min(count, 1 << 16)}Q", start + 8)
    return all((each & ~(1 << 63)) < size for each in children)


def _starts(*texts: bytes) -> Callable[[bytes, str], bool]:
    return lambda start, _: start.startswith(texts)


def _ends(*endings: str) -> Callable[[bytes, str], bool]:
    return lambda _, ending: ending in endings


def _says_size(layout: str, at: int, more: int = 0) -> Callable[[BinaryIO, int], bool]:
    """For files that say at a place how long they are, without `more` bytes."""
    return lambda file, size: unpack(file, layout, at)[0] + more <= size


_FORMATS: tuple[tuple[Callable[[bytes, str], bool], Callable[[BinaryIO, int], bool]], ...] = (
    (_starts(b"\x89PNG\r\n\x1a\n"), image_files.png_is_whole),
    (_starts(b"\xff\xd8\xff"), image_files.jpeg_is_whole),
    (_starts(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), image_files.tiff_is_whole),
    (_starts(b"\x76\x2f\x31\x01"), image_files.exr_is_whole),
    (lambda start, _: start[:4] == b"RIFF" and start[8:12] == b"WEBP", _says_size("<I", 4, 8)),
    (_starts(b"DDS "), image_files.dds_is_whole),
    (lambda start, ending: start[:2] == b"BM" and ending in (".bmp", ".dib"), _says_size("<I", 2)),
    (lambda start, ending: ending in TARGA.endings and is_tga(start), image_files.tga_is_whole),
    (_starts(b"POINTCACHE2\0"), _pc2),
    (_ends(".mdd"), _mdd),
    (_ends(".bphys"), _points),
    (_starts(b"BCDF"), _external_detail),
    (_starts(b"\0\1\0\0", b"OTTO", b"true"), _font),
    (_starts(b"wOFF", b"wOF2"), _says_size(">I", 8)),
    (_ends(usd_archives.ENDING), _archive),
    (_starts(b"PXR-USDC"), _crate),
    (_starts(b"Ogawa"), _ogawa),
    (_starts(b"glTF"), _says_size("<I", 8)),
    (lambda start, ending: ending == ".stl" and start[:5] != b"solid", _stl),
    (_ends(".stl"), _solid),
    (_ends(".obj"), _obj),
    (_starts(b"#usda"), _usda),
    (_ends(".json"), _json),
    (_starts(b" BDV"), _volume),
)
"""How to tell a format by its first bytes and the ending of its name, and whether a file of it is whole."""
_OF_IMAGES = 8
"""So many of them, the first ones, are images."""
