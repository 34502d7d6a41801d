# SPDX-License-Identifier: GPL-3.0-or-later
"""Values at the corners of the high triangles, in textures beside cast.Tables: UVs, attributes and tangents.

Triangles are in the order of the hits' numbers, as in cast.Tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import data_texture
from .finite_values import finite

if TYPE_CHECKING:
    import gpu


@dataclass(frozen=True)
class CornerValues:
    """A layer on the GPU. A texel of `triangles` has the numbers of a triangle's three values in `values`, and one number more,
    as shaders/lib/triangle_lib.glsl reads them."""

    triangles: gpu.types.GPUTexture
    values: gpu.types.GPUTexture


def upload_uvs(uv: np.ndarray, corners: np.ndarray, materials: np.ndarray) -> CornerValues:
    """Upload UVs with material numbers, as shaders/lib/footprint_lib.glsl reads them.

    uv (C, 2) float32; corners (T, 3) int, indices into it; materials (T,), the number of each triangle's material.
    """
    return CornerValues(data_texture.upload_numbers(corners, materials.astype(np.int32)), data_texture.upload(uv))


def upload_values(values: np.ndarray, corners: np.ndarray) -> CornerValues:
    """Upload the values of an attribute.

    values (C, 1 to 4) float32; corners (T, 3) int, indices into it. A single number fills red, green and blue; alpha is 1
    unless there are four channels. Values that are not finite are replaced.
    """
    wide = np.ones((len(values), 4), np.float32)
    channels = values.shape[1]
    wide[:, : 3 if channels == 1 else channels] = finite(values)
    if channels == 2:
        wide[:, 2] = 0.0
    return CornerValues(data_texture.upload_numbers(corners), data_texture.upload(wide))


def upload_tangents(tangents: np.ndarray, corners: np.ndarray) -> CornerValues:
    """Upload tangents.

    tangents (C, 4) float32: world directions of any length, which are normalized, and the sign of the bitangent, for
    bitangent = sign * cross(normal, tangent) in world space: a mirrored object has the other sign than its mesh. A
    tangent of zeros has no normal map. corners (T, 3) int, indices into it.
    """
    unit = np.array(tangents, np.float32)
    length = np.linalg.norm(unit[:, :3], axis=1, keepdims=True)
    unit[:, :3] /= np.where(length > 0.0, length, 1.0)
    return CornerValues(data_texture.upload_numbers(corners), data_texture.upload(unit))
