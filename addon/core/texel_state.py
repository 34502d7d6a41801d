# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of each texel of a finished map: whether it was drawn, missed, filled or is background."""

import numpy as np

MARGIN, WRITTEN, MISSED, DEFERRED = 1, 2, 3, 4
"""States of a texel, as in shaders/lib/state_lib.glsl; 0 is background. The margin fills deferred texels later."""

Map = tuple[np.ndarray, np.ndarray]
"""Texels (height, width, 4) float32 as they are stored, and their state (height, width) uint8."""


def of_raw(alpha: np.ndarray) -> np.ndarray:
    """The states, uint8, of texels without a margin, from the alpha of their normals."""
    return np.where(alpha > 0.0, WRITTEN, np.where(alpha < 0.0, MISSED, 0)).astype(np.uint8)
