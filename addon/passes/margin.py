# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the nearest written texel, row by row; the resolve pass then looks along the columns.

Exact where jump flooding is not, and two passes over the map where that takes one for each power of two: on a software
rasteriser a margin of 16 texels costs a third.
"""

import gpu

from . import shader, target

PROGRAM = shader.Program(
    vertex="fullscreen_vert.glsl",
    fragment="margin_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "normals"),),
    constants=(("INT", "margin"),),
    outputs=(("INT", "offset_out"),),
)


def draw(into: target.Target, normals: gpu.types.GPUTexture, margin: int) -> None:
    """Write into `into` (R16I) how many columns away the nearest written texel of the same row is, at most `margin`.

    0 is the texel itself, 32767 stands for none.
    """
    target.fill(into, PROGRAM, normals=normals, margin=margin)
