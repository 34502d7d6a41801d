# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes maps smaller: a square of texels becomes one."""

import numpy as np


def factor(size: tuple[int, int], most: int) -> int:
    """The texels along a side of a square, so that a map of `size` (width, height) has at most `most` squares along a side."""
    return max(1, -(-max(size) // most))


def means(texels: np.ndarray, is_known: np.ndarray, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """The means of the known texels in each square, (rows, columns, 3) float32, and which squares have any, as bool.

    texels: (height, width, 3 or more) float32. is_known: (height, width) bool. Squares at the end may be incomplete.
    """
    height, width = is_known.shape
    columns = np.arange(0, width, factor)
    result = np.zeros((-(-height // factor), len(columns), 3), np.float32)
    has_any = np.zeros(result.shape[:2], bool)
    for row, first in enumerate(range(0, height, factor)):
        part, known = texels[first : first + factor, :, :3], is_known[first : first + factor]
        counts = np.add.reduceat(known.sum(axis=0), columns)
        sums = np.add.reduceat(np.where(known[..., None], part, np.float32(0.0)).sum(axis=0), columns, axis=0)
        result[row] = sums / np.maximum(counts, 1)[:, None]
        has_any[row] = counts > 0
    return result, has_any


def add_greatest(into: np.ndarray, values: np.ndarray, start: int, factor: int) -> None:
    """Raise `into` (rows, columns) to the greatest of `values` (height, width) in each square. start: their first row of the
    map."""
    of_columns = np.maximum.reduceat(values, np.arange(0, values.shape[1], factor), axis=1)
    np.maximum.at(into, (start + np.arange(len(values))) // factor, of_columns)
