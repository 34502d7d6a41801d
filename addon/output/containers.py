# SPDX-License-Identifier: GPL-3.0-or-later
"""DDS and KTX2 files: the blocks of all mip levels of one picture, as GPUs read them. Needs no Blender.

DDS by Microsoft's "Programming guide for DDS", with the header of DirectX 10; KTX2 by Khronos' "KTX File Format Specification"
2.0, with its "Khronos Data Format Specification" 1.3.
"""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

import numpy as np

from ..blocks.formats import BC4, BC5, BC6H, BC6H_SIGNED, BC7, FORMATS, SIDE, BlockFormat
from ..core import file_formats
from ..core.errors import BakeError

_MOST_TEXT = 1 << 20
"""Bytes of metadata that are read at most."""


@dataclass(frozen=True)
class Container:
    """What a file holds.

    Attributes:
        size: Width and height of level 0, in texels.
        levels: Of each mip level, from the largest on, its blocks (rows, columns, bytes) uint8, the top row first.
        is_srgb: Whether the file says that colors are sRGB.
        has_alpha: Whether alpha is stored: a block format can have it, and the file say that it means nothing.
        note: A text for Imprint itself; empty for none.
    """

    size: tuple[int, int]
    levels: Sequence[np.ndarray]
    block_format: BlockFormat
    is_srgb: bool = False
    has_alpha: bool = False
    note: str = ""


def level_size(size: tuple[int, int], level: int) -> tuple[int, int]:
    """Width and height of a mip level in texels."""
    return max(1, size[0] >> level), max(1, size[1] >> level)


def block_shape(size: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of the blocks of a picture of so many texels."""
    return -(-size[1] // SIDE), -(-size[0] // SIDE)


def padded(texels: np.ndarray) -> np.ndarray:
    """`texels` (height, width, channels) with the last row and column repeated up to multiples of four."""
    more = ((0, -texels.shape[0] % SIDE), (0, -texels.shape[1] % SIDE), (0, 0))
    return np.pad(texels, more, mode="edge") if any(after for _, after in more) else texels


def write(path: str | Path, content: Container) -> None:
    """Write a file in the format that the ending of `path` names.

    Raises BakeError for a picture that the format does not hold, ValueError for levels of other sizes than mip levels have,
    and OSError.
    """
    file_formats.check_size(path, content.size)
    shapes = [(*block_shape(level_size(content.size, level)), content.block_format.size) for level in _range(content)]
    if [level.shape for level in content.levels] != shapes or not shapes:
        raise ValueError(f"the levels of {content.size} have the shapes {shapes}")
    parts = _ktx2(content) if file_formats.of(path) is file_formats.KTX2 else _dds(content)
    with open(path, "wb") as file:
        file.writelines(parts)


def read(path: str | Path) -> Container:
    """The content of a DDS or KTX2 file. Raises BakeError for one that cannot be read, is cut, or holds something else."""
    with _opened(path) as file:
        head = _head(file, path)
        levels = []
        for level, place in enumerate(head.places):
            shape = (*block_shape(level_size(head.size, level)), head.block_format.size)
            levels.append(np.frombuffer(place.read(file, int(np.prod(shape)), path), np.uint8).reshape(shape))
        return Container(head.size, levels, head.block_format, head.is_srgb, head.has_alpha, _note(file, head))


def head_of(path: str | Path) -> Container:
    """As `read`, without the levels. Raises BakeError."""
    with _opened(path) as file:
        head = _head(file, path)
        return Container(head.size, (), head.block_format, head.is_srgb, head.has_alpha, _note(file, head))


def _range(content: Container) -> range:
    """The numbers of the levels. Raises ValueError for more than mip levels go."""
    if len(content.levels) > max(content.size).bit_length():
        raise ValueError(f"{len(content.levels)} levels of {content.size}")
    return range(len(content.levels))


@dataclass(frozen=True)
class _Place:
    """Where the bytes of a level are in a file.

    Attributes:
        scheme: How they are packed: a number of KTX2.
    """

    start: int
    length: int
    scheme: int = 0

    def read(self, file: BinaryIO, length: int, path: str | Path) -> bytes:
        """The bytes of the level, `length` after unpacking. Raises BakeError."""
        file.seek(self.start)
        data = file.read(self.length)
        if self.scheme == _ZLIB:
            unpacker = zlib.decompressobj()
            try:
                data = unpacker.decompress(data, length + 1)
            except zlib.error as error:
                raise BakeError(f"{str(path)!r} is damaged: {error}.") from error
        if len(data) < length:
            raise BakeError(_cut(path))
        return data[:length]


@dataclass(frozen=True)
class _Head:
    """What the head of a file says.

    Attributes:
        note: Where it is in the file, and its length.
    """

    size: tuple[int, int]
    places: Sequence[_Place]
    block_format: BlockFormat
    is_srgb: bool
    has_alpha: bool
    note: tuple[int, int]


def _opened(path: str | Path) -> BinaryIO:
    try:
        return open(path, "rb")
    except OSError as error:
        raise BakeError(f"{str(path)!r} could not be read: {error.strerror}.") from error


def _head(file: BinaryIO, path: str | Path) -> _Head:
    """Raises BakeError for a file that is cut, of another format, or no plain picture of blocks."""
    total = file.seek(0, 2)
    file.seek(0)
    start = file.read(max(len(_KTX2_START), len(_DDS_START)))
    readers = ((_DDS_START, _dds_head), (_KTX2_START, _ktx2_head))
    reader = next((reader for magic, reader in readers if start.startswith(magic)), None)
    if reader is None:
        raise BakeError(f"{str(path)!r} is no DDS or KTX2 file.")
    try:
        head = reader(file, path)
    except struct.error as error:
        raise BakeError(_cut(path)) from error
    if any(place.start + place.length > total for place in head.places):
        raise BakeError(_cut(path))
    return head


def _note(file: BinaryIO, head: _Head) -> str:
    start, length = head.note
    file.seek(start)
    return file.read(min(length, _MOST_TEXT)).decode("ascii", errors="replace")


def _cut(path: str | Path) -> str:
    return f"{str(path)!r} ends too early: write or copy it again."


def _refused(path: str | Path, what: str) -> BakeError:
    names = ", ".join(block_format.label for block_format in FORMATS)
    return BakeError(f"{str(path)!r} holds {what}: Imprint reads DDS and KTX2 files of one picture in {names}.")


def _check_read(path: str | Path, size: tuple[int, int], levels: int) -> None:
    """Raise BakeError for sizes that no picture has: a hostile file may name any."""
    if not (min(size) > 0 and max(size) <= file_formats.LONGEST_SIDE and levels <= max(size).bit_length()):
        raise _refused(path, f"{levels} levels of {size[0]} x {size[1]} texels")


def _unpack(file: BinaryIO, layout: str, at: int) -> tuple:
    """Values at a place in the file. Raises struct.error at the end of the file."""
    file.seek(at)
    return struct.unpack(layout, file.read(struct.calcsize(layout)))


# DDS


_DDS_START = b"DDS "
_DDS_HEAD = "<4s7I44s2I4s5I5I"
"""The magic word; the length of the header, flags, height, width, the bytes of level 0, depth, levels; reserved words; the
pixel format: its length, flags, name, bits and masks; four words of capabilities, and a reserved one."""
_DX10 = "<5I"
"""The format's number, the dimension, flags, the number of pictures, and what alpha is."""
_DDS_FLAGS, _FOUR_CC = 0x1 | 0x2 | 0x4 | 0x1000 | 0x20000 | 0x80000, 0x4
"""Capabilities, height, width, pixel format, levels, bytes of level 0; and that the pixel format has a name."""
_TEXTURE, _MIPMAPS, _CUBE, _VOLUME = 0x1000, 0x400000 | 0x8, 0x200, 0x200000
_TEXTURE_2D, _IS_CUBE, _OPAQUE = 3, 0x4, 3
_OLD_NAMES = MappingProxyType({b"ATI1": BC4, b"BC4U": BC4, b"ATI2": BC5, b"BC5U": BC5})
_DDS_NOTE = b"IMPRINT\0"
"""The first reserved words of a file with a note. The next one is its length; it comes after all levels, where other
programs do not look."""


def _dds(content: Container) -> Iterator[bytes]:
    block_format, (width, height) = content.block_format, content.size
    number = block_format.dxgi_srgb if content.is_srgb and block_format.dxgi_srgb else block_format.dxgi
    note = content.note.encode("ascii")
    reserved = _DDS_NOTE + struct.pack("<I", len(note)) if note else b""
    count, capabilities = len(content.levels), _TEXTURE | (_MIPMAPS if len(content.levels) > 1 else 0)
    head = (_DDS_START, 124, _DDS_FLAGS, height, width, content.levels[0].size, 0, count, reserved)
    yield struct.pack(_DDS_HEAD, *head, 32, _FOUR_CC, b"DX10", 0, 0, 0, 0, 0, capabilities, 0, 0, 0, 0)
    is_opaque = block_format.channels == 4 and not content.has_alpha
    yield struct.pack(_DX10, number, _TEXTURE_2D, 0, 1, _OPAQUE if is_opaque else 0)
    yield from map(_bytes, content.levels)
    yield note


def _bytes(blocks: np.ndarray) -> bytes:
    return np.ascontiguousarray(blocks, np.uint8).tobytes()


def _dds_head(file: BinaryIO, path: str | Path) -> _Head:
    _, _, _, height, width, _, _, count, reserved, _, flags, name, *more = _unpack(file, _DDS_HEAD, 0)
    at, is_srgb, alpha = struct.calcsize(_DDS_HEAD), False, 0
    if flags & _FOUR_CC and name == b"DX10":
        number, dimension, misc, pictures, alpha = _unpack(file, _DX10, at)
        at += struct.calcsize(_DX10)
        block_format = _by_number({"dxgi": number, "dxgi_srgb": number})
        is_srgb = block_format is not None and number == block_format.dxgi_srgb
        if dimension != _TEXTURE_2D or misc & _IS_CUBE or pictures > 1:
            raise _refused(path, "several pictures")
        what = f"the format {number}"
    else:
        block_format = _OLD_NAMES.get(name) if flags & _FOUR_CC else None
        what = f"the format {name.decode('ascii', errors='replace')!r}" if flags & _FOUR_CC else "plain texels"
    if block_format is None:
        raise _refused(path, what)
    if more[6] & (_CUBE | _VOLUME):
        raise _refused(path, "several pictures")
    size, count = (width, height), max(count, 1)
    _check_read(path, size, count)
    places = []
    for level in range(count):
        rows, columns = block_shape(level_size(size, level))
        places.append(_Place(at, rows * columns * block_format.size))
        at += places[-1].length
    has_note = reserved.startswith(_DDS_NOTE)
    length = struct.unpack_from("<I", reserved, len(_DDS_NOTE))[0] if has_note else 0
    has_alpha = block_format.channels == 4 and alpha & 7 != _OPAQUE
    return _Head(size, places, block_format, is_srgb, has_alpha, (at, length))


def _by_number(numbers: Mapping[str, int]) -> BlockFormat | None:
    """The block format that has one of these numbers under its name."""
    same = (one for one in FORMATS if any(getattr(one, name) == number for name, number in numbers.items()))
    return next(same, None)


# KTX2


_KTX2_START = b"\xabKTX 20\xbb\r\n\x1a\n"
_KTX2_HEAD = "<12s9I4I2Q"
"""The identifier; format, bytes of a value, width, height, depth, layers, faces, levels, scheme; where the data format
descriptor and the texts are and their lengths, the same of data that all levels share."""
_LEVEL = "<3Q"
"""Where a level is, its length in the file, and after unpacking."""
_ZLIB = 3
_SCHEMES = (0, _ZLIB)
_NOTE, _ORIENTATION, _SWIZZLE, _WRITER = "Imprint", "KTXorientation", "KTXswizzle", "KTXwriter"
_OPAQUE_SWIZZLE = "rgb1"
_MODELS = MappingProxyType({BC4: 131, BC5: 132, BC6H: 133, BC6H_SIGNED: 133, BC7: 134})
"""Their color models in a data format descriptor."""
_LINEAR, _SRGB, _BT709, _FLOAT, _SIGNED = 1, 2, 1, 0x80, 0x40
_MINUS_ONE, _ONE = 0xBF800000, 0x3F800000
"""The bits of these floats."""


def _ktx2(content: Container) -> Iterator[bytes]:
    block_format = content.block_format
    is_srgb = content.is_srgb and block_format.vulkan_srgb is not None
    number = block_format.vulkan_srgb if is_srgb else block_format.vulkan
    is_opaque = block_format.channels == 4 and not content.has_alpha
    descriptor = _descriptor(block_format, is_srgb=is_srgb)
    texts = _texts(
        ({_NOTE: content.note} if content.note else {})
        | {_ORIENTATION: "rd"}
        | ({_SWIZZLE: _OPAQUE_SWIZZLE} if is_opaque else {})
        | {_WRITER: "Imprint"}
    )
    count = len(content.levels)
    first = struct.calcsize(_KTX2_HEAD) + count * struct.calcsize(_LEVEL)
    at = first + len(descriptor) + len(texts)
    pad = -at % block_format.size  # levels begin at multiples of a block, 8 or 16 bytes, and fill blocks alone
    at += pad
    index = []
    for blocks in reversed(content.levels):
        index.append(struct.pack(_LEVEL, at, blocks.size, blocks.size))
        at += blocks.size
    head = (_KTX2_START, number, 1, *content.size, 0, 0, 1, count, 0)
    yield struct.pack(_KTX2_HEAD, *head, first, len(descriptor), first + len(descriptor), len(texts), 0, 0)
    yield from reversed(index)
    yield descriptor + texts + bytes(pad)
    yield from map(_bytes, reversed(content.levels))


def _descriptor(block_format: BlockFormat, *, is_srgb: bool) -> bytes:
    """The data format descriptor: one block, whose samples are what a block of texels has, as BC5 has red and green."""
    count = 2 if block_format is BC5 else 1
    bits = 8 * block_format.size // count
    kind = _FLOAT * block_format.is_float | _SIGNED * block_format.is_signed
    least, most = _MINUS_ONE * block_format.is_signed, _ONE if block_format.is_float else 0xFFFFFFFF
    samples = [struct.pack("<HBB4xII", bits * each, bits - 1, each | kind, least, most) for each in range(count)]
    length = 24 + 16 * count
    model = (_MODELS[block_format], _BT709, _SRGB if is_srgb else _LINEAR, 0)
    sides = (SIDE - 1, SIDE - 1, 0, 0)
    block = struct.pack("<IHH4B4B8B", 0, 2, length, *model, *sides, block_format.size, *[0] * 7)
    return struct.pack("<I", 4 + length) + block + b"".join(samples)


def _texts(texts: Mapping[str, str]) -> bytes:
    """Keys and values, sorted by their keys as the format wants it, each padded to four bytes."""
    result = b""
    for key in sorted(texts):
        item = key.encode() + b"\0" + texts[key].encode("ascii") + b"\0"
        result += struct.pack("<I", len(item)) + item + bytes(-len(item) % 4)
    return result


def _ktx2_head(file: BinaryIO, path: str | Path) -> _Head:
    values = _unpack(file, _KTX2_HEAD, 0)
    _, number, _, width, height, depth, layers, faces, count, scheme, _, _, texts_at, texts_length, _, _ = values
    block_format = _by_number({"vulkan": number, "vulkan_srgb": number})
    if block_format is None:
        raise _refused(path, f"the format {number}" if number else "a supercompressed format")
    if depth or layers > 1 or faces > 1:
        raise _refused(path, "several pictures")
    if scheme not in _SCHEMES:
        raise _refused(path, f"the supercompression {scheme}")
    size, count = (width, height), max(count, 1)
    _check_read(path, size, count)
    at = struct.calcsize(_KTX2_HEAD)
    index = [_unpack(file, _LEVEL, at + level * struct.calcsize(_LEVEL)) for level in range(count)]
    found = dict(_text_places(file, texts_at, min(texts_length, _MOST_TEXT)))
    is_opaque = _value(file, found.get(_SWIZZLE)) == _OPAQUE_SWIZZLE
    return _Head(
        size,
        [_Place(start, length, scheme) for start, length, _ in index],
        block_format,
        number == block_format.vulkan_srgb,
        block_format.channels == 4 and not is_opaque,
        found.get(_NOTE, (0, 0)),
    )


def _text_places(file: BinaryIO, at: int, length: int) -> Iterator[tuple[str, tuple[int, int]]]:
    """The keys of the texts, and where their values are, with their lengths without the zero at their end.

    Raises struct.error at the end of the file.
    """
    stop = at + length
    while at + 4 <= stop:
        (count,) = _unpack(file, "<I", at)
        (item,) = _unpack(file, f"{min(count, stop - at - 4)}s", at + 4)
        key, _, value = item.partition(b"\0")
        yield key.decode(errors="replace"), (at + 4 + len(key) + 1, len(value.removesuffix(b"\0")))
        at += 4 + count + -count % 4


def _value(file: BinaryIO, place: tuple[int, int] | None) -> str:
    if place is None:
        return ""
    file.seek(place[0])
    return file.read(place[1]).decode(errors="replace")
