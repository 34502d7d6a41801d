# SPDX-License-Identifier: GPL-3.0-or-later
"""Values at the corners of the high triangles, in textures beside cast.Tables: UVs, attributes and tangents.

Triangles are in the order of the hits' numbers, as in cast.Tables.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import data_texture
from .finite_values import finite

if TYPE_CHECKING:
    import gpu


def upload_uvs(uv: np.ndarray, corners: np.ndarray, materials: np.ndarray) -> gpu.types.GPUTexture:
    """Upload UVs with material numbers, two texels a triangle, as shaders/lib/footprint_lib.glsl reads them.

    uv (C, 2) float32; corners (T, 3) int, indices into it; materials (T,), the number of each triangle's material.
    """
    texels = data_texture.empty(len(corners) * 2)
    triangles = texels[: len(corners) * 2].reshape(-1, 8)
    for corner in range(3):
        triangles[:, corner * 2 : corner * 2 + 2] = np.take(uv, corners[:, corner], axis=0, mode="clip")
    triangles[:, 6] = materials
    return data_texture.upload_padded(texels)


def upload_values(values: np.ndarray, corners: np.ndarray) -> gpu.types.GPUTexture:
    """Upload the values of an attribute, three texels a triangle.

    values (C, 1 to 4) float32; corners (T, 3) int, indices into it. A single number fills red, green and blue; alpha is 1
    unless there are four channels. Values that are not finite are replaced.
    """
    wide = np.ones((len(values), 4), np.float32)
    channels = values.shape[1]
    wide[:, : 3 if channels == 1 else channels] = finite(values)
    if channels == 2:
        wide[:, 2] = 0.0
    return _gathered(wide, corners)


def upload_tangents(tangents: np.ndarray, corners: np.ndarray) -> gpu.types.GPUTexture:
    """Upload tangents, three texels a triangle.

    tangents (C, 4) float32: world directions of any length, which are normalized, and the sign of the bitangent, for
    bitangent = sign * cross(normal, tangent) in world space: a mirrored object has the other sign than its mesh. A
    tangent of zeros has no normal map. corners (T, 3) int, indices into it.
    """
    unit = np.array(tangents, np.float32)
    length = np.linalg.norm(unit[:, :3], axis=1, keepdims=True)
    unit[:, :3] /= np.where(length > 0.0, length, 1.0)
    return _gathered(unit, corners)


def _gathered(values: np.ndarray, corners: np.ndarray) -> gpu.types.GPUTexture:
    texels = data_texture.empty(corners.size)
    np.take(values, corners.reshape(-1), axis=0, out=texels[: corners.size], mode="clip")
    return data_texture.upload_padded(texels)
