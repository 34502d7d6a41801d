# SPDX-License-Identifier: GPL-3.0-or-later
"""BC7 encoded in numpy, as shaders/blocks/bc7_*_comp.glsl do it, with 64 bits: a number that needs more than the 32 bits there
shows as another block."""

import numpy as np

from addon.blocks import tables
from addon.blocks.formats import Purpose

ONE = 1020
SQUARES = 4
EACH, SHARED = 1, 2
NONE = 2**62
HEAVIEST = 15


def encoded(texels, purpose, has_alpha, plan, weights=None):
    """The blocks (R, C, 16) uint8 of texels (H, W, 4) float32. plan: steps as addon.passes.bc7_encoding.Step."""
    rows, columns = np.array(texels.shape[:2]) // 4
    colors = _fixed(_in_blocks(texels))
    counted = np.ones(colors.shape[:2], np.float32) if weights is None else _in_blocks(weights[..., None])[..., 0]
    least = np.full(len(colors), NONE)
    enough = _counts(counted).sum(1) * (16 if purpose == Purpose.COLOR else 3)
    best = np.zeros((len(colors), 16), np.uint8)
    for step in plan:
        cost, found = _Mode(colors, _counts(counted), purpose, has_alpha, step).encoded()
        is_better = (cost < least) & (least > enough)
        best[is_better], least[is_better] = found[is_better], cost[is_better]
    return best.reshape(rows, columns, 16)


def _in_blocks(texels):
    """(B, 16, channels) of (H, W, channels)."""
    height, width, channels = texels.shape
    split = texels.reshape(height // 4, 4, width // 4, 4, channels)
    return np.ascontiguousarray(split.swapaxes(1, 2)).reshape(-1, 16, channels)


def _fixed(values):
    scaled = np.clip(values, np.float32(0.0), np.float32(1.0)) * np.float32(2040.0)
    return (scaled.astype(np.int64) + 1) >> 1


def _counts(counted):
    count = ((np.minimum(counted, np.float32(1.0)) * np.float32(30.0)).astype(np.int64) + 1) >> 1
    count = np.where(counted > 0.0, np.maximum(count, 1), 0)
    count[~count.any(1)] = HEAVIEST
    return count


def _slopes(colors, is_curved):
    slope = 13 + ((colors * 1397) >> 10) + ((((colors * 938) >> 10) * colors) >> 10)
    slope = np.where(is_curved, np.maximum(slope, 79), 1024)
    return slope * slope >> 8


def _linear(colors):
    return colors * (208 + ((colors * (11184 + ((colors * 5008) >> 10))) >> 10))


def _seen(colors, is_curved):
    return np.where(is_curved, _linear(colors), colors << 14)


def _length(numbers):
    return np.frexp(numbers.astype(float))[1].astype(np.int64)


def _shifted(values, left):
    return np.where(left > 0, values << np.maximum(left, 0), values >> np.maximum(-left, 0))


def _quotient(dividend, divisor):
    whole = (np.abs(dividend) + (divisor >> 1)) // divisor
    return np.where(dividend < 0, -whole, whole)


def _times(matrix, vector):
    return (matrix @ vector[..., None])[..., 0]


def _diagonal(matrix):
    return np.diagonal(matrix, axis1=-2, axis2=-1)


def _direction(matrix, bits):
    """The principal direction (..., 4) of symmetric matrices (..., 4, 4)."""
    first = np.argmax(_diagonal(matrix), axis=-1)
    direction = np.take_along_axis(matrix, first[..., None, None], axis=-1)[..., 0]
    for turn in range(5):
        direction = _shifted(direction, bits - _length(np.abs(direction).max(-1))[..., None])
        if turn < 4:
            direction = _times(matrix, direction)
    return direction


# Partitions


def ranked(colors, counts, purpose, subsets, *, has_alpha, number):
    """The four partitions (B, 4) that suit blocks best, of the first `number`."""
    seen = colors.copy()
    if purpose == Purpose.COLOR:
        seen[..., :3] = _linear(seen[..., :3]) >> 14
    if not has_alpha:
        seen[..., 3] = 0
    weight = counts.sum(1)
    middle = ((seen * counts[..., None]).sum(1) + (weight >> 1)[:, None]) // np.maximum(weight, 1)[:, None]
    off = seen - middle[:, None]
    of_all = _moments(off, counts)
    shift = np.maximum(_length(_diagonal(of_all[2]).max(-1)) - 14, 0)
    costs = []
    for subset_of in tables.PARTITIONS[subsets][:number]:
        parts = [_moments(off, counts * (subset_of == subset)) for subset in range(subsets)]
        costs.append(sum(_off_line(_scatter(*part), shift) for part in parts))
    return np.argsort(np.stack(costs, 1), axis=1, kind="stable")[:, :4]


def _moments(off, counts):
    weighted = off * counts[..., None]
    return counts.sum(1), weighted.sum(1), np.einsum("bic,bid->bcd", weighted, off)


def _scatter(weight, total, products):
    mean = _quotient(total, np.maximum(weight, 1)[:, None])
    rest = weight[:, None] * mean - total
    return products + mean[:, :, None] * rest[:, None, :] - total[:, :, None] * mean[:, None, :]


def _off_line(scatter, shift):
    scatter = scatter >> shift[:, None, None]
    direction = _direction(scatter, 8)
    squared = (direction * direction).sum(-1) >> 6
    along = _cut((direction * (_times(scatter, direction) >> 6)).sum(-1), np.maximum(squared, 1))
    return np.maximum(_diagonal(scatter).sum(-1) - along, 0) * 16 + along


def _cut(dividend, divisor):
    """A quotient cut toward 0."""
    return np.sign(dividend) * (np.abs(dividend) // divisor)


# Modes


class _Mode:
    """Blocks (B, 16, 4) in one mode. counts (B, 16): of the texels."""

    def __init__(self, colors, counts, purpose, has_alpha, step):
        self.step, self.mode, self.has_alpha = step, tables.BC7_MODES[step.mode], has_alpha
        mode = self.mode
        self.kind = EACH * (mode.own_lowest > 0) + SHARED * (mode.shared_lowest > 0)
        self.last = int(self.kind > 0)
        self.index_bits, self.second_bits = mode.index_bits, mode.second_index_bits
        if step.is_turned:
            self.index_bits, self.second_bits = self.second_bits, self.index_bits
        self.alpha_bits = mode.alpha_bits and mode.alpha_bits + self.last
        self.bits = np.array([mode.color_bits + self.last] * 3 + [max(self.alpha_bits, 4)])
        self.partition = np.zeros(len(colors), int)
        if mode.subsets > 1:
            number = 1 << mode.partition_bits
            order = ranked(colors, counts, purpose, mode.subsets, has_alpha=has_alpha, number=number)
            self.partition = order[:, step.rank]
        self.subset_of = tables.PARTITIONS[mode.subsets][self.partition].astype(int)
        self.anchors = tables.ANCHORS[mode.subsets][self.partition]

        self.colors = colors.copy()
        if not has_alpha:
            self.colors[..., 3] = ONE
        self.is_opaque = (self.colors[..., 3] == ONE).all(1)
        self.is_curved = np.array([purpose == Purpose.COLOR] * 3 + [False])
        full = 3
        if step.rotation:
            full = step.rotation - 1
            order = np.arange(4)
            order[[full, 3]] = 3, full
            self.colors, self.is_curved = self.colors[..., order], self.is_curved[order]
        self.weights = counts
        self.counts = _slopes(self.colors, self.is_curved) * counts[..., None]
        self.shift = np.maximum(_length(np.maximum(self.counts.max((1, 2)), 1)) - 6, 0)[:, None, None]
        self.counts = np.maximum(self.counts >> self.shift, np.minimum(self.counts, 1))
        self.counts[self.is_opaque, :, full] = 0
        counted = self.colors.copy()
        counted[self.is_opaque, :, full] = 0
        self.seen_shift = np.full((len(colors), 1, 1), 14)
        if purpose == Purpose.COLOR:
            most = np.maximum(_seen(counted, self.is_curved).max((1, 2)), 1)
            self.seen_shift = np.maximum(_length(most) - 10, 0)[:, None, None]
        self.seen = self._seen(self.colors)
        self.is_full = np.zeros((len(colors), 4), int)
        self.is_full[self.is_opaque | (self.alpha_bits == 0), full] = 1

    def _seen(self, colors):
        return np.minimum(_seen(colors, self.is_curved) >> self.seen_shift, 2047)

    def encoded(self):
        """The costs (B,) and the blocks (B, 16) uint8."""
        is_separate = self.second_bits > 0
        cost = np.zeros(len(self.colors), np.int64)
        ends, indices = [], []
        for part in range(2 if is_separate else self.mode.subsets):
            is_in = np.ones_like(self.subset_of) if is_separate else (self.subset_of == part).astype(int)
            channels = np.array(([1, 1, 1, 0], [0, 0, 0, 1])[part]) if is_separate else np.ones(4, int)
            bits = self.second_bits if is_separate and part else self.index_bits
            sweep = (np.repeat([3], 4), np.arange(4)) if is_separate and part else None
            if sweep is None:
                used = 4 if not is_separate and self.alpha_bits and self.has_alpha else 3
                sweep = np.repeat(np.arange(used), 4), np.tile(np.arange(4), used)
            part_cost, low, high, found = self._part(is_in, channels, bits, sweep)
            anchor = np.zeros(len(cost), int) if is_separate else self.anchors[:, part]
            most = (1 << bits) - 1
            is_swapped = 2 * np.take_along_axis(found, anchor[:, None], 1)[:, 0] > most
            low[is_swapped], high[is_swapped] = high[is_swapped], low[is_swapped]
            found[is_swapped] = ((most - found) * is_in)[is_swapped]
            cost += part_cost
            ends.append((low, high))
            indices.append(found)
        if self.step.mode == 7:
            cost[self.is_opaque] = NONE
        return cost, self._packed(ends, indices)

    def _level(self, colors, last):
        scaled = colors * ((1 << self.bits) - 1) * 257
        if np.ndim(last) == 0:
            return (scaled + 131072) >> 18
        last = last[:, None]
        half = (scaled + (1 - last) * 262144) >> 19
        return np.clip(half, 0, (1 << (self.bits - 1)) - 1) * 2 + last

    def _whole(self, levels):
        return (levels << (8 - self.bits)) | (levels >> (2 * self.bits - 8))

    def _off(self, colors, last, counts):
        off = colors - 4 * self._whole(self._level(colors, last))
        return (np.minimum(off * off, 65535) * counts).sum(-1)

    def _ends(self, low, high, counts, number):
        """What the endpoints end with, for a proposal: -1 for anything."""
        if not self.kind:
            return -1, -1
        zeros = np.zeros(len(low), int)
        if number >= 0:
            end_low = zeros + (number & 1)
            end_high = end_low if self.kind == SHARED else zeros + (number >> 1)
        else:
            low_0, low_1, high_0, high_1 = (
                self._off(color, zeros + last, counts) for color in (low, high) for last in (0, 1)
            )
            end_low, end_high = (low_1 < low_0).astype(int), (high_1 < high_0).astype(int)
            if self.kind == SHARED:
                end_low = end_high = (low_1 + high_1 < low_0 + high_0).astype(int)
        if self.kind == EACH and self.alpha_bits:
            end_low, end_high = np.where(self.is_opaque, 1, end_low), np.where(self.is_opaque, 1, end_high)
        return end_low, end_high

    def _axis(self, is_in, channels):
        """The endpoints (B, 4) on the principal axis."""
        weight = (self.counts * channels * is_in[..., None]).sum(-1)
        total = np.maximum(weight.sum(1), 1)[:, None]
        middle = ((self.colors * weight[..., None]).sum(1) + (total >> 1)) // total
        off = (self.colors - middle[:, None]) * channels
        scatter = np.einsum("bi,bic,bid->bcd", (weight + 3) >> 2, off, off)
        scatter = scatter >> np.maximum(_length(_diagonal(scatter).max(-1)) - 14, 0)[:, None, None]
        axis = _direction(scatter, 9)
        along = np.where(weight > 0, (off * axis[:, None]).sum(-1), 0)
        squared = np.maximum((axis * axis).sum(-1) >> 2, 1)[:, None]
        ends = np.minimum(along.min(1), 0), np.maximum(along.max(1), 0)
        return [np.clip(middle + _quotient(axis * (end >> 2)[:, None], squared), 0, ONE) for end in ends]

    def _part(self, is_in, channels, index_bits, sweep):
        counts = self.counts * channels * is_in[..., None]
        weights = tables.WEIGHTS[index_bits]
        most, per_sweep = (1 << self.bits) - 1, len(sweep[0])
        wanted = self._axis(is_in, channels)
        kept, best = [np.zeros_like(end) for end in wanted], [np.zeros_like(end) for end in wanted]
        best_indices, least = np.zeros(is_in.shape, int), np.full(len(is_in), NONE)
        ends = {0: 0, EACH: 4, SHARED: 2}[self.kind]
        for attempt in range(SQUARES + ends + self.step.sweeps * per_sweep):
            if attempt < SQUARES + ends:
                start = wanted if attempt < SQUARES else kept
                last = self._ends(*start, counts.sum(1), attempt - SQUARES)
                levels = [self._level(color, end) for color, end in zip(start, last, strict=True)]
            else:
                number = (attempt - SQUARES - ends) % per_sweep
                channel, way = sweep[0][number], sweep[1][number]
                levels = [end.copy() for end in best]
                moved = levels[way >> 1]
                end = best[way >> 1][:, channel] & self.last
                change = (1 - 2 * (way & 1)) * (1 + self.last)
                moved[:, channel] = np.clip(moved[:, channel] + change, end, most[channel] - self.last + end)
            levels = [np.where(self.is_full, most, level) for level in levels]
            low, high = (self._whole(level) for level in levels)
            if not self.alpha_bits:
                low[:, 3] = high[:, 3] = 255
            palette = self._between(low[:, None], high[:, None], weights[:, None])
            off = (self._seen(palette)[:, None] - self.seen[:, :, None]) * channels
            costs = (off * off).sum(-1)
            indices = costs.argmin(-1) * is_in
            cost = (costs.min(-1) * self.weights * is_in).sum(-1)
            is_better = cost < least
            least, best_indices[is_better] = np.minimum(cost, least), indices[is_better]
            for end in range(2):
                best[end][is_better] = levels[end][is_better]
                if attempt < SQUARES:
                    kept[end][is_better] = wanted[end][is_better]
            if attempt < SQUARES:
                wanted = self._solved(is_in, channels, weights[indices][..., None], (low, high))
        return least, *best, best_indices

    @staticmethod
    def _between(low, high, weights):
        return ((64 - weights) * low + weights * high + 32) >> 6 << 2

    def _solved(self, is_in, channels, w, ends):
        """Endpoints by least squares. w (B, 16, 1): of the high one."""
        low, high = ends
        shown = self._between(low[:, None], high[:, None], w)
        off, weights = self.colors - shown, (self.weights * is_in)[..., None]
        counts = _slopes((self.colors + shown) >> 1, self.is_curved) * weights >> self.shift
        counts = np.clip(counts, np.minimum(weights, 1), 1023) * channels * (1 - self.is_full[:, None])
        matrix = [(counts * each).sum(1) for each in ((64 - w) * (64 - w), (64 - w) * w, w * w)]
        right = [(counts * each * off).sum(1) for each in (64 - w, w)]
        less = np.maximum(_length(np.maximum(matrix[0], matrix[2]).max(1)) - 11, 0)[:, None]
        rest_less = np.maximum(_length(np.abs(right).max((0, 2))) - 19, 0)[:, None]
        low_low, low_high, high_high = (each >> less for each in matrix)
        to_low, to_high = (each >> rest_less for each in right)
        up = 6 + rest_less - less
        divisor = (low_low * high_high - low_high * low_high) >> np.maximum(up, 0)
        is_solved, divisor = divisor > 0, np.maximum(divisor, 1)
        for_low = (high_high * to_low - low_high * to_high) >> np.maximum(-up, 0)
        for_high = (low_low * to_high - low_high * to_low) >> np.maximum(-up, 0)
        return [
            np.clip(4 * whole + is_solved * _quotient(dividend, divisor), 0, ONE)
            for whole, dividend in ((low, for_low), (high, for_high))
        ]

    def _packed(self, ends, indices):
        mode, fields = self.mode, []
        count = len(self.colors)

        def put(values, bits):
            fields.append(np.broadcast_to(np.asarray(values)[..., None] >> np.arange(bits) & 1, (count, bits)))

        put(1 << mode.number, mode.number + 1)
        put(self.partition, mode.partition_bits)
        put(self.step.rotation, mode.rotation_bits)
        put(int(self.step.is_turned), mode.selector_bits)
        for channel in range(4 if self.alpha_bits else 3):
            for part in range(mode.subsets):
                for end in ends[part + (mode.second_index_bits > 0 and channel == 3)]:
                    put(end[:, channel] >> self.last, self.bits[channel] - self.last)
        for low, high in ends if self.kind else ():
            put(low[:, 0] & 1, 1)
            put(high[:, 0] & 1, int(self.kind == EACH))
        if mode.second_index_bits:
            planes = [(indices[0], self.index_bits), (indices[1], self.second_bits)]
            planes = planes[::-1] if self.step.is_turned else planes
        else:
            planes = [(sum(indices), self.index_bits)]
        for plane, bits in planes:
            is_anchor = (np.arange(16)[None, :, None] == self.anchors[:, None]).any(-1)
            width = np.where(is_anchor, bits - 1, bits)
            spread = np.zeros((count, 16 * bits), int)
            at = np.cumsum(width, 1) - width
            for bit in range(bits):
                rows, texels = np.nonzero(bit < width)
                spread[rows, at[rows, texels] + bit] = plane[rows, texels] >> bit & 1
            fields.append(spread[:, : 16 * bits - self.mode.subsets])
        return np.packbits(np.concatenate(fields, 1).astype(np.uint8), axis=1, bitorder="little")
