# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals in the channels of a map: the component in each channel, and what stored normals say."""

import numpy as np

from ..core import texel_state
from ..core.settings import Settings


def channels(settings: Settings) -> np.ndarray:
    """The (3, 3) matrix from a normal to its red, green and blue channels."""
    matrix = np.zeros((3, 3))
    for row, axis in enumerate((settings.red, settings.green, settings.blue)):
        matrix[row, "XYZ".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return matrix


def backwards(texels: np.ndarray, state: np.ndarray, settings: Settings) -> int:
    """The number of written texels whose z is 0 or less. texels (height, width, 4): normals as they are stored."""
    z = channels(settings)[:, 2]
    stored = texels[..., int(np.argmax(np.abs(z)))]
    half = np.float32(0.5)
    return int(np.count_nonzero((stored <= half if z.sum() > 0.0 else stored >= half) & (state == texel_state.WRITTEN)))


def upwards(texels: np.ndarray, settings: Settings) -> np.ndarray:
    """Half the z of the normals in stored texels (height, width, 4): (height, width)."""
    z = channels(settings)[:, 2]
    return texels[..., int(np.argmax(np.abs(z)))] * np.float32(z.sum()) - np.float32(0.5 * z.sum())
