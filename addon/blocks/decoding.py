# SPDX-License-Identifier: GPL-3.0-or-later
"""What GPUs read from blocks, by the Khronos Data Format Specification 1.3, in whole arrays."""

import numpy as np

from ..core import threads
from .formats import BC4, BC5, BC7, SIDE, BlockFormat
from .tables import (
    BC6H_MODES,
    BC7_MODES,
    PARTITIONS,
    WEIGHTS,
    Bc6hMode,
    Bc7Mode,
    bc6h_fields,
    index_places,
)

_TEXELS = SIDE * SIDE


def decoded(blocks: np.ndarray, block_format: BlockFormat) -> np.ndarray:
    """The texels of a map that is stored in blocks.

    A channel of BC4 and BC5 is the interpolated value itself, as (6 a + b) / 7 of two ends, where a decoder to 8 bits
    rounds. A block of BC7 of no mode is transparent black, one of BC6H black.

    Args:
        blocks: (R, C, bytes of a block) uint8, the top row first.

    Returns:
        (4 R, 4 C, channels of the format) float32, the top row first. Colors are as they are stored: sRGB stays sRGB.

    Raises:
        ValueError: The blocks have another size than those of the format.
    """
    if blocks.ndim != 3 or blocks.shape[2] != block_format.size or blocks.dtype != np.uint8:
        raise ValueError(f"Blocks of {block_format.label} are an array of rows, columns and {block_format.size} bytes")
    rows, columns = blocks.shape[:2]
    texels = np.empty((rows, SIDE, columns, SIDE, block_format.channels), np.float32)
    at_once = max(1, threads.ELEMENTS_AT_ONCE // _TEXELS // max(1, columns))

    def decode(first: int) -> None:
        part = np.ascontiguousarray(blocks[first : first + at_once])
        words = part.reshape(-1, block_format.size).view("<u8").astype(np.uint64, copy=False)
        values = _of_words(words, block_format)
        values = values.reshape(len(part), columns, SIDE, SIDE, -1)
        texels[first : first + at_once] = values.transpose(0, 2, 1, 3, 4)

    threads.map_parallel(decode, range(0, rows, at_once))
    return texels.reshape(rows * SIDE, columns * SIDE, block_format.channels)


def _of_words(words: np.ndarray, block_format: BlockFormat) -> np.ndarray:
    """The texels (N, 16, channels) float32 of blocks (N, 1 or 2) uint64."""
    if block_format is BC4 or block_format is BC5:
        return np.stack([_interpolated(word) for word in words.T], 2)
    if block_format is BC7:
        return _bc7(words) / np.float32(255)
    return _bc6h(words, block_format.is_signed).view(np.float16).astype(np.float32)


def _interpolated(word: np.ndarray) -> np.ndarray:
    """A channel of BC4 or BC5, (N, 16) float32 of (N,) uint64."""
    first, second = _bits(word, 0, 8), _bits(word, 8, 8)
    palette = np.empty((len(word), 8), np.float32)
    palette[:, 0], palette[:, 1] = first, second
    by_seven = np.stack([(7 - step) * first + step * second for step in range(1, 7)], 1) / 7
    by_five = np.stack([(5 - step) * first + step * second for step in range(1, 5)], 1) / 5
    palette[:, 2:] = by_seven
    few = first <= second
    palette[few, 2:6], palette[few, 6], palette[few, 7] = by_five[few], 0, 255
    indices = word[:, None] >> np.arange(16, 64, 3, dtype=np.uint64) & np.uint64(7)
    return np.take_along_axis(palette, indices.astype(np.intp), 1) / np.float32(255)


def _bits(word: np.ndarray, at: int, width: int) -> np.ndarray:
    """The bits of words (N,) uint64 from `at` on, as (N,) int32."""
    return (word >> np.uint64(at) & np.uint64((1 << width) - 1)).astype(np.int32)


def _field(words: np.ndarray, at: int, width: int) -> np.ndarray:
    """The bits of blocks (N, 2) uint64 from `at` on, as (N,) uint64."""
    if at >= 64:
        value = words[:, 1] >> np.uint64(at - 64)
    else:
        value = words[:, 0] >> np.uint64(at)
        if at and at + width > 64:
            value = value | words[:, 1] << np.uint64(64 - at)
    return value & np.uint64((1 << width) - 1)


def _indices(words: np.ndarray, at: int, subsets: int, bits: int, partition: np.ndarray) -> np.ndarray:
    """The index of each texel, (N, 16) intp, from those that begin at a bit of blocks (N, 2) uint64."""
    starts, masks = index_places(subsets, bits)
    together = _field(words, at, _TEXELS * bits - subsets)
    return (together[:, None] >> starts[partition] & masks[partition]).astype(np.intp)


class _Reader:
    """Takes the bits of blocks (N, 2) uint64 one after another."""

    def __init__(self, words: np.ndarray, at: int) -> None:
        self.words, self.at = words, at

    def take(self, width: int) -> np.ndarray:
        """The next bits, as (N,) int32; 0 without any."""
        value = _field(self.words, self.at, width).astype(np.int32)
        self.at += width
        return value


_BC7_MODE_OF = np.array([(byte & -byte).bit_length() - 1 if byte else -1 for byte in range(256)])
"""The mode of a block, by its first byte: the place of the lowest one."""


def _bc7(words: np.ndarray) -> np.ndarray:
    """The texels (N, 16, 4) uint8 of blocks (N, 2) uint64."""
    texels = np.zeros((len(words), _TEXELS), np.uint32)
    modes = _BC7_MODE_OF[(words[:, 0] & np.uint64(255)).astype(np.intp)]
    for mode in BC7_MODES:
        chosen = np.flatnonzero(modes == mode.number)
        if len(chosen):
            texels[chosen] = _bc7_of_mode(words[chosen], mode)
    return texels.astype("<u4", copy=False).view(np.uint8).reshape(-1, _TEXELS, 4)


def _bc7_of_mode(words: np.ndarray, mode: Bc7Mode) -> np.ndarray:
    """The texels (N, 16) uint32 of blocks of one mode, red in the lowest byte."""
    reader = _Reader(words, mode.number + 1)
    partition = reader.take(mode.partition_bits)
    rotation = reader.take(mode.rotation_bits)
    selector = reader.take(mode.selector_bits)
    ends = _bc7_ends(reader, mode)
    indices = _indices(words, reader.at, mode.subsets, mode.index_bits, partition)
    subset = PARTITIONS[mode.subsets][partition]
    if not mode.second_index_bits:
        return _chosen(_bc7_palette(ends, mode.index_bits), subset, indices)
    reader.at += _TEXELS * mode.index_bits - 1
    seconds = _indices(words, reader.at, 1, mode.second_index_bits, partition)
    texels = _apart(ends, indices, seconds, mode.index_bits, mode.second_index_bits)
    if mode.selector_bits:
        other = _apart(ends, seconds, indices, mode.second_index_bits, mode.index_bits)
        texels = np.where((selector == 1)[:, None], other, texels)
    return _rotated(texels, rotation)


def _bc7_ends(reader: _Reader, mode: Bc7Mode) -> np.ndarray:
    """The end points (N, subsets, 2, 4) uint16, from 0 to 255."""
    ends = np.zeros((len(reader.words), mode.subsets * 2, 4), np.int32)
    for channel, bits in enumerate([mode.color_bits] * 3 + [mode.alpha_bits]):
        for end in range(mode.subsets * 2):
            ends[:, end, channel] = reader.take(bits)
    lowest = mode.own_lowest or mode.shared_lowest
    if lowest:
        count = mode.subsets * (2 if mode.own_lowest else 1)
        last = np.stack([reader.take(1) for _ in range(count)], 1)
        ends = ends << 1 | np.repeat(last, mode.subsets * 2 // count, 1)[:, :, None]
    widths = np.array([mode.color_bits] * 3 + [mode.alpha_bits or 8 - lowest]) + lowest
    ends = ends << 8 - widths
    ends |= ends >> widths
    if not mode.alpha_bits:
        ends[:, :, 3] = 255
    return ends.reshape(-1, mode.subsets, 2, 4).astype(np.uint16)


def _bc7_palette(ends: np.ndarray, bits: int) -> np.ndarray:
    """What indices of so many bits choose from, (N, subsets, 2 ** bits) uint32, red in the lowest byte."""
    weights = WEIGHTS[bits].astype(np.uint16)[:, None]
    palette = (64 - weights) * ends[:, :, :1] + weights * ends[:, :, 1:] + np.uint16(32) >> 6
    return palette.astype(np.uint8).view("<u4")[..., 0]


def _apart(ends: np.ndarray, colors: np.ndarray, alphas: np.ndarray, color_bits: int, alpha_bits: int) -> np.ndarray:
    """The texels (N, 16) uint32 of blocks whose colors and alphas have indices (N, 16) of their own."""
    color = np.take_along_axis(_bc7_palette(ends, color_bits)[:, 0], colors, 1) & np.uint32(0xFFFFFF)
    return color | np.take_along_axis(_bc7_palette(ends, alpha_bits)[:, 0], alphas, 1) & np.uint32(0xFF000000)


def _rotated(texels: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Texels (N, 16) uint32 with alpha and the channel `rotation` - 1 (N,) exchanged; 0 leaves them."""
    shift = np.where(rotation == 0, 24, (rotation - 1) * 8).astype(np.uint32)[:, None]
    difference = (texels >> np.uint32(24)) ^ (texels >> shift & np.uint32(255))
    return texels ^ difference << np.uint32(24) ^ np.where(rotation[:, None] == 0, np.uint32(0), difference << shift)


def _chosen(palette: np.ndarray, subset: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """What each texel (N, 16) takes of a palette (N, subsets, entries)."""
    entries = palette.shape[2]
    return np.take_along_axis(palette.reshape(len(palette), -1), subset * np.intp(entries) + indices, 1)


def _bc6h(words: np.ndarray, is_signed: bool) -> np.ndarray:
    """The halfs (N, 16, 3) uint16 of blocks (N, 2) uint64."""
    texels = np.zeros((len(words), _TEXELS), "<u8")
    codes = words[:, 0] & np.uint64(31)
    codes = np.where(codes & np.uint64(3) < 2, codes & np.uint64(3), codes)
    for mode in BC6H_MODES:
        chosen = np.flatnonzero(codes == mode.code)
        if len(chosen):
            texels[chosen] = _bc6h_of_mode(words[chosen], mode, is_signed)
    return np.ascontiguousarray(texels.view("<u2").reshape(-1, _TEXELS, 4)[..., :3].astype(np.uint16, copy=False))


def _bc6h_of_mode(words: np.ndarray, mode: Bc6hMode, is_signed: bool) -> np.ndarray:
    """The texels (N, 16) uint64 of blocks of one mode: halfs, red in the lowest 16 bits."""
    values = {name: np.zeros(len(words), np.int32) for name in ("p", *bc6h_fields(mode))}
    for name, parts in bc6h_fields(mode).items():
        for bits in parts:
            values[name] |= _field(words, bits.at, bits.width).astype(np.int32) << bits.up
    ends = np.stack([np.stack([values[f"{c}{end}"] for c in "rgb"], 1) for end in range(2 * mode.regions)], 1)
    if mode.is_relative:
        ends[:, 1:] = ends[:, :1] + _with_sign(ends[:, 1:], np.array(mode.others)) & (1 << mode.precision) - 1
    if is_signed:
        ends = _with_sign(ends, np.array(mode.precision))
    ends = _unquantized(ends, mode.precision, is_signed).reshape(-1, mode.regions, 2, 3)
    weights = WEIGHTS[mode.index_bits].astype(np.int32)[:, None]
    palette = (64 - weights) * ends[:, :, :1] + weights * ends[:, :, 1:] + 32 >> 6
    halfs = np.zeros((*palette.shape[:3], 4), "<u2")
    halfs[..., :3] = _half(palette, is_signed)
    partition = values["p"]
    at = 128 - _TEXELS * mode.index_bits + mode.regions
    indices = _indices(words, at, mode.regions, mode.index_bits, partition)
    return _chosen(halfs.view("<u8")[..., 0], PARTITIONS[mode.regions][partition], indices)


def _with_sign(values: np.ndarray, bits: np.ndarray) -> np.ndarray:
    """Values of so many bits, the highest of which is their sign."""
    return (values << 32 - bits).astype(np.int32) >> 32 - bits


def _unquantized(values: np.ndarray, precision: int, is_signed: bool) -> np.ndarray:
    """End points of a precision as 16 bits, or as 15 and a sign."""
    if not is_signed:
        if precision >= 15:
            return values
        wide = (values << 16) + 0x8000 >> precision
        return np.where(values == 0, 0, np.where(values == (1 << precision) - 1, 0xFFFF, wide))
    if precision >= 16:
        return values
    size = np.abs(values)
    wide = (size << 15) + 0x4000 >> precision - 1
    wide = np.where(size == 0, 0, np.where(size >= (1 << precision - 1) - 1, 0x7FFF, wide))
    return np.where(values < 0, -wide, wide)


def _half(values: np.ndarray, is_signed: bool) -> np.ndarray:
    """The bits of the half that an interpolated value stands for."""
    if not is_signed:
        return values * 31 >> 6
    size = np.abs(values) * 31 >> 5
    return np.where(values < 0, size | 0x8000, size)
