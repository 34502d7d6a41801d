# SPDX-License-Identifier: GPL-3.0-or-later
"""What a finished map holds for each texel: a color, and where it came from."""

import numpy as np

MARGIN, WRITTEN, MISSED, DEFERRED = 1, 2, 3, 4
"""The state of a texel, as shaders/lib/state_lib.glsl has it; 0 is background. The margin fills deferred texels later."""

Map = tuple[np.ndarray, np.ndarray]
"""Texels (height, width, 4) float32 as they are stored, and their state (height, width) uint8."""


def of_raw(alpha: np.ndarray) -> np.ndarray:
    """The states, uint8, of texels without a margin, from the alpha of their normals."""
    return np.where(alpha > 0.0, WRITTEN, np.where(alpha < 0.0, MISSED, 0)).astype(np.uint8)
