# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals in the channels of a map: the component in each channel, and what stored normals say."""

from dataclasses import replace

import numpy as np

from ..core.declarations import bases
from ..core.declarations.choices import Space
from ..core.declarations.readers import Reader
from ..core.map_types import WRITTEN, Map, states_of_raw
from ..core.settings import MapSettings, Settings
from ..passes import lit


def channels(settings: MapSettings) -> np.ndarray:
    """The (3, 3) matrix from a normal to its red, green and blue channels."""
    matrix = np.zeros((3, 3))
    for row, axis in enumerate((settings.red, settings.green, settings.blue)):
        matrix[row, "XYZ".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return matrix


def reading(settings: MapSettings) -> tuple[int, int, int]:
    """How a map of these settings is meant to be read, as lit.reading has it, before it is rounded."""
    kinds = {Space.WORLD: lit.WORLD, Space.OBJECT: lit.OBJECT}
    kind = kinds.get(settings.space, lit.TANGENT + bases.of_name(settings.basis).flags)
    return lit.reading(kind, channels(settings))


def reading_by(reader: Reader, settings: Settings) -> tuple[int, int, int]:
    """How a program reads a tangent-space map of these settings."""
    depth = min(settings.storing.depth, reader.depth)
    steps = 0 if depth > 8 and settings.storing.is_float else 2**depth - 1
    axes = channels(replace(settings, red="+X", green=reader.green, blue="+Z").map)
    return lit.reading(lit.TANGENT + reader.basis.flags, axes, steps=steps, rebuilds_z=reader.rebuilds_z)


def stored(normals: np.ndarray, settings: Settings) -> Map:
    """Normals as rendering.Renderer.raw returns them, as they are stored in a map of these settings, before rounding."""
    texels = np.ones_like(normals)
    texels[..., :3] = normals[..., :3] @ (0.5 * channels(settings.map).T).astype(np.float32) + 0.5
    return texels, states_of_raw(normals[..., 3])


def backwards(texels: np.ndarray, state: np.ndarray, settings: MapSettings) -> int:
    """The number of written texels whose z is 0 or less. texels (height, width, 4): normals as they are stored."""
    z = channels(settings)[:, 2]
    stored = texels[..., int(np.argmax(np.abs(z)))]
    half = np.float32(0.5)
    return int(np.count_nonzero((stored <= half if z.sum() > 0.0 else stored >= half) & (state == WRITTEN)))


def upwards(texels: np.ndarray, settings: MapSettings) -> np.ndarray:
    """Half the z of the normals in stored texels (height, width, 4): (height, width)."""
    z = channels(settings)[:, 2]
    return texels[..., int(np.argmax(np.abs(z)))] * np.float32(z.sum()) - np.float32(0.5 * z.sum())
