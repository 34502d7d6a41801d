# SPDX-License-Identifier: GPL-3.0-or-later
"""What BC6H and BC7 fix: partitions, anchors, weights, and where the bits of each mode are. Khronos Data Format
Specification 1.3, chapters "BPTC Compressed Texture Image Formats"."""

import re
from functools import cache
from typing import NamedTuple

import numpy as np

WEIGHTS = {
    2: np.array([0, 21, 43, 64]),
    3: np.array([0, 9, 18, 27, 37, 46, 55, 64]),
    4: np.array([0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64]),
}
"""Of the second end point in 64ths, for indices of so many bits."""

_IN_TWO = """
cccc 8888 eeee ecc8 c880 feec fec8 ec80 c800 ffec fe80 e800 ffe8 ff00 fff0 f000
f710 008e 7100 08ce 008c 7310 3100 8cce 088c 3110 6666 366c 17e8 0ff0 718e 399c
aaaa f0f0 5a5a 33cc 3c3c 55aa 9696 a55a 73ce 13c8 324c 3bdc 6996 c33c 9966 0660
0272 04e4 4e40 2720 c936 936c 39c6 639c 9336 9cc6 817e e718 ccf0 0fcc 7744 ee22
"""
"""The texels of the second subset, the first in the lowest bit."""
_IN_THREE = """
0011001102212222 0001001122112221 0000200122112211 0222002200110111 0000000011221122 0011001100220022
0022002211111111 0011001122112211 0000000011112222 0000111111112222 0000111122222222 0012001200120012
0112011201120112 0122012201220122 0011011211221222 0011200122002220 0001001101121122 0111001120012200
0000112211221122 0022002200221111 0111011102220222 0001000122212221 0000001101220122 0000110022102210
0122012200110000 0012001211222222 0110122112210110 0000011012211221 0022110211020022 0110011020022222
0011012201220011 0000200022112221 0000000211221222 0222002200120011 0011001200220222 0120012001200120
0000111122220000 0120120120120120 0120201212010120 0011220011220011 0011112222000011 0101010122222222
0000000021212121 0022112200221122 0022001100220011 0220122102201221 0101222222220101 0000212121212121
0101010101012222 0222011102220111 0002111200021112 0000211221122112 0222011101110222 0002111211120002
0110011001102222 0000000021122112 0110011022222222 0022001100110022 0022112211220022 0000000000002112
0002000100020001 0222122202221222 0101222222222222 0111201122012220
"""
PARTITIONS = {
    1: np.zeros((1, 16), np.uint8),
    2: (np.array([int(word, 16) for word in _IN_TWO.split()])[:, None] >> np.arange(16) & 1).astype(np.uint8),
    3: np.array([[int(digit) for digit in word] for word in _IN_THREE.split()], np.uint8),
}
"""The subset of each texel, (partitions, 16), for so many subsets. BC6H has the first 32 of two subsets."""

_SECOND_OF_TWO = "ffffffffffffffff f282288f28228822 ff6828ff28222ff6 6268ff22fffff22f"
_SECOND_OF_THREE = "33ff83ff88666533 338f336a588685ff 8f356a8ff3f5ffff 3f55585a5a8dfc33"
_THIRD_OF_THREE = "f883ff38fffffff8 f8f3f8f83f6affa8 f3faa89a6f8f3668 f3ffffffffff3ff8"


def _hexadecimal(text: str) -> np.ndarray:
    return np.array([int(digit, 16) for digit in text.replace(" ", "")])


def _anchors() -> dict[int, np.ndarray]:
    two, three, last = map(_hexadecimal, (_SECOND_OF_TWO, _SECOND_OF_THREE, _THIRD_OF_THREE))
    first = np.zeros(64, int)
    return {1: first[:1, None], 2: np.stack([first, two], 1), 3: np.stack([first, three, last], 1)}


ANCHORS = _anchors()
"""The texel of each subset whose index lacks its highest bit, which is 0: (partitions, subsets)."""


class Bc7Mode(NamedTuple):
    """How a mode of BC7 divides its bits, in their order: `number` zeros and a one come before all of them."""

    number: int
    subsets: int
    partition_bits: int
    rotation_bits: int
    selector_bits: int
    color_bits: int
    alpha_bits: int
    own_lowest: int
    """Bits that end the channels of one end point each, "P-bits"."""
    shared_lowest: int
    """Bits that end the channels of both end points of a subset each."""
    index_bits: int
    second_index_bits: int


BC7_MODES = (
    Bc7Mode(0, 3, 4, 0, 0, 4, 0, 1, 0, 3, 0),
    Bc7Mode(1, 2, 6, 0, 0, 6, 0, 0, 1, 3, 0),
    Bc7Mode(2, 3, 6, 0, 0, 5, 0, 0, 0, 2, 0),
    Bc7Mode(3, 2, 6, 0, 0, 7, 0, 1, 0, 2, 0),
    Bc7Mode(4, 1, 0, 2, 1, 5, 6, 0, 0, 2, 3),
    Bc7Mode(5, 1, 0, 2, 0, 7, 8, 0, 0, 2, 2),
    Bc7Mode(6, 1, 0, 0, 0, 7, 7, 1, 0, 4, 0),
    Bc7Mode(7, 2, 6, 0, 0, 5, 5, 1, 0, 2, 0),
)


class Bits(NamedTuple):
    """A run of bits of a block, which are bits of a value."""

    at: int
    """The first of the block."""
    width: int
    up: int
    """The bit of the value that the first one is."""


class Bc6hMode(NamedTuple):
    """A mode of BC6H."""

    code: int
    """The first bits of the block."""
    code_bits: int
    precision: int
    """The bits of the first end point."""
    others: tuple[int, int, int]
    """The bits of red, green and blue of the other end points."""
    is_relative: bool
    """Whether the other end points are stored as differences to the first, with a sign."""
    layout: str
    """Where the bits are, in their order: channel, end point, and the bits, of which the last named comes first.
    "p" is the partition."""

    @property
    def regions(self) -> int:
        return 2 if "p" in self.layout else 1

    @property
    def index_bits(self) -> int:
        return 3 if "p" in self.layout else 4


BC6H_MODES = (
    Bc6hMode(
        *(0b00, 2, 10, (5, 5, 5), True),
        "g2.4 b2.4 b3.4 r0.9:0 g0.9:0 b0.9:0 r1.4:0 g3.4 g2.3:0 g1.4:0 b3.0 g3.3:0 b1.4:0 b3.1 b2.3:0 r2.4:0 b3.2 "
        "r3.4:0 b3.3 p.4:0",
    ),
    Bc6hMode(
        *(0b01, 2, 7, (6, 6, 6), True),
        "g2.5 g3.4 g3.5 r0.6:0 b3.0 b3.1 b2.4 g0.6:0 b2.5 b3.2 g2.4 b0.6:0 b3.3 b3.5 b3.4 r1.5:0 g2.3:0 g1.5:0 g3.3:0 "
        "b1.5:0 b2.3:0 r2.5:0 r3.5:0 p.4:0",
    ),
    Bc6hMode(
        *(0b00010, 5, 11, (5, 4, 4), True),
        "r0.9:0 g0.9:0 b0.9:0 r1.4:0 r0.10 g2.3:0 g1.3:0 g0.10 b3.0 g3.3:0 b1.3:0 b0.10 b3.1 b2.3:0 r2.4:0 b3.2 "
        "r3.4:0 b3.3 p.4:0",
    ),
    Bc6hMode(
        *(0b00110, 5, 11, (4, 5, 4), True),
        "r0.9:0 g0.9:0 b0.9:0 r1.3:0 r0.10 g3.4 g2.3:0 g1.4:0 g0.10 g3.3:0 b1.3:0 b0.10 b3.1 b2.3:0 r2.3:0 b3.0 b3.2 "
        "r3.3:0 g2.4 b3.3 p.4:0",
    ),
    Bc6hMode(
        *(0b01010, 5, 11, (4, 4, 5), True),
        "r0.9:0 g0.9:0 b0.9:0 r1.3:0 r0.10 b2.4 g2.3:0 g1.3:0 g0.10 b3.0 g3.3:0 b1.4:0 b0.10 b2.3:0 r2.3:0 b3.1 b3.2 "
        "r3.3:0 b3.4 b3.3 p.4:0",
    ),
    Bc6hMode(
        *(0b01110, 5, 9, (5, 5, 5), True),
        "r0.8:0 b2.4 g0.8:0 g2.4 b0.8:0 b3.4 r1.4:0 g3.4 g2.3:0 g1.4:0 b3.0 g3.3:0 b1.4:0 b3.1 b2.3:0 r2.4:0 b3.2 "
        "r3.4:0 b3.3 p.4:0",
    ),
    Bc6hMode(
        *(0b10010, 5, 8, (6, 5, 5), True),
        "r0.7:0 g3.4 b2.4 g0.7:0 b3.2 g2.4 b0.7:0 b3.3 b3.4 r1.5:0 g2.3:0 g1.4:0 b3.0 g3.3:0 b1.4:0 b3.1 b2.3:0 r2.5:0 "
        "r3.5:0 p.4:0",
    ),
    Bc6hMode(
        *(0b10110, 5, 8, (5, 6, 5), True),
        "r0.7:0 b3.0 b2.4 g0.7:0 g2.5 g2.4 b0.7:0 g3.5 b3.4 r1.4:0 g3.4 g2.3:0 g1.5:0 g3.3:0 b1.4:0 b3.1 b2.3:0 r2.4:0 "
        "b3.2 r3.4:0 b3.3 p.4:0",
    ),
    Bc6hMode(
        *(0b11010, 5, 8, (5, 5, 6), True),
        "r0.7:0 b3.1 b2.4 g0.7:0 b2.5 g2.4 b0.7:0 b3.5 b3.4 r1.4:0 g3.4 g2.3:0 g1.4:0 b3.0 g3.3:0 b1.5:0 b2.3:0 r2.4:0 "
        "b3.2 r3.4:0 b3.3 p.4:0",
    ),
    Bc6hMode(
        *(0b11110, 5, 6, (6, 6, 6), False),
        "r0.5:0 g3.4 b3.0 b3.1 b2.4 g0.5:0 g2.5 b2.5 b3.2 g2.4 b0.5:0 g3.5 b3.3 b3.5 b3.4 r1.5:0 g2.3:0 g1.5:0 g3.3:0 "
        "b1.5:0 b2.3:0 r2.5:0 r3.5:0 p.4:0",
    ),
    Bc6hMode(0b00011, 5, 10, (10, 10, 10), False, "r0.9:0 g0.9:0 b0.9:0 r1.9:0 g1.9:0 b1.9:0"),
    Bc6hMode(
        *(0b00111, 5, 11, (9, 9, 9), True),
        "r0.9:0 g0.9:0 b0.9:0 r1.8:0 r0.10 g1.8:0 g0.10 b1.8:0 b0.10",
    ),
    Bc6hMode(
        *(0b01011, 5, 12, (8, 8, 8), True),
        "r0.9:0 g0.9:0 b0.9:0 r1.7:0 r0.10:11 g1.7:0 g0.10:11 b1.7:0 b0.10:11",
    ),
    Bc6hMode(
        *(0b01111, 5, 16, (4, 4, 4), True),
        "r0.9:0 g0.9:0 b0.9:0 r1.3:0 r0.10:15 g1.3:0 g0.10:15 b1.3:0 b0.10:15",
    ),
)


@cache
def bc6h_fields(mode: Bc6hMode) -> dict[str, list[Bits]]:
    """Where a mode of BC6H has its values: by channel and end point, as "g2", and "p", the partition."""
    fields: dict[str, list[Bits]] = {}
    at = mode.code_bits
    for name, high, low in re.findall(r"(\w+)\.(\d+)(?::(\d+))?", mode.layout):
        first, last = int(low or high), int(high)
        if first <= last:
            fields.setdefault(name, []).append(Bits(at, last - first + 1, first))
        else:
            fields.setdefault(name, []).extend(Bits(at + first - bit, 1, bit) for bit in range(first, last - 1, -1))
        at += abs(last - first) + 1
    return fields


@cache
def index_places(subsets: int, bits: int) -> tuple[np.ndarray, np.ndarray]:
    """The first bit of each texel's index after that of the first texel, and the bits that are set in the highest one.

    Args:
        bits: Of an index that is no anchor's.

    Returns:
        Two arrays (partitions, 16) uint64.
    """
    anchors = ANCHORS[subsets]
    widths = np.full((len(anchors), 16), bits)
    np.put_along_axis(widths, anchors, bits - 1, 1)
    starts = np.cumsum(widths, 1) - widths
    return starts.astype(np.uint64), ((1 << widths) - 1).astype(np.uint64)
