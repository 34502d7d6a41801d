# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums of the texels that share a texel of the next mip level."""

from collections.abc import Iterator

import numpy as np

LEVELS = 7
"""A part of a map has 2 ^ LEVELS rows."""


def halved(values: np.ndarray) -> np.ndarray:
    """The sums (height // 2, width // 2, ...), at least one of each, over the blocks of `values` (height, width, ...).

    Of an odd number of rows or columns, the last three share a block.
    """
    for axis in (0, 1):
        values = np.moveaxis(_halved_rows(np.moveaxis(values, axis, 0)), 0, axis)
    return np.ascontiguousarray(values)


def _halved_rows(values: np.ndarray) -> np.ndarray:
    count = len(values) // 2
    if count == 0:
        return values
    sums = values[0 : 2 * count : 2] + values[1 : 2 * count : 2]
    if len(values) % 2:
        sums[-1] += values[-1]
    return sums


def slabs(height: int) -> Iterator[slice]:
    """The rows of a map in parts, so that memory does not grow with it. Up to LEVELS times, halving a part gives what halving
    the map gives."""
    count = max(1, height >> LEVELS)
    for number in range(count):
        yield slice(number << LEVELS, height if number + 1 == count else number + 1 << LEVELS)


def spread(values: np.ndarray, size: tuple[int, int], levels: int, rows: slice) -> np.ndarray:
    """The texels of `values`, a map that was `halved` so many times, on some rows of the map of `size` (height, width)."""
    across, along = (
        np.minimum(np.arange(full) >> levels, small - 1) for full, small in zip(size, values.shape[:2], strict=True)
    )
    return values[across[rows, None], along]
