# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes PNG files (W3C Portable Network Graphics Specification, second edition) of 8 or 16 bits."""

import io
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO, NamedTuple

import numpy as np

from ..core import threads
from .value_encoding import steps
from .write_queue import Content, for_rows, top_first

SIGNATURE = b"\x89PNG\r\n\x1a\n"
COLOR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}
"""The numbers of gray, gray with alpha, colors, and colors with alpha, by channels."""
SUB = 1
"""The filter of small pictures: the byte to the left."""
PAETH = 4
"""The filter of all rows: the nearest of the bytes to the left, above, and above left to their plane."""
HEADER = b"\x78\x01"
"""Of a zlib stream with the largest window. Behind the data is their checksum."""
WINDOW, MEMORY = -15, 9
"""zlib's largest window, without a header, and its largest tables."""
SAMPLES, SAMPLE_SHARE, LEAST_SAMPLE = 4, 64, 1 << 14
"""The number of places where rows are tried, the share of them that is tried, and the least bytes at a place: half of zlib's
window, so that repeats of the row above are found."""
MODULUS = 65521
"""Of the checksum Adler-32."""
LEAST_PIECE, MOST_PIECE = 1 << 18, 1 << 24
"""The least and the most bytes that a thread deflates at a time."""
COLOR_SPACE = (
    # Of colors alone: readers that follow these chunks would change data. sRGB is declared with its gamma and its primaries,
    # times 100,000, for readers that do not know it.
    (b"sRGB", b"\3"),
    (b"gAMA", struct.pack(">I", 45455)),
    (b"cHRM", struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)),
)


class Method(NamedTuple):
    """How zlib deflates.

    Attributes:
        strategy: Of zlib.
    """

    level: int
    strategy: int


RUNS = Method(6, zlib.Z_RLE)
"""Looks only for runs of one byte, which is fastest."""


class Search(NamedTuple):
    """A search for any repeats of bytes.

    Attributes:
        level: Of zlib.
        gain: It is worth its time if it leaves less than this of what RUNS leave.
    """

    level: int
    gain: float


class Deflated(NamedTuple):
    """A piece of a stream.

    Attributes:
        adler: The checksum of its `length` bytes before they were deflated.
    """

    data: bytes
    adler: int
    length: int


SEARCHES = {8: Search(level=2, gain=0.96), 16: Search(level=1, gain=0.96)}
"""By bits. They give files that are at most a tenth larger than those of Blender's writer, on maps of all kinds."""


class _Piece(NamedTuple):
    """A piece of the stream of rows.

    Attributes:
        checksum: Of its chunk.
    """

    deflated: Deflated
    checksum: int


def content(
    texels: np.ndarray,
    depth: int,
    *,
    has_alpha: bool,
    is_color: bool = False,
    is_gray: bool = False,
    texts: Mapping[str, str] = MappingProxyType({}),
) -> Content:
    """The file of `texels` (height, width, 4) float32 with row 0 at v = 0, as `depth` bits per channel. is_color: whether they
    are sRGB, which the file says. is_gray: whether red stands for all colors, as a single channel. texts: in ASCII, by their
    keywords."""
    texels = top_first(texels, has_alpha, is_gray=is_gray)
    height, width, channels = texels.shape
    filtered = _filtered(texels, depth)
    slices = pieces(height, filtered.shape[1])
    head = struct.pack(">2I5B", width, height, depth, COLOR_TYPES[channels], 0, 0, 0)

    def part(where: slice) -> _Piece:
        rows = filtered[where]
        deflated = deflate(rows, choose(rows, SEARCHES[depth]), is_last=where.stop == height)
        return _Piece(deflated, zlib.crc32(deflated.data, zlib.crc32(b"IDAT")))

    def write(path: Path, results: Iterator[_Piece]) -> None:
        with path.open("wb") as file:
            file.write(SIGNATURE)
            notes = [(b"tEXt", f"{key}\0{text}".encode("ascii")) for key, text in texts.items()]
            for name, data in ((b"IHDR", head), *(COLOR_SPACE if is_color else ()), *notes, (b"IDAT", HEADER)):
                _write_chunk(file, name, data)
            adler = 1
            for piece in results:
                _write_chunk(file, b"IDAT", piece.deflated.data, piece.checksum)
                adler = joined(adler, piece.deflated)
            _write_chunk(file, b"IDAT", struct.pack(">I", adler))
            _write_chunk(file, b"IEND", b"")

    return Content([lambda where=where: part(where) for where in slices], write)


def texts(path: str | Path) -> dict[str, str]:
    """The texts before the texels of a PNG file, by their keywords; none if it is no PNG file."""
    texts = {}
    with open(path, "rb") as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            return texts
        while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
            length = int.from_bytes(head[:4], "big")
            if head[4:] == b"tEXt":
                key, _, text = file.read(length).partition(b"\0")
                texts[key.decode("latin-1")] = text.decode("latin-1")
                length = 0
            file.seek(length + 4, io.SEEK_CUR)
    return texts


def small(pixels: np.ndarray) -> bytes:
    """A file of `pixels` (height, width, 3) uint8 with row 0 on top, for pictures of which there are many."""
    height, width, _ = pixels.shape
    left = np.zeros_like(pixels)
    left[:, 1:] = pixels[:, :-1]
    rows = np.empty((height, 1 + 3 * width), np.uint8)
    rows[:, 0] = SUB
    rows[:, 1:] = (pixels - left).reshape(height, -1)
    file = io.BytesIO()
    file.write(SIGNATURE)
    head = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    for name, data in ((b"IHDR", head), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b"")):
        _write_chunk(file, name, data)
    return file.getvalue()


def _write_chunk(file: BinaryIO, name: bytes, data: bytes, checksum: int | None = None) -> None:
    file.write(struct.pack(">I", len(data)) + name)
    file.write(data)
    file.write(struct.pack(">I", zlib.crc32(name + data) if checksum is None else checksum))


def _filtered(texels: np.ndarray, depth: int) -> np.ndarray:
    """The rows (height, bytes) uint8 of `texels`, each behind the number of its filter."""
    height, width, channels = texels.shape
    texel = channels * depth // 8
    result = np.empty((height, 1 + width * texel), np.uint8)
    result[:, 0] = PAETH

    def work(blocks: Iterator[slice]) -> None:
        framed, buffers = None, None
        for rows in blocks:
            count = rows.stop - rows.start
            if framed is None or len(framed) != count + 1:  # as few new arrays as possible: each takes new pages
                # A column of zeros to the left of the first texel, and a row of zeros above the first one.
                framed = np.zeros((count + 1, texel + width * texel), np.uint8)
                buffers = np.empty((6, count, width * texel), np.uint8)
            before = max(rows.start - 1, 0)
            plain = big_endian(steps(texels[before : rows.stop], depth))
            framed[len(framed) - len(plain) :, texel:] = plain
            if not rows.start:
                framed[0] = 0
            np.subtract(framed[1:, texel:], _predicted(framed, texel, buffers), out=result[rows, 1:])

    for_rows(height, result.shape[1], work)
    return result


def big_endian(values: np.ndarray) -> np.ndarray:
    """The bytes (N, bytes) uint8 of whole numbers (N, width, channels), each with its highest byte first."""
    return values.astype(values.dtype.newbyteorder(">"), copy=False).view(np.uint8).reshape(len(values), -1)


def _predicted(framed: np.ndarray, texel: int, buffers: np.ndarray) -> np.ndarray:
    """What the filter predicts for all bytes but those of the first row and the first texel.

    framed: rows of bytes, uint8. texel: bytes of a texel. buffers: six arrays of the result's size, of which one is returned.
    The differences stay within a byte: left + above - corner is nearest to the corner only if the corner is between the other
    two, and then it is as far from it as the two distances differ.
    """
    left, above, corner = framed[1:, :-texel], framed[:-1, texel:], framed[:-1, :-texel]
    to_left, to_above, to_corner, result, mask, other = buffers
    for distance, side in ((to_left, above), (to_above, left)):
        np.maximum(side, corner, out=distance)
        np.subtract(distance, np.minimum(side, corner, out=other), out=distance)
    np.maximum(to_left, to_above, out=to_corner)
    to_corner -= np.minimum(to_left, to_above, out=other)
    np.less(left, corner, out=mask.view(bool))
    np.less(above, corner, out=other.view(bool))
    mask ^= other
    mask -= 1  # 255 where the corner is not between them: farther than the others
    to_corner |= mask
    np.bitwise_xor(above, corner, out=result)
    result &= _where_nearer(to_above, to_corner, mask)
    result ^= corner
    np.bitwise_xor(left, result, out=other)
    np.minimum(to_above, to_corner, out=to_above)
    other &= _where_nearer(to_left, to_above, mask)
    result ^= other
    return result


def _where_nearer(first: np.ndarray, second: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """`mask` uint8, made 255 where `first` is at most `second`, else 0. Several times as fast as numpy.where."""
    np.less_equal(first, second, out=mask.view(bool))
    return np.negative(mask, out=mask)


def pieces(height: int, row_bytes: int) -> list[slice]:
    """Slices that cover `height` rows: one for each processor, unless they are too small or too large."""
    wanted = -(-height * row_bytes // threads.processors())
    return threads.blocks(height, max(1, min(max(wanted, LEAST_PIECE), MOST_PIECE) // row_bytes))


def choose(rows: np.ndarray, search: Search) -> Method:
    """RUNS, or the method of `search`, by what each makes of a sample of `rows` uint8, contiguous."""
    plain, method = memoryview(rows).cast("B"), Method(search.level, zlib.Z_DEFAULT_STRATEGY)
    size, step = max(LEAST_SAMPLE, len(plain) // (SAMPLES * SAMPLE_SHARE)), max(1, len(plain) // SAMPLES)
    sample = b"".join(plain[start : start + min(size, step)] for start in range(0, step * SAMPLES, step))
    runs, repeats = (len(packer.compress(sample) + packer.flush()) for packer in map(_packer, (RUNS, method)))
    return method if repeats < runs * search.gain else RUNS


def deflate(rows: np.ndarray, method: Method, *, is_last: bool) -> Deflated:
    """Deflate `rows` uint8, contiguous. Pieces can follow each other in one stream, of which one is the last."""
    plain, packer = memoryview(rows).cast("B"), _packer(method)
    data = packer.compress(plain) + packer.flush(zlib.Z_FINISH if is_last else zlib.Z_SYNC_FLUSH)
    return Deflated(data, zlib.adler32(plain), len(plain))


def joined(adler: int, piece: Deflated) -> int:
    """The checksum of a stream with the checksum `adler` and a piece behind it. That of an empty stream is 1."""
    first, second = (adler & 0xFFFF) + (piece.adler & 0xFFFF) - 1, (adler >> 16) + (piece.adler >> 16)
    second += piece.length * ((adler & 0xFFFF) - 1)
    return first % MODULUS | (second % MODULUS) << 16


def _packer(method: Method) -> "zlib._Compress":
    return zlib.compressobj(method.level, zlib.DEFLATED, WINDOW, MEMORY, method.strategy)
