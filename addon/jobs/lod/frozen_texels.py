# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the vertices of a mesh around texels where a coarser mesh would show other normals."""

import numpy as np

from ...core import udim
from ...passes import audit
from .decimation import Source

LAYERS = 4
"""How many triangles on one texel are found: as many as mirrored or repeated parts usually share."""


def vertices(source: Source, texels: np.ndarray) -> np.ndarray:
    """Which vertices (V,) bool belong to a triangle on one of these `texels` (height, width) bool."""
    surface, result = source.surface, np.zeros(len(source.is_kept), bool)
    if texels.any():
        uploaded = audit.upload_with_ids(surface.triangles, surface.uv)
        for numbers in audit.layers_of_triangles(uploaded, texels.shape[::-1], udim.uv_to_clip(), LAYERS):
            found = np.unique(numbers[texels]).astype(np.int64)
            result[surface.vertices[surface.triangles[found[found > 0] - 1]]] = True
    return result
