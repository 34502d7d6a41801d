# SPDX-License-Identifier: GPL-3.0-or-later
"""Replaces values that would spread to others where values are averaged."""

import numpy as np

LARGEST = 65504.0
"""What infinite values become: the largest number of half precision, as rendered images store it."""


def finite(values: np.ndarray) -> np.ndarray:
    """`values` (float32, any shape) with 0 in place of NaN, and LARGEST in place of infinity."""
    return values if _are_finite(values) else np.nan_to_num(values, nan=0.0, posinf=LARGEST, neginf=-LARGEST)


def count_others(values: np.ndarray) -> int:
    """How many rows of `values` (N, channels) float32 have one that `finite` replaces."""
    return 0 if _are_finite(values) else int(np.count_nonzero(~np.isfinite(values).all(axis=1)))


def _are_finite(values: np.ndarray) -> bool:
    """False if a value is not finite, or if their sum is not."""
    # A sum is finite unless a term is not, or it overflows: the common case takes one pass and no memory.
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(values.sum()))
