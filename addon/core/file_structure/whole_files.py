# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a file is there, is what it should be, and has its end, by its structure, and the sizes of images.

Pixels and points are not decoded. TIFF 6.0 is by Adobe, 1992.
"""

import json
import math
import mmap
import os
import re
import struct
from collections.abc import Callable, Iterator
from typing import BinaryIO, NamedTuple

from ..file_formats import TARGA
from . import usd_archives, usd_layers

_TYPES = {1: "B", 3: "H", 4: "I"}
"""The struct formats of BYTE, SHORT and LONG."""


class TiffEntry(NamedTuple):
    """The integers of one tag. at: the position of the first in the file, in bytes."""

    at: int
    values: tuple[int, ...]


def tiff_directory(file: BinaryIO) -> dict[int, TiffEntry]:
    """The entries with integers of the file's first directory, by tag. Raises struct.error if the file ends before them."""
    order = _byte_order(file)
    (start,) = struct.unpack(order + "I", _read_at(file, 4, 4))
    if not start:
        raise struct.error("there is no directory yet")
    (count,) = struct.unpack(order + "H", _read_at(file, start, 2))
    entries = {}
    for row in range(count):
        at = start + 2 + 12 * row + 8  # the position of the value, or of an offset to it
        tag, kind, length, value = struct.unpack(order + "HHII", _read_at(file, at - 8, 12))
        if kind in _TYPES:
            layout = f"{order}{length}{_TYPES[kind]}"
            size = struct.calcsize(layout)
            at = at if size <= 4 else value
            entries[tag] = TiffEntry(at, struct.unpack(layout, _read_at(file, at, size)))
    return entries


def _byte_order(file: BinaryIO) -> str:
    """The byte order, as a character for struct."""
    return ">" if _read_at(file, 0, 2) == b"MM" else "<"


def _read_at(file: BinaryIO, at: int, size: int) -> bytes:
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
            return _jpeg_size(file)
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


def _jpeg_size(file: BinaryIO) -> tuple[int, int] | None:
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


MISSING, EMPTY, CUT = "cannot be found", "is empty", "ends too early"
"""Clauses."""
NO_IMAGE = "is no image"
NO_PIXELS = "cannot be read"
POINTER = "is only a pointer of Git LFS: fetch the file with git lfs pull"
_LFS = b"version https://git-lfs.github.com/spec/"
_IMAGES = (
    rb"\x89PNG\r\n\x1a\n|\xff\xd8\xff|II\*\0|MM\0\*|II\+\0|MM\0\+|\x76\x2f\x31\x01|#\?|RIFF....WEBP|BM|8BPS|DDS |"
    rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51|\x01\xda|SDPX|XPDS|\x80\x2a\x5f\xd7|\xd7\x5f\x2a\x80"
)
_IS_IMAGE = re.compile(_IMAGES, re.DOTALL)
"""The first bytes of the formats of images that Blender reads, except TGA, which has none of its own."""
_START = 32
"""Bytes that tell formats apart."""
_MOST = 1 << 24
"""Parts of a file that are counted at most: a hostile file may name any number."""
_EXR_LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256, 11: 32}
"""The lines of a block of OpenEXR, by its compression."""


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
            if is_image and not (_IS_IMAGE.match(start) or _is_tga(start)):
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
    return is_known and not (_is_tga(start) and start[2] > _PLAIN)


def _unpack(file: BinaryIO, layout: str, at: int | None = None) -> tuple:
    """Raises struct.error at the end of the file."""
    if at is not None:
        file.seek(at)
    return struct.unpack(layout, file.read(struct.calcsize(layout)))


def _png(file: BinaryIO, size: int) -> bool:
    at = 8
    while at + 12 <= size:
        length, name = _unpack(file, ">I4s", at)
        at += 12 + length
        if name == b"IEND":
            return at <= size
    return False


def _jpeg(file: BinaryIO, size: int) -> bool:
    """Go from segment to segment to the first scan; after it only the end has the marker of the end."""
    at = 2
    while True:
        mark, marker, length = _unpack(file, ">BBH", at)
        if mark != 0xFF:
            return True  # damaged rather than cut
        if marker == 0xDA:
            break
        at += 1 if marker == 0xFF else 2 + length
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return text.find(b"\xff\xd9", at) >= 0


def _tiff(file: BinaryIO, size: int) -> bool:
    """The ends of all strips or tiles of the first image are in the file, and so is its directory."""
    file.seek(0)
    start = file.read(4)
    order = "<" if start[:2] == b"II" else ">"
    is_big = start[2:] in (b"+\0", b"\0+")
    head, entry, inline, wide = (16, "HHQ8s", 8, "Q") if is_big else (8, "HHI4s", 4, "I")
    (at,) = _unpack(file, order + wide, head - inline)
    (count,) = _unpack(file, order + ("Q" if is_big else "H"), at)
    at += 8 if is_big else 2
    found: dict[int, tuple[int, ...]] = {}
    for row in range(count):
        tag, kind, length, value = _unpack(file, order + entry, at + row * struct.calcsize(order + entry))
        letter = {3: "H", 4: "I", 16: "Q"}.get(kind)
        if tag in _TIFF_PARTS and letter and length <= _MOST:
            layout = f"{order}{length}{letter}"
            if struct.calcsize(layout) <= inline:
                found[tag] = struct.unpack(layout, value[: struct.calcsize(layout)])
            else:
                found[tag] = _unpack(file, layout, struct.unpack(order + wide, value)[0])
    for starts, lengths in ((273, 279), (324, 325)):
        parts = zip(found.get(starts, ()), found.get(lengths, ()), strict=False)
        if any(first + length > size for first, length in parts):
            return False
    return bool(found)


_TIFF_PARTS = {273, 279, 324, 325}
"""Tags of where strips and tiles are, and of how many bytes they have."""


def _exr(file: BinaryIO, size: int) -> bool:
    """The table of the first part names all blocks, and they are in the file."""
    (flags,) = _unpack(file, "<I", 4)
    is_tiled, is_deep, has_parts = flags & 0x200, flags & 0x800, flags & 0x1000
    header = dict(_exr_header(file))
    while has_parts and any(_exr_header(file)):
        pass
    blocks = struct.unpack("<i", header["chunkCount"])[0] if "chunkCount" in header else _exr_blocks(header, is_tiled)
    if not 0 < blocks <= _MOST:
        return True
    starts = _unpack(file, f"<{blocks}Q")
    if min(starts) == 0 or is_deep:
        return min(starts) > 0
    last = max(starts)
    before = (4 if has_parts else 0) + (16 if is_tiled else 4)
    (length,) = _unpack(file, "<i", last + before)
    return last + before + 4 + length <= size


def _exr_header(file: BinaryIO) -> Iterator[tuple[str, bytes]]:
    """The attributes of a part of an OpenEXR file. Raises struct.error."""
    while name := _text(file):
        _text(file)
        (length,) = _unpack(file, "<i")
        if not 0 <= length <= _MOST:
            raise struct.error("no length")
        yield name, file.read(length)


def _text(file: BinaryIO) -> str:
    found = b""
    while (letter := file.read(1)) != b"\0":
        if not letter or len(found) > 255:
            raise struct.error("no end of a name")
        found += letter
    return found.decode(errors="replace")


def _exr_blocks(header: dict[str, bytes], is_tiled: int) -> int:
    """The number of blocks; 0 for a compression that is not known."""
    left, top, right, bottom = struct.unpack("<4i", header["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    if not is_tiled:
        lines = _EXR_LINES.get(header["compression"][0])
        return math.ceil(height / lines) if lines else 0
    along, down, mode = struct.unpack("<IIB", header["tiles"])
    sizes = [(width, height)]
    if mode & 15:
        round_ = math.floor if mode < 16 else math.ceil
        counts = [round_(math.log2(max(1, side))) + 1 for side in (width, height)]

        def level(side: int, number: int) -> int:
            return max(1, round_(side / 2**number))

        if mode & 15 == 1:
            sizes = [(level(width, number), level(height, number)) for number in range(max(counts))]
        else:
            sizes = [(level(width, u), level(height, v)) for u in range(counts[0]) for v in range(counts[1])]
    return sum(math.ceil(u / along) * math.ceil(v / down) for u, v in sizes)


def _is_tga(start: bytes) -> bool:
    """Whether the first bytes can be those of a TGA, by the values that its format allows."""
    if len(start) < 18 or start[1] > 1 or start[2] not in (1, 2, 3, 9, 10, 11):
        return False
    width, height, bits = struct.unpack_from("<HHB", start, 12)
    return width > 0 and height > 0 and bits in (8, 15, 16, 24, 32)


_PLAIN = 3
"""Kinds of TGA above it are compressed."""


def _tga(file: BinaryIO, size: int) -> bool:
    """Compressed ones do not say how long they are."""
    more, has_map, kind, count, map_bits, width, height, bits = _unpack(file, "<BBB2xHB4xHHB", 0)
    if kind > _PLAIN:
        return True
    return 18 + more + has_map * count * ((map_bits + 7) // 8) + width * height * ((bits + 7) // 8) <= size


def _mdd(file: BinaryIO, size: int) -> bool:
    frames, points = _unpack(file, ">II", 0)
    return 8 + 4 * frames + 12 * frames * points <= size


def _pc2(file: BinaryIO, size: int) -> bool:
    points, frames = _unpack(file, "<i8xi", 16)
    return 32 + 12 * frames * points <= size


def _points(file: BinaryIO, size: int) -> bool:
    """A frame of the cache of a simulation: arrays, of which those that are compressed say how long they are."""
    flags, count, kinds = _unpack(file, "<III", 8)
    if flags & 0xFFFF == _DYNAMIC_PAINT:
        at, widths = 28, [0]
    else:
        at, widths = 20, [wide for bit, wide in enumerate(_POINT_BYTES) if kinds >> bit & 1]
        if not flags & _IS_COMPRESSED:
            return at + count * sum(widths) <= size
    for wide in widths:
        is_compressed, length = _unpack(file, "<BI", at)
        at += 5 + length if is_compressed else 1 + count * wide
    return at <= size


_DYNAMIC_PAINT, _IS_COMPRESSED = 5, 1 << 16
_POINT_BYTES = 4, 12, 12, 16, 12, 12, 4, 12
"""The bytes of a point in each array."""


def _stl(file: BinaryIO, size: int) -> bool:
    return 84 + 50 * _unpack(file, "<I", 80)[0] <= size


def _solid(file: BinaryIO, size: int) -> bool:
    """An .stl of text, or a binary one whose title begins as text does."""
    (count,) = _unpack(file, "<I", 80) if size >= 84 else (0,)
    if 84 + 50 * count <= size:  # in text, these bytes are a number that no file reaches
        return True
    last = _tail(file, size).rstrip().rpartition(b"\n")[2].strip().lower()
    return last.startswith((b"endsolid", b"endfacet")) or last == b"solid"


def _tail(file: BinaryIO, size: int, most: int = 1 << 16) -> bytes:
    """The last bytes of a file."""
    file.seek(max(0, size - most))
    return file.read(most)


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
    if size > _MOST:
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
    version, has_offsets = _unpack(file, "<I8x?", 8)
    if version < 222 or not has_offsets:
        return True

    def text() -> bytes:
        (length,) = _unpack(file, "<I")
        if length > _MOST:
            raise struct.error("no length")
        return file.read(length)

    file.seek(21 + 36)
    for _ in range(min(_unpack(file, "<I")[0], _MOST)):
        for _part in ("name", "type", "value"):
            text()
    end = 0
    for _ in range(min(_unpack(file, "<I")[0], _MOST)):
        for _part in ("name", "type", "the name of the grid whose tree it shares"):
            text()
        (end,) = _unpack(file, "<16xq")
        file.seek(end)
    return end <= size


def _external_detail(file: BinaryIO, size: int) -> bool:
    """The file of an external Multiresolution modifier: each layer says how long it is."""
    order = ">" if _unpack(file, "4sB", 0)[1] else "<"
    length, _, count = _unpack(file, order + "3i", 8)
    at = length + _unpack(file, order + "i", length)[0]
    for _ in range(count):
        length, data = _unpack(file, order + "i4xQ", at)
        at += length + data
    return at <= size


def _font(file: BinaryIO, size: int) -> bool:
    """All tables of a TrueType or OpenType font are in the file."""
    count = _unpack(file, ">4sH", 0)[1]
    tables = [_unpack(file, ">8xII", 12 + 16 * row) for row in range(count)]
    return all(start + length <= size for start, length in tables)


def _archive(file: BinaryIO, size: int) -> bool:
    """An archive of USD. Raises as usd_archives.members."""
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return bool(usd_archives.members(content))


def _crate(file: BinaryIO, size: int) -> bool:
    """A binary USD file, whose table of contents is at its end."""
    (start,) = _unpack(file, "<q", 16)
    (count,) = _unpack(file, "<Q", start)
    sections = [_unpack(file, "<16xqq", start + 8 + 32 * row) for row in range(min(count, 64))]
    return all(first + length <= size for first, length in sections)


def _ogawa(file: BinaryIO, size: int) -> bool:
    """An Alembic file: its root, and what that refers to, are in the file."""
    (start,) = _unpack(file, "<Q", 8)
    (count,) = _unpack(file, "<Q", start)
    children = _unpack(file, f"<{min(count, 1 << 16)}Q", start + 8)
    return all((each & ~(1 << 63)) < size for each in children)


def _starts(*texts: bytes) -> Callable[[bytes, str], bool]:
    return lambda start, _: start.startswith(texts)


def _ends(*endings: str) -> Callable[[bytes, str], bool]:
    return lambda _, ending: ending in endings


def _says_size(layout: str, at: int, more: int = 0) -> Callable[[BinaryIO, int], bool]:
    """For files that say at a place how long they are, without `more` bytes."""
    return lambda file, size: _unpack(file, layout, at)[0] + more <= size


_FORMATS: tuple[tuple[Callable[[bytes, str], bool], Callable[[BinaryIO, int], bool]], ...] = (
    (_starts(b"\x89PNG\r\n\x1a\n"), _png),
    (_starts(b"\xff\xd8\xff"), _jpeg),
    (_starts(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _tiff),
    (_starts(b"\x76\x2f\x31\x01"), _exr),
    (lambda start, _: start[:4] == b"RIFF" and start[8:12] == b"WEBP", _says_size("<I", 4, 8)),
    (lambda start, ending: start[:2] == b"BM" and ending in (".bmp", ".dib"), _says_size("<I", 2)),
    (lambda start, ending: ending in TARGA.endings and _is_tga(start), _tga),
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
_OF_IMAGES = 7
"""So many of them, the first ones, are images."""
