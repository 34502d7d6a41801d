# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds or dithers values from 0 to 1 to 8 or 16 bits, and measures the error of normals."""

import numpy as np

HALF, MOST_HALF = 16, np.float32(65504.0)
"""The bits of floats that cannot hold all values, and the highest of them, which higher values become."""
SAMPLES = 1 << 17
"""The error is measured on about this many texels of a tile at most."""
# Multiples of 1/g, 1/g^2 and 1/g^3, with g^4 = g + 1, spread evenly over rows, columns and channels together
# (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018); here in units of 2^-32, which wrap around.
_G = 1.2207440846057596
_ROW, _COLUMN, _CHANNEL = (int(2**32 / _G**power) for power in (1, 2, 3))


def steps(values: np.ndarray, depth: int) -> np.ndarray:
    """`values` float32 as whole numbers of `depth` bits, uint8 or uint16: the nearest, from 0 for 0 to the highest for 1.

    NaN becomes 0.
    """
    most = np.float32(2**depth - 1)
    scaled = values * most
    scaled += np.float32(0.5)
    np.clip(scaled, np.float32(0.0), most, out=scaled)
    with np.errstate(invalid="ignore"):  # NaN
        return scaled.astype(np.uint8 if depth == 8 else np.uint16)


def rounded(values: np.ndarray, depth: int) -> np.ndarray:
    """`values` float32 from 0 to 1, rounded to multiples of 1 / (2^depth - 1) as Blender does."""
    steps = np.float32(2**depth - 1)
    return np.floor(values * steps + np.float32(0.5)) / steps


def dithered(texels: np.ndarray, *, with_alpha: bool = False) -> np.ndarray:
    """`texels` (height, width, 4) float32 as multiples of 1/255. Their mean over a neighborhood stays the same.

    Each color is rounded up or down by a threshold that depends only on its position, so that each bake gives the same
    result. Alpha, and colors where alpha is 0, are rounded to the nearest multiple: the background keeps one color.
    with_alpha: dither alpha as well, and all colors, because alpha holds a map.
    """
    height, width = texels.shape[:2]
    rows, columns = (np.arange(side, dtype=np.uint32) for side in (height, width))
    lattice = rows[:, None] * np.uint32(_ROW) + columns * np.uint32(_COLUMN)
    is_background = (texels[..., 3] == 0.0) & (not with_alpha)
    result = texels * np.float32(255.0)
    for channel in range(4 if with_alpha else 3):
        # 15 bits, neither 0 nor 1: added to 255, they are exact in single precision.
        threshold = ((lattice + np.uint32(channel * _CHANNEL % 2**32)) >> 17).astype(np.float32)
        threshold += np.float32(0.5)
        threshold *= np.float32(2**-15)
        threshold[is_background] = 0.5
        result[..., channel] += threshold
    if not with_alpha:
        result[..., 3] += np.float32(0.5)
    np.floor(result, out=result)
    result /= np.float32(255.0)
    return result


def sample(texels: np.ndarray) -> np.ndarray:
    """Texels (N, 4) from all parts of (height, width, 4)."""
    flat = texels.reshape(-1, 4)
    return flat[:: (len(flat) // SAMPLES) | 1]  # an odd step does not take the same few columns of each row


def angles(texels: np.ndarray, stored: np.ndarray) -> np.ndarray:
    """Degrees (M,) float32 between the normals of texels (N, 4) and the stored ones, where alpha is not 0."""
    is_written = texels[:, 3] > 0.0
    before, after = (_unit(values[is_written, :3].T) for values in (texels, stored))
    # From the chord: the cosine of a small angle is too close to 1 for a precise result.
    after -= before
    chord = _lengths(after)
    return np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))).astype(np.float32)


def _unit(columns: np.ndarray) -> np.ndarray:
    """The normals (3, N) float64 of stored values: columns, because numpy is slow along short rows."""
    vectors = columns.astype(np.float64, order="C") * 2.0 - 1.0
    vectors /= np.maximum(_lengths(vectors), 1e-30)
    return vectors


def _lengths(columns: np.ndarray) -> np.ndarray:
    return np.sqrt(np.square(columns).sum(axis=0))
