# SPDX-License-Identifier: GPL-3.0-or-later
"""The last passes over a band: from normals to what is stored, with the margin around the islands."""

from collections.abc import Sequence

import gpu
import numpy as np

from ..mesh.arrays import Mesh
from ..passes import margin, resolve, target
from .settings import Settings


class Finish:
    """Made once for a map; `lows` are the meshes whose islands lie on it."""

    def __init__(self, lows: Sequence[Mesh], settings: Settings):
        self.lows = lows
        self.settings = settings

    def draw(self, band, normals: gpu.types.GPUTexture) -> target.Target:
        """The stored texels (RGBA32F) of the band's own rows and their state (R8) from `normals`, which has its halo."""
        settings = self.settings
        offsets = target.get("margin", settings.width, band.height, "R16I")
        margin.draw(offsets, normals, settings.margin)
        stored = target.get("map", settings.width, band.stop - band.start, "RGBA32F", "R8")
        resolve.draw(
            stored,
            normals,
            offsets,
            halo=band.halo,
            margin=settings.margin,
            channels=channels(settings),
            missed=settings.missed,
        )
        return stored


def channels(settings: Settings) -> np.ndarray:
    """The (3, 3) matrix from a normal to what red, green and blue hold of it."""
    matrix = np.zeros((3, 3))
    for row, axis in enumerate((settings.red, settings.green, settings.blue)):
        matrix[row, "XYZ".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return matrix


def upwards(texels: np.ndarray, settings: Settings) -> np.ndarray:
    """The z of the normals that stored texels (height, width, 4) stand for, (height, width), times one half."""
    z = channels(settings)[:, 2]
    return texels[..., int(np.argmax(np.abs(z)))] * np.float32(z.sum()) - np.float32(0.5 * z.sum())
