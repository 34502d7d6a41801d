# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds out what the channels of a stored normal map hold: whether alpha is coverage, and whether z is stored."""

import numpy as np

from ..declarations.choices import Space
from .stored_normals import StoredNormals

STEP = 1.0 / 255.0
"""Of 8 bits. Compression and rounding move values by about one."""
MOST_BETWEEN = 0.25
"""The share of texels with some alpha whose alpha may be less than 1 in a map of coverage: the smooth borders of islands."""
LEAST_Z = 0.5
"""The median of a tangent-space map's z, at least. Red and green that give less are no x and y."""


def is_coverage(texels: np.ndarray) -> bool:
    """Whether alpha says where the map is. Otherwise it holds other data, as gloss or height. texels: (N, 4) of the map."""
    has_some = texels[:, 3] > 0.5 * STEP
    between = np.count_nonzero(has_some & (texels[:, 3] < 1.0 - 0.5 * STEP))
    return between <= MOST_BETWEEN * np.count_nonzero(has_some)


def lacks_z(texels: np.ndarray, stored: StoredNormals) -> bool:
    """Whether a tangent-space map has x and y alone: the third channel is the same everywhere. texels: (N, 4) of the map."""
    channel, _ = _z_channel(stored)
    known = texels[texels[:, 3] > 0.0]
    if stored.from_space != Space.TANGENT or not len(known) or np.ptp(known[:, channel]) > 1.5 * STEP:
        return False
    z = _z(known, channel)
    off = np.abs(_as_stored(z, stored) - known[:, channel])
    return bool(np.median(z) > LEAST_Z and off.max() > 2.5 * STEP)


def rebuild_z(values: np.ndarray, stored: StoredNormals) -> None:
    """Fill the channel of z in `values` (..., 4) from x and y, so that normals have length 1 and point up."""
    channel, _ = _z_channel(stored)
    values[..., channel] = _as_stored(_z(values, channel), stored)


def z_channel(stored: StoredNormals) -> str:
    """The name of the channel that stores z."""
    return ("red", "green", "blue")[_z_channel(stored)[0]]


def _z_channel(stored: StoredNormals) -> tuple[int, float]:
    """The number of the channel that stores z, and its sign."""
    axes = [stored.from_red, stored.from_green, stored.from_blue]
    channel = next(number for number, axis in enumerate(axes) if axis[1] == "Z")
    return channel, -1.0 if axes[channel][0] == "-" else 1.0


def _as_stored(z: np.ndarray, stored: StoredNormals) -> np.ndarray:
    return z * np.float32(0.5 * _z_channel(stored)[1]) + np.float32(0.5)


def _z(values: np.ndarray, channel: int) -> np.ndarray:
    """The z of normals whose x and y are in the other two of the first three channels."""
    flat = sum(np.square(values[..., other] * 2.0 - 1.0) for other in range(3) if other != channel)
    return np.sqrt(np.maximum(1.0 - flat, 0.0))
