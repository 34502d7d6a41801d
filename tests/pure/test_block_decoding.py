# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what is read from blocks that are packed bit by bit, against the formulas of the specification."""

from fractions import Fraction

import numpy as np
import pytest

from addon.blocks import formats, tables
from addon.blocks.decoding import decoded
from tests.support.packed_blocks import packed, random_blocks

INDICES = [0, 7, 15, 3, 9, 1, 14, 5, 12, 2, 8, 11, 4, 13, 6, 10]
"""Of 16 texels, 4 bits each; the first one's highest bit is 0."""


def texels(block, block_format):
    """The texels (16, channels) of one block."""
    return decoded(block[None, None], block_format).reshape(16, -1)


def eighths(block):
    """The texels of a block of BC7 as the whole numbers from 0 to 255 that they are."""
    values = texels(block, formats.BC7) * np.float32(255)
    assert (np.abs(values - np.rint(values)) < 1e-4).all()
    return np.rint(values).astype(int).tolist()


def mixed(first, second, index, bits):
    """An interpolated value by the nearest weight in 64ths."""
    weight = int(Fraction(64 * index, 2**bits - 1) + Fraction(1, 2))
    return (64 - weight) * first + weight * second + 32 >> 6


@pytest.mark.parametrize("ends", [(200, 13), (13, 200), (90, 90), (255, 0), (0, 255)])
def test_interpolates_one_channel_in_floats(ends):
    """BC4 and BC5 do not round to 8 bits; ends in rising order leave room for 0 and 1."""
    first, second = ends
    steps, fixed = (7, []) if first > second else (5, [0, 255])
    palette = [first, second, *(Fraction((steps - k) * first + k * second, steps) for k in range(1, steps)), *fixed]
    indices = [index % 8 for index in INDICES]
    expected = [np.float32(float(Fraction(palette[index]) / 255)) for index in indices]
    block = packed((first, 8), (second, 8), *((index, 3) for index in indices), size=8)
    np.testing.assert_allclose(texels(block, formats.BC4)[:, 0], expected, rtol=1.2e-7)

    other = packed((7, 8), (1, 8), size=8)
    both = texels(np.concatenate([other, block]), formats.BC5)
    np.testing.assert_allclose(both[:, 1], expected, rtol=1.2e-7)
    assert (both[:, 0] == np.float32(7 / 255)).all()


def test_one_subset_of_seven_bits_and_a_lowest_one():
    """Mode 6 of BC7: 7 bits and a P-bit of each end, 16 steps."""
    ends = [(3, 120), (127, 0), (64, 65), (10, 99)]
    block = packed(
        (1 << 6, 7),
        *((value, 7) for pair in ends for value in pair),
        *((1, 1), (0, 1)),
        (INDICES[0], 3),
        *((index, 4) for index in INDICES[1:]),
    )
    expected = [[mixed(2 * a + 1, 2 * b, index, 4) for a, b in ends] for index in INDICES]
    assert eighths(block) == expected


@pytest.mark.parametrize("rotation", range(4))
def test_exchanges_a_channel_with_alpha(rotation):
    """Mode 5 of BC7: 7 bits of colors, 8 of alpha, indices of 2 bits each for both."""
    colors, alpha = [(5, 100), (127, 3), (77, 11)], (250, 17)
    ones, twos = [index % 4 for index in INDICES], [index // 2 % 4 for index in INDICES]
    twos[0] = 1
    block = packed(
        *((1 << 5, 6), (rotation, 2)),
        *((value, 7) for pair in colors for value in pair),
        *((value, 8) for value in alpha),
        *((index, 2 if place else 1) for indices in (ones, twos) for place, index in enumerate(indices)),
    )
    wide = [[value << 1 | value >> 6 for value in pair] for pair in colors]
    expected = []
    for one, two in zip(ones, twos, strict=True):
        texel = [mixed(*pair, one, 2) for pair in wide] + [mixed(*alpha, two, 2)]
        if rotation:
            texel[3], texel[rotation - 1] = texel[rotation - 1], texel[3]
        expected.append(texel)
    assert eighths(block) == expected


@pytest.mark.parametrize("selector", [0, 1])
def test_colors_have_the_indices_that_the_selector_says(selector):
    """Mode 4 of BC7: 5 bits of colors, 6 of alpha, indices of 2 and of 3 bits."""
    colors, alpha = [(5, 30), (31, 3), (0, 11)], (60, 17)
    ones, twos = [index % 4 for index in INDICES], [index % 8 for index in INDICES]
    block = packed(
        *((1 << 4, 5), (0, 2), (selector, 1)),
        *((value, 5) for pair in colors for value in pair),
        *((value, 6) for value in alpha),
        *((index, 2 if place else 1) for place, index in enumerate(ones)),
        *((index, 3 if place else 2) for place, index in enumerate(twos)),
    )
    wide = [[value << 3 | value >> 2 for value in pair] for pair in colors]
    wide_alpha = [value << 2 | value >> 4 for value in alpha]
    color, other = ((twos, 3), (ones, 2)) if selector else ((ones, 2), (twos, 3))
    expected = [
        [mixed(*pair, color[0][k], color[1]) for pair in wide] + [mixed(*wide_alpha, other[0][k], other[1])]
        for k in range(16)
    ]
    assert eighths(block) == expected


def test_subsets_share_their_lowest_bit():
    """Mode 1 of BC7: 6 bits and a P-bit for each subset. Partition 13 has two rows each, its second anchor is texel 15."""
    ends = [(3, 60, 33, 8), (63, 0, 1, 2), (40, 41, 42, 43)]
    indices = [index % 8 for index in INDICES]
    indices[15] = 2
    block = packed(
        *((1 << 1, 2), (13, 6)),
        *((value, 6) for channel in ends for value in channel),
        *((1, 1), (0, 1)),
        *((index, 2 if place in (0, 15) else 3) for place, index in enumerate(indices)),
    )
    expected = []
    for place, index in enumerate(indices):
        subset, lowest = (0, 1) if place < 8 else (1, 0)
        wide = [[(value << 1 | lowest) << 1 | value >> 5 for value in channel] for channel in ends]
        expected.append([mixed(*channel[2 * subset :][:2], index, 3) for channel in wide] + [255])
    assert eighths(block) == expected


def test_three_subsets():
    """Mode 2 of BC7: 5 bits without a lowest one. Partition 11 has columns, and its anchors are texels 0, 6 and 15."""
    picture, anchors = "0012" * 4, (0, 6, 15)
    ends = [(3, 30, 17, 8, 1, 29), (31, 0, 1, 2, 15, 16), (4, 14, 24, 30, 20, 10)]
    indices = [0 if place in anchors else index % 4 for place, index in enumerate(INDICES)]
    block = packed(
        *((1 << 2, 3), (11, 6)),
        *((value, 5) for channel in ends for value in channel),
        *((index, 1 if place in anchors else 2) for place, index in enumerate(indices)),
    )
    wide = [[value << 3 | value >> 2 for value in channel] for channel in ends]
    expected = [
        [mixed(*channel[2 * int(picture[place]) :][:2], index, 2) for channel in wide] + [255]
        for place, index in enumerate(indices)
    ]
    assert eighths(block) == expected


def test_a_block_of_no_mode_is_empty():
    block = np.array([0] + [255] * 15, np.uint8)
    assert not texels(block, formats.BC7).any()
    for code in (19, 23, 27, 31):
        block[0] = code
        assert not texels(block, formats.BC6H).any()


def half(bits):
    return float(np.array(bits, np.uint16).view(np.float16))


def wide_half(value, bits):
    """16 bits of an end point without a sign."""
    if bits == 16 or value == 0:
        return value
    return 0xFFFF if value == (1 << bits) - 1 else (value << 16) + 0x8000 >> bits


def floats_of(ends, block, bits=10):
    """The colors of a block of BC6H in one region, as they are and as they should be."""
    wide = [[wide_half(value, bits) for value in pair] for pair in ends]
    expected = [[half(mixed(*pair, index, 4) * 31 >> 6) for pair in wide] for index in INDICES]
    return texels(block, formats.BC6H).tolist(), expected


def test_floats_in_one_region():
    """Mode 11 of BC6H: both ends have 10 bits. The highest value is the largest half, 65504."""
    ends = [(0, 1023), (512, 480), (1, 1022)]
    block = packed(
        (3, 5),
        *((pair[end], 10) for end in (0, 1) for pair in ends),
        (INDICES[0], 3),
        *((index, 4) for index in INDICES[1:]),
    )
    found, expected = floats_of(ends, block)
    assert found == expected
    assert found[2][0] == 65504


def test_floats_by_a_difference():
    """Mode 14 of BC6H: 16 bits, of which the higher ones come in reverse, and a difference of 4 bits."""
    firsts, steps = (0x7ABC, 0x0003, 0xFFFF), (7, -3, 1)  # the last one goes around, to 0
    backwards = [int(f"{first >> 10:06b}"[::-1], 2) for first in firsts]
    block = packed(
        (15, 5),
        *((first & 1023, 10) for first in firsts),
        *(field for step, high in zip(steps, backwards, strict=True) for field in ((step & 15, 4), (high, 6))),
        (INDICES[0], 3),
        *((index, 4) for index in INDICES[1:]),
    )
    ends = [(first, first + step & 0xFFFF) for first, step in zip(firsts, steps, strict=True)]
    found, expected = floats_of(ends, block, 16)
    assert found == expected


def test_floats_with_signs():
    """Mode 11 of BC6H with signs: 9 bits and a sign."""
    ends = [(-511, 511), (-1, 2), (-300, -200)]
    block = packed(
        (3, 5),
        *((pair[end] & 1023, 10) for end in (0, 1) for pair in ends),
        (INDICES[0], 3),
        *((index, 4) for index in INDICES[1:]),
    )
    wide = [(-0x7FFF, 0x7FFF), (-96, 160), (-19232, -12832)]  # 64 times the value, and 32 away from 0
    expected = []
    for index in INDICES:
        values = [mixed(*pair, index, 4) for pair in wide]
        expected.append([half((abs(v) * 31 >> 5) | (0x8000 if v < 0 else 0)) for v in values])
    assert texels(block, formats.BC6H_SIGNED).tolist() == expected

    lowest = packed((15, 5), (0, 30), *((0, 4), (1, 6)) * 3)  # mode 14: -32768 has no number below 0 to match
    assert (texels(lowest, formats.BC6H_SIGNED) == -np.inf).all()


@pytest.mark.parametrize("block_format", formats.FORMATS)
def test_blocks_come_in_rows(block_format):
    """Each block is decoded by itself: of many, as one by one. More blocks than are decoded at once."""
    blocks = random_blocks(block_format.name, 21)
    blocks = np.resize(blocks, (75, 120, block_format.size))
    together = decoded(blocks, block_format)
    assert together.shape == (300, 480, block_format.channels)
    assert together.dtype == np.float32
    for row, column in ((0, 0), (0, 119), (74, 0), (41, 77)):
        alone = decoded(blocks[row : row + 1, column : column + 1], block_format)
        np.testing.assert_array_equal(together[4 * row :, 4 * column :][:4, :4], alone)


def test_refuses_blocks_of_another_size():
    with pytest.raises(ValueError, match="Blocks of BC5 are an array of rows, columns and 16 bytes"):
        decoded(np.zeros((2, 2, 8), np.uint8), formats.BC5)


def test_each_bit_of_a_float_block_is_used_once():
    for mode in tables.BC6H_MODES:
        fields = tables.bc6h_fields(mode)
        bits = [bit for parts in fields.values() for part in parts for bit in range(part.at, part.at + part.width)]
        assert sorted(bits) == list(range(mode.code_bits, 128 - 16 * mode.index_bits + mode.regions))
        for name, parts in fields.items():
            widths = [5] if name == "p" else [mode.precision, *mode.others]
            width = widths[0] if name == "p" or name[1] == "0" else mode.others["rgb".index(name[0])]
            assert sorted(part.up + k for part in parts for k in range(part.width)) == list(range(width))
