# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds how many bits the values of an image need, and what their rounding costs normals."""

import numpy as np

CLOSE = 1e-6
"""How near a value must be to a multiple of a step. Steps of 16 bits are 15 times as large."""


def bits(values: np.ndarray) -> int:
    """8 or 16 if all values are multiples of those steps from 0 to 1, else 32. values: of any shape, float32."""
    for depth in (8, 16):
        scaled = values.astype(np.float64) * (2**depth - 1)
        if (np.abs(scaled - np.rint(scaled)) <= CLOSE * (2**depth - 1)).all():
            return depth
    return 32


def moved(values: np.ndarray, depth: int, seed: int = 0) -> np.ndarray:
    """Values (N, n) that would have been rounded to `values`, float32, drawn at random, the same ones for each call."""
    step = 1.0 / (2**depth - 1)
    return (values + np.random.default_rng(seed).uniform(-0.5 * step, 0.5 * step, values.shape)).astype(np.float32)
