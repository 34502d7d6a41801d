# SPDX-License-Identifier: GPL-3.0-or-later
"""Deflates filtered rows of texels, as fast as zlib can without larger files than its usual search for repeats gives."""

import zlib
from typing import NamedTuple

import numpy as np

HEADER = b"\x78\x01"
"""Of a zlib stream with the largest window. Behind the data is their checksum."""
WINDOW, MEMORY = -15, 9
"""zlib's largest window, without a header, and its largest tables."""
SAMPLES, SAMPLE_SHARE, LEAST_SAMPLE = 4, 64, 1 << 14
"""The number of places where rows are tried, the share of them that is tried, and the least bytes at a place: half of zlib's
window, so that repeats of the row above are found."""
MODULUS = 65521
"""Of the checksum Adler-32."""


class Method(NamedTuple):
    """How zlib deflates. strategy: of zlib."""

    level: int
    strategy: int


RUNS = Method(6, zlib.Z_RLE)
"""Looks only for runs of one byte, which is fastest."""


class Search(NamedTuple):
    """A search for any repeats of bytes. level: of zlib. gain: it is worth its time if it leaves less than this of what RUNS
    leave."""

    level: int
    gain: float


class Deflated(NamedTuple):
    """A piece of a stream. adler: the checksum of its `length` bytes before they were deflated."""

    data: bytes
    adler: int
    length: int


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
