# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums of the texels that share a texel of the next mip level."""

import numpy as np


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


def spread(values: np.ndarray, size: tuple[int, int], levels: int) -> np.ndarray:
    """The texels of `values`, a map that was `halved` so many times, on each texel of the map of `size` (height, width)."""
    rows, columns = (
        np.minimum(np.arange(full) >> levels, small - 1) for full, small in zip(size, values.shape[:2], strict=True)
    )
    return values[rows[:, None], columns]
