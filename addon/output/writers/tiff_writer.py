# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes TIFF files (TIFF 6.0, Adobe, 1992) of 8 or 16 bits, deflated, with alpha that is not multiplied into colors."""

import struct
import zlib
from collections.abc import Iterator
from itertools import accumulate
from typing import BinaryIO

import numpy as np

from ..quantize import steps
from .content import Content, for_rows, pieces, top_first
from .deflating import HEADER, Method, Search, choose, deflate

START, HEAD = b"II*\0", 8
"""The first bytes, and the size of the head. Behind them is the place of the directory."""
STRIP = 1 << 19
"""Bytes of a strip before it is deflated. Readers keep one in memory."""
SEARCHES = {8: Search(level=5, gain=0.92), 16: Search(level=4, gain=0.65)}
"""By bits. They give files that are at most a tenth larger than those of Blender's writer, on maps of all kinds."""
STORED = Method(0, zlib.Z_DEFAULT_STRATEGY)
"""For a strip without any repeats, as of noise: other methods make it larger."""
MOST = 1 << 32
"""Bytes that the offsets of a file can count."""
STRIP_OFFSETS, ROWS_PER_STRIP, STRIP_BYTE_COUNTS, EXTRA_SAMPLES = 273, 278, 279, 338
"""Tags."""
DEFLATE, RGB, TOP_LEFT, CHUNKY, INCH, DIFFERENCES, UNASSOCIATED, UNSIGNED = 8, 2, 1, 1, 2, 2, 2, 1
"""Values of tags."""
LAYOUTS = {3: "H", 4: "I", 5: "II"}
"""The struct formats of SHORT, LONG and RATIONAL."""
SHORT, LONG, RATIONAL = LAYOUTS


def content(texels: np.ndarray, depth: int, *, has_alpha: bool, is_color: bool = False) -> Content:
    """The file of `texels` (height, width, 4) float32 with row 0 at v = 0, as `depth` bits per channel."""
    texels = top_first(texels, has_alpha)
    rows = _differences(texels, depth)
    height, row_bytes = rows.shape
    each = max(1, STRIP // row_bytes)

    def part(where: slice) -> list[bytes]:
        method = choose(rows[where], SEARCHES[depth])
        strips = (rows[start : min(start + each, where.stop)] for start in range(where.start, where.stop, each))
        return [_strip(strip, method) for strip in strips]

    def write(file: BinaryIO, results: Iterator[list[bytes]]) -> None:
        file.write(START + bytes(HEAD - len(START)))
        sizes = []
        for strip in (strip for found in results for strip in found):
            file.write(strip)
            sizes.append(len(strip))
        starts = list(accumulate(sizes[:-1], initial=HEAD))
        end = starts[-1] + sizes[-1]
        directory = end + end % 2  # at an even place
        file.write(bytes(directory - end))
        if directory + (len(starts) + 64) * 8 >= MOST:
            raise RuntimeError("a TIFF file has at most 4 GB")
        strips = {STRIP_OFFSETS: starts, ROWS_PER_STRIP: [each], STRIP_BYTE_COUNTS: sizes}
        file.write(_directory(directory, texels.shape, depth, strips))
        file.seek(len(START))
        file.write(struct.pack("<I", directory))

    slices = pieces(height, row_bytes, each)
    return Content([lambda where=where: part(where) for where in slices], write)


def _strip(rows: np.ndarray, method: Method) -> bytes:
    found = deflate(rows, method, is_last=True)
    if len(found.data) > rows.nbytes:  # Blender reads strips wrongly that have grown by much
        found = deflate(rows, STORED, is_last=True)
    return HEADER + found.data + struct.pack(">I", found.adler)


def _differences(texels: np.ndarray, depth: int) -> np.ndarray:
    """The rows (height, bytes) uint8 of `texels`: each number less the one to its left."""
    height, width, channels = texels.shape
    result = np.empty((height, width * channels), np.uint8 if depth == 8 else np.dtype("<u2"))

    def work(blocks: Iterator[slice]) -> None:
        for rows in blocks:
            plain = steps(texels[rows], depth).reshape(rows.stop - rows.start, -1)
            result[rows, :channels] = plain[:, :channels]
            np.subtract(plain[:, channels:], plain[:, :-channels], out=result[rows, channels:])

    rows = result.view(np.uint8)
    for_rows(height, rows.shape[1], work)
    return rows


def _directory(at: int, shape: tuple[int, int, int], depth: int, strips: dict[int, list[int]]) -> bytes:
    """The directory at position `at`. shape: height, width and channels. strips: values of the tags of strips."""
    height, width, channels = shape
    entries = [
        (256, LONG, [width]),
        (257, LONG, [height]),
        (258, SHORT, [depth] * channels),
        (259, SHORT, [DEFLATE]),
        (262, SHORT, [RGB]),
        (274, SHORT, [TOP_LEFT]),
        (277, SHORT, [channels]),
        *((tag, LONG, values) for tag, values in strips.items()),
        (282, RATIONAL, [72, 1]),
        (283, RATIONAL, [72, 1]),
        (284, SHORT, [CHUNKY]),
        (296, SHORT, [INCH]),
        (317, SHORT, [DIFFERENCES]),
        *([(EXTRA_SAMPLES, SHORT, [UNASSOCIATED])] if channels == 4 else []),
        (339, SHORT, [UNSIGNED] * channels),
    ]
    head, more = struct.pack("<H", len(entries)), b""
    behind = at + 2 + 12 * len(entries) + 4  # where values of more than four bytes are
    for tag, kind, values in sorted(entries):
        data = struct.pack(f"<{len(values)}{LAYOUTS[kind][0]}", *values)
        if len(data) > 4:
            data, more = struct.pack("<I", behind + len(more)), more + data
        head += struct.pack("<HHI4s", tag, kind, len(values) // len(LAYOUTS[kind]), data)
    return head + bytes(4) + more
