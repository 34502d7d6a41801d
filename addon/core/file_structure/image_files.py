# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the heads of images: their sizes, and whether their files end where they must. Pixels are not decoded.

PNG by ISO/IEC 15948, JPEG by ITU-T T.81, TIFF 6.0 by Adobe, 1992, OpenEXR by its file layout, TGA by Truevision, 1991, DDS
by Microsoft's programming guide.
"""

import math
import mmap
import re
import struct
from collections.abc import Container, Iterator
from typing import Any, BinaryIO

MOST_PARTS = 1 << 24
"""Parts of a file that are counted at most: a hostile file may name any number."""
_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_IMAGES = (
    rb"\x89PNG\r\n\x1a\n|\xff\xd8\xff|II\*\0|MM\0\*|II\+\0|MM\0\+|\x76\x2f\x31\x01|#\?|RIFF....WEBP|BM|8BPS|DDS |"
    rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51|\x01\xda|SDPX|XPDS|\x80\x2a\x5f\xd7|\xd7\x5f\x2a\x80"
)
_STARTS = re.compile(_IMAGES, re.DOTALL)
"""The first bytes of the formats of images that Blender reads, except TGA, which has none of its own."""


def is_image(start: bytes) -> bool:
    """Whether the first bytes are those of an image that Blender may read."""
    return bool(_STARTS.match(start)) or is_tga(start)


def image_size(file: BinaryIO) -> tuple[int, int] | None:
    """Width and height of a PNG, JPEG or TIFF file; None for other formats, and for files that end too early."""
    start = file.read(8)
    try:
        if start == _PNG:
            return unpack(file, ">8xII")
        if start[:3] == _JPEG:
            return _jpeg_size(file)
        if start[:4] in {b"II*\0", b"MM\0*"}:
            tags = tiff_values(file, {_WIDTH, _HEIGHT})
            return tags[_WIDTH][0], tags[_HEIGHT][0]
    except (struct.error, KeyError):
        return None
    return None


def is_of_whole_numbers(file: BinaryIO) -> bool:
    """Whether a file is of a format that is known here to have no floats: PNG or JPEG."""
    start = file.read(8)
    return start == _PNG or start[:3] == _JPEG


def unpack(file: BinaryIO, layout: str, at: int | None = None) -> tuple[Any, ...]:
    """Values at a place in the file, or where it is. Raises struct.error at the end of the file."""
    if at is not None:
        file.seek(at)
    return struct.unpack(layout, file.read(struct.calcsize(layout)))


# PNG


def png_is_whole(file: BinaryIO, size: int) -> bool:
    at = 8
    while at + 12 <= size:
        length, name = unpack(file, ">I4s", at)
        at += 12 + length
        if name == b"IEND":
            return at <= size
    return False


# JPEG


_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers that start a frame (table B.1)."""
_SCAN = 0xDA


def _jpeg_segments(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """The markers and the places of the segments, up to the first scan. Raises struct.error at the end of the file."""
    at, marker = 2, 0
    while marker != _SCAN:
        mark, marker, length = unpack(file, ">BBH", at)
        if mark != 0xFF:
            return
        yield marker, at
        at += 1 if marker == 0xFF else 2 + length  # any number of 0xFF may come before a marker


def _jpeg_size(file: BinaryIO) -> tuple[int, int] | None:
    for marker, at in _jpeg_segments(file):
        if marker in _FRAMES:
            height, width = unpack(file, ">5xHH", at)
            return (width, height) if height else None
    return None


def jpeg_is_whole(file: BinaryIO, size: int) -> bool:
    """After the first scan, only the end has the marker of the end. One without a scan is damaged rather than cut."""
    for marker, at in _jpeg_segments(file):
        if marker == _SCAN:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
                return text.find(b"\xff\xd9", at) >= 0
    return True


# TIFF


_WIDTH, _HEIGHT = 256, 257
_PARTS = (273, 279), (324, 325)
"""Tags of where strips and tiles are, and of how many bytes they have."""
_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""The struct formats of BYTE, SHORT, LONG and LONG8."""


def tiff_values(file: BinaryIO, wanted: Container[int]) -> dict[int, tuple[int, ...]]:
    """The integers of these tags in the file's first directory. Raises struct.error if the file ends before them."""
    start = unpack(file, "4s", 0)[0]
    order = ">" if start[:2] == b"MM" else "<"
    is_big = b"+" in start
    head, entry, inline, wide = (16, "HHQ8s", 8, "Q") if is_big else (8, "HHI4s", 4, "I")
    (at,) = unpack(file, order + wide, head - inline)
    (count,) = unpack(file, order + ("Q" if is_big else "H"), at)
    at += 8 if is_big else 2
    values: dict[int, tuple[int, ...]] = {}
    for row in range(count):
        tag, kind, length, value = unpack(file, order + entry, at + row * struct.calcsize(order + entry))
        if tag in wanted and kind in _TYPES and length <= MOST_PARTS:
            layout = f"{order}{length}{_TYPES[kind]}"
            if struct.calcsize(layout) <= inline:
                values[tag] = struct.unpack(layout, value[: struct.calcsize(layout)])
            else:
                values[tag] = unpack(file, layout, struct.unpack(order + wide, value)[0])
    return values


def tiff_is_whole(file: BinaryIO, size: int) -> bool:
    """The ends of all strips or tiles of the first image are in the file, and so is its directory."""
    tags = tiff_values(file, {tag for pair in _PARTS for tag in pair})
    for starts, lengths in _PARTS:
        parts = zip(tags.get(starts, ()), tags.get(lengths, ()), strict=False)
        if any(first + length > size for first, length in parts):
            return False
    return bool(tags)


# OpenEXR


_EXR_LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256, 11: 32}
"""The lines of a block of OpenEXR, by its compression."""


def exr_is_whole(file: BinaryIO, size: int) -> bool:
    """The table of the first part names all blocks, and they are in the file."""
    (flags,) = unpack(file, "<I", 4)
    is_tiled, is_deep, has_parts = flags & 0x200, flags & 0x800, flags & 0x1000
    header = dict(_exr_header(file))
    while has_parts and any(_exr_header(file)):
        pass
    blocks = struct.unpack("<i", header["chunkCount"])[0] if "chunkCount" in header else _exr_blocks(header, is_tiled)
    if not 0 < blocks <= MOST_PARTS:
        return True
    starts = unpack(file, f"<{blocks}Q")
    if min(starts) == 0 or is_deep:
        return min(starts) > 0
    last = max(starts)
    before = (4 if has_parts else 0) + (16 if is_tiled else 4)
    (length,) = unpack(file, "<i", last + before)
    return last + before + 4 + length <= size


def _exr_header(file: BinaryIO) -> Iterator[tuple[str, bytes]]:
    """The attributes of a part of an OpenEXR file. Raises struct.error."""
    while name := _text(file):
        _text(file)
        (length,) = unpack(file, "<i")
        if not 0 <= length <= MOST_PARTS:
            raise struct.error("no length")
        yield name, file.read(length)


def _text(file: BinaryIO) -> str:
    letters = b""
    while (letter := file.read(1)) != b"\0":
        if not letter or len(letters) > 255:
            raise struct.error("no end of a name")
        letters += letter
    return letters.decode(errors="replace")


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


# TGA


def is_tga(start: bytes) -> bool:
    """Whether the first bytes can be those of a TGA, by the values that its format allows."""
    if len(start) < 18 or start[1] > 1 or start[2] not in (1, 2, 3, 9, 10, 11):
        return False
    width, height, bits = struct.unpack_from("<HHB", start, 12)
    return width > 0 and height > 0 and bits in (8, 15, 16, 24, 32)


PLAIN_TGA = 3
"""Kinds of TGA above it are compressed."""


def tga_is_whole(file: BinaryIO, size: int) -> bool:
    """Compressed ones do not say how long they are."""
    more, has_map, kind, count, map_bits, width, height, bits = unpack(file, "<BBB2xHB4xHHB", 0)
    if kind > PLAIN_TGA:
        return True
    return 18 + more + has_map * count * ((map_bits + 7) // 8) + width * height * ((bits + 7) // 8) <= size


# DDS


_BLOCK_NAMES = {
    **dict.fromkeys((b"DXT1", b"ATI1", b"BC4U", b"BC4S"), 8),
    **dict.fromkeys((b"DXT2", b"DXT3", b"DXT4", b"DXT5", b"ATI2", b"BC5U", b"BC5S"), 16),
}
_BLOCK_NUMBERS = (
    (range(70, 73), 8),
    (range(73, 79), 16),
    (range(79, 82), 8),
    (range(82, 85), 16),
    (range(94, 100), 16),
)
"""The bytes of a block, by the names of formats, and by their numbers (DXGI_FORMAT)."""
_HAS_LEVELS, _HAS_NAME, _ALL_SIDES, _IS_VOLUME, _CUBE_FLAG = 0x20000, 0x4, 0xFC00, 0x200000, 0x4


def dds_is_whole(file: BinaryIO, size: int) -> bool:
    """All levels of all pictures are in the file. Formats that are not known here, and volumes, count as whole."""
    flags, height, width, levels = unpack(file, "<4xI2I8xI", 4)
    format_flags, name, bits, more = unpack(file, "<I4sI20xI", 80)
    at, block, pictures = 128, 0, max(1, (more & _ALL_SIDES).bit_count())
    if not format_flags & _HAS_NAME:
        bits = min(bits, 128)
    elif name == b"DX10":
        number, misc, pictures = unpack(file, "<I4x2I4x", at)
        at, pictures = at + 20, max(1, pictures) * (6 if misc & _CUBE_FLAG else 1)
        block = next((length for numbers, length in _BLOCK_NUMBERS if number in numbers), 0)
    else:
        block = _BLOCK_NAMES.get(name, 0)
    if more & _IS_VOLUME or not (block or not format_flags & _HAS_NAME):
        return True
    count = min(max(1, levels), 32) if flags & _HAS_LEVELS else 1
    sides = [(max(1, width >> level), max(1, height >> level)) for level in range(count)]
    if block:
        length = sum(-(-along // 4) * -(-down // 4) * block for along, down in sides)
    else:
        length = sum((along * bits + 7) // 8 * down for along, down in sides)
    return at + pictures * length <= size
