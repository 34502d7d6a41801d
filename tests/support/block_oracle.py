# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of BC4 and BC5 in numpy, written from Khronos' Data Format Specification (RGTC) and from what the encoder promises.

Nothing is folded or counted in 32 bits here: all eight values of all candidates are compared, in 64-bit integers.
"""

import numpy as np

ONE = 71400
"""The value 1 in the encoder's units: the values of a block are whole, between 0 and 255 * 280."""
STEP = ONE // 255
MIDDLE = ONE // 2
NEVER = 2**62
"""The cost of endpoints that no block has."""


def tiles(texels):
    """The texels (B, 16, ...) of the blocks of a map (H, W, ...), row by row."""
    height, width = texels.shape[:2]
    cut = texels.reshape(height // 4, 4, width // 4, 4, *texels.shape[2:])
    return cut.swapaxes(1, 2).reshape(-1, 16, *texels.shape[2:])


def palette(low, high, is_six):
    """The eight values (..., 8) by index of a block with these endpoints, low <= high; six between them or eight."""
    low, high = np.asarray(low)[..., None], np.asarray(high)[..., None]
    part = np.array([0, 5, 1, 2, 3, 4, 0, 0])
    six = ((5 - part) * low + part * high) * (STEP // 5)
    six = np.where(np.arange(8) == 6, 0, np.where(np.arange(8) == 7, ONE, six))
    part = np.array([0, 7, 1, 2, 3, 4, 5, 6])
    eight = ((7 - part) * high + part * low) * (STEP // 7)
    return np.where(np.asarray(is_six)[..., None], six, eight)


def decoded(blocks):
    """The values (B, 16) float64 of blocks of BC4 (B, 8) uint8, by the rule in floats."""
    ends = blocks[:, :2].astype(float) / 255.0
    indices = np.unpackbits(blocks[:, 2:], axis=1, bitorder="little").reshape(-1, 16, 3) @ (1, 2, 4)
    first, second = ends[:, :1], ends[:, 1:]
    part = indices - 1.0
    eight = ((7.0 - part) * first + part * second) / 7.0
    six = ((5.0 - part) * first + part * second) / 5.0
    six = np.where(indices == 6, 0.0, np.where(indices == 7, 1.0, six))
    values = np.where(blocks[:, :1] > blocks[:, 1:2], eight, six)
    return np.where(indices == 0, first, np.where(indices == 1, second, values))


def fixed(texels):
    """Floats in the encoder's units: in steps of 2^-18 first, then rounded. What is no number is 0."""
    numbers = np.clip(np.nan_to_num(texels, nan=0.0), 0.0, 1.0).astype(np.float32)
    steps = np.floor(numbers * np.float32(2**18) + np.float32(0.5)).astype(np.int64)
    return (steps * 8925 + 2**14) // 2**15


def counts(weights):
    """The weights (B, 16) float32 in sixteenths. Where none of a block counts, all do."""
    whole = np.floor(np.minimum(weights, np.float32(1.0)) * np.float32(16.0) + np.float32(0.5)).astype(np.int64)
    whole = np.where(weights > 0.0, np.maximum(whole, 1), 0)
    return np.where(whole.any(axis=1, keepdims=True), whole, 16)


def search(values, weights):
    """The best endpoints (B,) low and high, and whether six values are between them, for values and weights (B, 16)."""
    count = len(values)
    inside = np.clip(values, 0, ONE)
    is_extreme = np.where((weights >= 8).any(axis=1, keepdims=True), weights >= 8, weights > 0)
    span = _range(inside, is_extreme)
    shift = np.zeros(count, np.int64)
    while (is_wide := (span[1] - span[0]) >> shift > 4095).any():
        shift += is_wide

    def cost(low, high, is_six):
        possible = (low >= 0) & (high <= 255) & (low <= high) & (is_six | (low < high))
        off = np.abs(values[:, :, None] - palette(low, high, np.full(count, is_six))[:, None, :]).min(axis=2)
        off = np.minimum(off >> shift[:, None], 511)
        return np.where(possible, (off * off * weights).sum(axis=1), NEVER)

    best = np.full(count, NEVER)
    found = np.zeros(count, np.int64), np.zeros(count, np.int64), np.ones(count, bool)
    for is_six in (False, True):
        is_end = (inside < STEP // 2) | (inside > ONE - STEP // 2)
        low, high = _range(inside, is_extreme & ~(is_six & is_end))
        first, last = np.minimum(low, high) // STEP, -(-np.maximum(low, high) // STEP)
        size = np.maximum(1, (last - first) // 16)
        least, at = np.full(count, NEVER), (first, last)

        def step(low, high, least, at, is_six=is_six):
            now = cost(low, high, is_six)
            is_less = now < least
            return np.where(is_less, now, least), tuple(
                np.where(is_less, new, old) for new, old in zip((low, high), at, strict=True)
            )

        for down in range(-1, 5):
            for up in range(-1, 5):
                least, at = step(first + up * size, last - down * size, least, at)
        for _ in range(6):
            size = np.maximum(1, size // 2)
            around = at
            for down in (-1, 0, 1):
                for up in (-1, 0, 1):
                    least, at = step(around[0] + up * size, around[1] + down * size, least, at)
        is_less = least < best
        best = np.where(is_less, least, best)
        found = tuple(np.where(is_less, new, old) for new, old in zip((*at, is_six), found, strict=True))
    return found


def _range(values, is_used):
    return np.where(is_used, values, ONE).min(axis=1), np.where(is_used, values, 0).max(axis=1)


def nearest(values, ends):
    """The indices (B, 16) of the nearest values of blocks, the first of equals."""
    return np.abs(values[:, :, None] - palette(*ends)[:, None, :]).argmin(axis=2)


def packed(ends, indices):
    """Blocks (B, 8) uint8."""
    low, high, is_six = ends
    head = np.stack([np.where(is_six, low, high), np.where(is_six, high, low)], axis=1).astype(np.uint8)
    bits = (indices[:, :, None] >> np.arange(3) & 1).astype(np.uint8).reshape(len(indices), 48)
    return np.concatenate([head, np.packbits(bits, axis=1, bitorder="little")], axis=1)


def least_squares(texels, weights, channels):
    """Blocks (B, 8 * channels) uint8 of the first channels of texels (B, 16, 4), each by itself."""
    whole = counts(weights)
    parts = []
    for channel in range(channels):
        values = fixed(texels[..., channel])
        ends = search(values, whole)
        parts.append(packed(ends, nearest(values, ends)))
    return np.concatenate(parts, axis=1)


def _cut(number, by):
    """A quotient, cut toward 0."""
    return np.sign(number) * (np.abs(number) // by)


def _root(number):
    found = np.floor(np.sqrt(number.astype(float))).astype(np.int64)
    assert (found * found <= number).all() and ((found + 1) ** 2 > number).all()
    return found


def aims(value, other, read, weights):
    """The values and weights with which a component is searched, where the other is read as `read`: the lowest point of the
    square of the angle to second order, and its steepness."""
    near, far = (value - MIDDLE) >> 5, (other - MIDDLE) >> 5
    unit = ONE // 64
    height = np.maximum(unit**2 - near**2 - far**2, unit**2 // 64)
    steepness = height + near**2
    slope = _cut(near * far * 256, steepness)
    return value - ((slope * (read - other)) >> 8), np.minimum(steepness * 16 // height * weights // 16, 1023)


def least_angles(texels, weights):
    """Blocks (B, 16) uint8 of BC5 for unit normals (B, 16, 4)."""
    whole = counts(weights)
    normal = fixed(texels[..., :3]) - MIDDLE
    rim = np.maximum(_root((normal[..., :2] ** 2).sum(axis=-1)), 1)[..., None]
    x, y = (
        np.moveaxis(np.where(normal[..., 2:] < 0, _cut(normal[..., :2] * MIDDLE, rim), normal[..., :2]), -1, 0) + MIDDLE
    )
    read = y
    for _ in range(2):
        aimed, steep = aims(x, y, read, whole)
        of_x = search(aimed, steep)
        read = np.take_along_axis(palette(*of_x), nearest(aimed, of_x), axis=1)
        aimed, steep = aims(y, x, read, whole)
        of_y = search(aimed, steep)
        read = np.take_along_axis(palette(*of_y), nearest(aimed, of_y), axis=1)
    pair = np.arange(64)
    shown = np.stack([palette(*of_x)[:, pair & 7], palette(*of_y)[:, pair >> 3]], axis=-1) - MIDDLE
    height = _root(np.maximum(MIDDLE**2 - (shown**2).sum(axis=-1), 0))
    shown = np.concatenate([shown, height[..., None]], axis=-1)
    off = np.minimum(np.abs(normal[:, :, None] - shown[:, None]), 32767)
    chosen = (off**2).sum(axis=-1).argmin(axis=2)
    return np.concatenate([packed(of_x, chosen & 7), packed(of_y, chosen >> 3)], axis=1)
