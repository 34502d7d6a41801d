# SPDX-License-Identifier: GPL-3.0-or-later
"""An encoder of BC6H in numpy, from the Khronos Data Format Specification and from what the encoder on the GPU promises.

All is counted in 64-bit integers. Blocks are decoded by what tests/pure and other programs have checked.
"""

import numpy as np

from addon.blocks import tables

ONE_REGION = (15, 11, 7, 3)
TWO_REGIONS = (2, 6, 10, 0, 14, 18, 22, 26, 1, 30)
"""The codes of the modes, the finest first."""
BY_CODE = {mode.code: mode for mode in tables.BC6H_MODES}
LARGEST = 31743
"""The steps of a half up to 65504."""
FARTHEST = 4095
NEVER = 2**62
ROUNDS = 5


def half_steps(texels, is_signed):
    """Floats as whole numbers: the bits of the nearest half, with its sign. What is no number is 0."""
    known = np.where(np.isnan(texels), 0, texels)
    halfs = np.clip(known, -65504 if is_signed else 0, 65504).astype(np.float16)
    bits = halfs.view(np.uint16).astype(np.int64)
    return np.where(bits & 0x8000, -(bits & 0x7FFF), bits & 0x7FFF)


def counts(weights):
    """The weights (B, 16) float32 in quarters. Where none of a block counts, all do."""
    sixteenths = np.floor(np.minimum(weights, np.float32(1.0)) * np.float32(16.0) + np.float32(0.5)).astype(np.int64)
    quarters = (np.where(weights > 0, np.maximum(sixteenths, 1), 0) + 3) // 4
    return np.where(quarters.any(1, keepdims=True), quarters, 4)


def quantized(steps, precision, is_signed):
    """End points of so many bits that are nearest to steps of halfs."""
    size = np.abs(steps)
    wide = (size * 32 + 30) // 31 if is_signed else (size * 64 + 30) // 31
    return np.sign(steps) * (wide >> 16 - precision)


def unquantized(ends, precision, is_signed):
    if precision == 16:
        return ends
    bits, most = (precision - 1, 0x7FFF) if is_signed else (precision, 0xFFFF)
    size = np.abs(ends)
    wide = (2 * size + 1) * 2 ** (15 - precision)
    return np.sign(ends) * np.where(size == 2**bits - 1, most, wide)


def finished(wide, is_signed):
    return np.sign(wide) * (np.abs(wide) * 31 >> (5 if is_signed else 6))


def linear(steps, highest, is_signed):
    """Values of halfs as whole numbers: of the highest exponent (B, 1, 1) of a block, 1024 to 2047, twice without signs."""
    size = np.abs(steps)
    exponent = np.maximum(size >> 10, 1)
    mantissa = ((size & 1023) + np.where(size >= 1024, 1024, 0)) << (0 if is_signed else 1)
    down = highest - exponent
    return np.sign(steps) * np.where(down < 0, mantissa << np.clip(-down, 0, 4), mantissa >> np.clip(down, 0, 15))


def palette(first, second, bits):
    """What indices of so many bits choose from, (B, 2 ** bits, 3), between end points (B, 3)."""
    last = 2**bits - 1
    weight = np.floor(np.arange(last + 1) * 64 / last + 0.5).astype(np.int64)[:, None]
    return (64 - weight) * first[:, None] + weight * second[:, None] + 32 >> 6


def extremes(steps, counted):
    return (
        np.where(counted[:, :, None], steps, LARGEST).min(1),
        np.where(counted[:, :, None], steps, -LARGEST).max(1),
    )


class _Blocks:
    """Blocks that are encoded: steps (B, 16, 3), counts (B, 16), and what is the same for all candidates."""

    def __init__(self, texels, weights, is_signed, is_linear):
        self.is_signed, self.is_linear = is_signed, is_linear
        self.steps, self.count = half_steps(texels, is_signed), counts(weights)
        self.low, self.high = extremes(self.steps, self.count > 0)
        self.highest = np.maximum(np.maximum(np.abs(self.low), np.abs(self.high)).max(1) >> 10, 1)[:, None, None]
        self.narrow = np.zeros(len(self.steps), np.int64)
        while (is_wide := (self.high - self.low).max(1) >> self.narrow > 1023).any():
            self.narrow += is_wide
        self.shift = 0 * self.narrow if is_linear else self.narrow
        self.aim = self.measured(self.steps)

    def measured(self, steps):
        return linear(steps, self.highest, self.is_signed) if self.is_linear else steps

    def errors(self, colors):
        """(B, 16, entries) of a palette (B, entries, 3) in steps of halfs."""
        off = np.abs(self.aim[:, :, None] - self.measured(colors)[:, None]) >> self.shift[:, None, None, None]
        return (np.minimum(off, FARTHEST) ** 2).sum(3)

    def colors(self, first, second, precision, bits):
        """The palette (B, entries, 3) between end points (B, 3) of precisions (B,)."""
        wide = []
        for end in (first, second):
            wide.append(np.empty_like(end))
            for each in np.unique(precision):
                wide[-1][precision == each] = unquantized(end[precision == each], each, self.is_signed)
        return finished(palette(*wide, bits), self.is_signed)

    def box(self, codes):
        """The finest mode of each block, its bits (B,), and the least and the most (B, 3) that its ends may be."""
        most_bits = 0 if self.is_signed else 1
        place = np.full(len(self.steps), -1)
        precision = np.zeros(len(self.steps), np.int64)
        least, most = np.zeros((2, len(self.steps), 3), np.int64)
        for number, code in enumerate(codes):
            mode = BY_CODE[code]
            largest = 2 ** (mode.precision - 1 + most_bits) - 1
            low, high = (quantized(each, mode.precision, self.is_signed) for each in (self.low, self.high))
            room = 2 ** (np.array(mode.others) - 1) - 1 - (high - low)
            if not mode.is_relative:
                room = np.full_like(low, 2 * largest)
            fits = (place < 0) & (room >= 0).all(1)
            place[fits], precision[fits] = number, mode.precision
            least[fits] = np.maximum(low - room // 2, -largest if self.is_signed else 0)[fits]
            most[fits] = np.minimum(high + room - room // 2, largest)[fits]
        assert (place >= 0).all()
        return np.array(codes)[place], precision, least, most

    def search(self, count, box, bits):
        """The costs (B,) and the best end points (B, 3) twice for the texels that count."""
        _, precision, least_end, most_end = box
        low, high = extremes(self.steps, count > 0)
        is_empty = (count == 0).all(1)[:, None]
        ends = []
        for own, whole in ((low, self.low), (high, self.high)):
            steps = np.where(is_empty, whole, own)
            ends.append(np.empty_like(steps))
            for each in np.unique(precision):
                ends[-1][precision == each] = quantized(steps[precision == each], each, self.is_signed)
        low, high = ends
        least, best = np.full(len(low), NEVER), np.stack([low, high])

        def offer(least, best, ends):
            allowed = ((ends >= least_end) & (ends <= most_end)).all((0, 2))
            cost = (self.errors(self.colors(*ends, precision, bits)).min(2) * count).sum(1)
            better = allowed & (cost < least)
            return np.where(better, cost, least), np.where(better[:, None], ends, best)

        for diagonal in range(4):
            is_turned = np.array([False, bool(diagonal & 1), bool(diagonal & 2)])
            least, best = offer(least, best, np.stack([np.where(is_turned, high, low), np.where(is_turned, low, high)]))
        for turn in range(ROUNDS):
            for move in range(12):
                channel, end, direction = move % 3, move // 3 % 2, 1 - move // 6 * 2
                ends = best.copy()
                ends[end, :, channel] += direction * np.maximum(1, (high - low)[:, channel] >> 3 + turn)
                least, best = offer(least, best, ends)
        return least, *best

    def split(self):
        """The partition (B,) whose regions are nearest to diagonals of their extremes."""
        least, found = np.full(len(self.steps), NEVER), np.zeros(len(self.steps), np.int64)
        for number, second in enumerate(tables.PARTITIONS[2][:32]):
            cost = 0
            for region in (0, 1):
                count = self.count * (second == region)
                low, high = extremes(self.steps, count > 0)
                low, high = np.where(low > high, 0, low), np.where(low > high, 0, high)
                off = self.steps - (low + high >> 1)[:, None] >> self.narrow[:, None, None]
                widest = (high - low).argmax(1)
                along = np.take_along_axis(off, widest[:, None, None], 2)
                is_turned = (off * along * count[:, :, None]).sum(1) < 0
                colors = palette(np.where(is_turned, high, low), np.where(is_turned, low, high), 3)
                cost = cost + (self.errors(colors).min(2) * count).sum(1)
            better = cost < least
            least, found = np.where(better, cost, least), np.where(better, number, found)
        return found


def encoded(texels, weights, is_signed, is_linear):
    """Blocks (B, 16) uint8 of texels (B, 16, 3)."""
    work = _Blocks(texels, weights, is_signed, is_linear)
    one = work.box(ONE_REGION)
    cost, *ends = work.search(work.count, one, 4)
    indices = work.errors(work.colors(*ends, one[1], 4)).argmin(2)
    two = work.box(TWO_REGIONS)
    partition = work.split()
    regions = tables.PARTITIONS[2][partition]
    parts = [work.search(work.count * (regions == region), two, 3) for region in (0, 1)]
    both = [work.errors(work.colors(*part[1:], two[1], 3)).argmin(2) for part in parts]
    both = np.where(regions == 1, both[1], both[0])
    is_split = parts[0][0] + parts[1][0] < cost
    blocks = np.empty((len(cost), 16), np.uint8)
    for code in np.unique(np.where(is_split, two[0], one[0])):
        split = BY_CODE[code].regions == 2
        chosen = np.flatnonzero((is_split == split) & ((two if split else one)[0] == code))
        four = [*parts[0][1:], *parts[1][1:]] if split else ends
        blocks[chosen] = _packed(
            BY_CODE[code],
            [end[chosen] for end in four],
            (both if split else indices)[chosen],
            (partition if split else 0 * partition)[chosen],
        )
    return blocks


def _packed(mode, ends, indices, partition):
    """Blocks (B, 16) uint8. An anchor lacks its highest bit: where that is not 0, the ends of its region change places."""
    last = 2**mode.index_bits - 1
    regions, anchors = tables.PARTITIONS[mode.regions][partition], tables.ANCHORS[mode.regions][partition]
    for region in range(mode.regions):
        is_turned = np.take_along_axis(indices, anchors[:, region : region + 1], 1) > last // 2
        first, second = ends[2 * region : 2 * region + 2]
        ends[2 * region : 2 * region + 2] = np.where(is_turned, second, first), np.where(is_turned, first, second)
        indices = np.where(is_turned & (regions == region), last - indices, indices)
    values = {"p": partition}
    for place, end in enumerate(ends):
        stored = end - ends[0] if mode.is_relative and place else end
        values.update({f"{name}{place}": stored[:, channel] for channel, name in enumerate("rgb")})
    bits = np.zeros((len(partition), 128), np.uint8)
    for bit in range(mode.code_bits):
        bits[:, bit] = mode.code >> bit & 1
    for name, parts in tables.bc6h_fields(mode).items():
        for part in parts:
            for bit in range(part.width):
                bits[:, part.at + bit] = values[name] >> part.up + bit & 1
    widths = np.full(indices.shape, mode.index_bits)
    np.put_along_axis(widths, anchors, mode.index_bits - 1, 1)
    at = 128 - widths.sum(1)
    for texel in range(16):
        for bit in range(mode.index_bits):
            some = np.flatnonzero(bit < widths[:, texel])
            bits[some, at[some] + bit] = indices[some, texel] >> bit & 1
        at = at + widths[:, texel]
    return np.packbits(bits, axis=1, bitorder="little")
