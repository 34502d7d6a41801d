# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws a small picture of an unfinished normal map, for the screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/preview_picture_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "normals"),),
    constants=(("VEC4", "scale"), ("MAT4", "channels")),
    outputs=(("VEC4", "picture_out"),),
)
SIDE = 512
"""The largest length of the longer side, in texels."""


def draw(
    normals: gpu.types.GPUTexture, size: tuple[int, int], channels: np.ndarray, *, clear: bool, is_value: bool = False
) -> gpu.types.GPUTexture:
    """Draw the picture of `normals` (RGBA32F, or sums of samples), a part of a map of `size`. channels: (3, 3), as in
    lit.shading.

    is_value: `normals` has values instead, which are shown as they are. Texels without normals keep the previous
    picture, unless `clear` is True.
    """
    shrink = max(1.0, max(size) / SIDE)
    into = target.get("picture", max(1, int(size[0] / shrink)), max(1, int(size[1] / shrink)), "RGBA16F")
    scale = normals.width / into.width, normals.height / into.height, float(is_value), 0.0
    if clear:
        target.clear(into)
    target.fill(into, PROGRAM, normals=normals, scale=scale, channels=shader.mat4(channels))
    into.finish()  # so that the caller's clock includes the drawing
    return into.texture
