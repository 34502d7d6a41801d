# SPDX-License-Identifier: GPL-3.0-or-later
"""What each material of the high meshes shows in one map: the number of a feed, or a constant color."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import data_texture

if TYPE_CHECKING:
    import gpu

CONSTANT = 0
"""The number of all constants; images and attributes count from 1. As in shaders/surface/add_constants_comp.glsl."""
UNKNOWN = -1
"""The number of a material that the map cannot show."""


@dataclass(frozen=True)
class MaterialTable:
    """feeds (M,) int: the number of each material's feed. texture: the same with constants, for shaders."""

    feeds: np.ndarray
    texture: gpu.types.GPUTexture


def upload(feeds: np.ndarray, colors: np.ndarray | None = None) -> MaterialTable:
    """Upload one texel for each material number, from 0.

    feeds (M,) int: CONSTANT, UNKNOWN, or the number of a feed, at most 2^24. colors (M, 3) float32: the constants.
    """
    texels = np.zeros((max(1, len(feeds)), 4), np.float32)
    texels[:, 3] = UNKNOWN
    texels[: len(feeds), 3] = feeds
    if colors is not None:
        texels[: len(feeds), :3] = colors
    return MaterialTable(np.asarray(feeds), data_texture.upload(texels))
