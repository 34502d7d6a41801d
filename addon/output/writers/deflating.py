# SPDX-License-Identifier: GPL-3.0-or-later
"""Deflates filtered rows of texels, as fast as zlib can without larger files than its usual search for repeats gives."""

import zlib
from typing import NamedTuple

import numpy as np

HEADER = b"\x78\x01"
"""Of a zlib stream with the largest window. Behind the data is their checksum."""
WINDOW, MEMORY = -15, 9
"""zlib's largest window, without a header, and its largest tables."""
RUNS, REPEATS = (6, zlib.Z_RLE), (1, zlib.Z_DEFAULT_STRATEGY)
"""Levels and strategies: look only for runs of one byte, which is fastest; or for any repeat."""
SAMPLES, SAMPLE_SHARE = 8, 64
"""The number of places where a piece is tried, and its share that is tried."""
GAIN = 0.96
"""Repeats are sought if they make the sample smaller than this, compared to runs."""
MODULUS = 65521
"""Of the checksum Adler-32."""


class Deflated(NamedTuple):
    """A piece of a stream. adler: the checksum of its `length` bytes before they were deflated."""

    data: bytes
    adler: int
    length: int


def deflate(rows: np.ndarray, *, is_last: bool) -> Deflated:
    """Deflate `rows` uint8, contiguous. Pieces can follow each other in one stream, of which one is the last."""
    plain = memoryview(rows).cast("B")
    packer = _packer(_choice(plain))
    data = packer.compress(plain) + packer.flush(zlib.Z_FINISH if is_last else zlib.Z_SYNC_FLUSH)
    return Deflated(data, zlib.adler32(plain), len(plain))


def joined(adler: int, piece: Deflated) -> int:
    """The checksum of a stream with the checksum `adler` and a piece behind it. That of an empty stream is 1."""
    first, second = (adler & 0xFFFF) + (piece.adler & 0xFFFF) - 1, (adler >> 16) + (piece.adler >> 16)
    second += piece.length * ((adler & 0xFFFF) - 1)
    return first % MODULUS | (second % MODULUS) << 16


def _packer(choice: tuple[int, int]) -> "zlib._Compress":
    level, strategy = choice
    return zlib.compressobj(level, zlib.DEFLATED, WINDOW, MEMORY, strategy)


def _choice(plain: memoryview) -> tuple[int, int]:
    """RUNS or REPEATS, by what each makes of a sample."""
    size = len(plain) // (SAMPLES * SAMPLE_SHARE)
    if size == 0:
        return REPEATS
    step = len(plain) // SAMPLES
    sample = b"".join(plain[start : start + size] for start in range(0, step * SAMPLES, step))
    runs, repeats = (len(packer.compress(sample) + packer.flush()) for packer in map(_packer, (RUNS, REPEATS)))
    return REPEATS if repeats < runs * GAIN else RUNS
