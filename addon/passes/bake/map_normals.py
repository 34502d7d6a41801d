# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the low mesh in UV space, and decodes its normal map on each texel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.udim import UvToClip
from .. import shader, target
from ..program import Program
from .tangent import VARYINGS

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="bake/tangent_vert.glsl",
    fragment="bake/map_normals_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "normal"), ("VEC4", "tangent")),
    varyings=VARYINGS,
    samplers=(("FLOAT_2D", "normal_map"),),
    constants=(("VEC4", "uv_to_clip"), ("MAT4", "shading")),
    outputs=(("VEC4", "normal_out"), ("VEC4", "fit_out")),
)

NO_DIRECTION, MISSED = 2.0, 3.0
"""Instead of a length, as in map_normals_frag.glsl."""


def draw(
    into: target.Target,
    low: gpu.types.GPUBatch,
    normal_map: gpu.types.GPUTexture,
    uv_to_clip: UvToClip,
    shading: np.ndarray,
) -> None:
    """Clear `into` (RGBA32F, R16F) and decode a map on the texels that `low` covers.

    The first texture gets unit normals: alpha 1, or -1 where the map's alpha is 0, or 0 where the color is no direction. The
    second gets the length of the stored vector, below 0 if it points away from the surface, or MISSED or NO_DIRECTION.
    low: batch with attributes uv, normal and tangent. normal_map: of the same size, as it is stored. shading: (4, 4) float64
    as view.lit.shading packs it; its light's first number is above 0 if the matrix applies to the low mesh's normals, too.
    """
    compiled = shader.load(PROGRAM)
    with target.drawing(into):
        compiled.bind()
        target.bind(compiled, PROGRAM, normal_map=normal_map, uv_to_clip=uv_to_clip, shading=shader.mat4(shading))
        low.draw(compiled)
