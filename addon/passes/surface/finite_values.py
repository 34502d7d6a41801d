# SPDX-License-Identifier: GPL-3.0-or-later
"""Replaces values that would spread to others where values are averaged."""

import numpy as np

LARGEST = 65504.0
"""What infinite values become: the largest number of half precision, as rendered images store it."""


def finite(values: np.ndarray) -> np.ndarray:
    """`values` (float32, any shape) with 0 in place of NaN, and LARGEST in place of infinity."""
    # A sum is finite unless a term is not, or it overflows: the common case takes one pass and no memory.
    with np.errstate(over="ignore", invalid="ignore"):
        is_finite = bool(np.isfinite(values.sum()))
    return values if is_finite else np.nan_to_num(values, nan=0.0, posinf=LARGEST, neginf=-LARGEST)
