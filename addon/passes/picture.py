# SPDX-License-Identifier: GPL-3.0-or-later
"""A small picture of normals that are still being drawn, for the screen."""

import gpu
import numpy as np

from . import shader, target

PROGRAM = shader.Program(
    vertex="fullscreen_vert.glsl",
    fragment="picture_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "normals"),),
    constants=(("VEC4", "scale"), ("MAT4", "channels")),
    outputs=(("VEC4", "picture_out"),),
)
SIDE = 512
"""Texels of the longer side, at most."""


def draw(normals: gpu.types.GPUTexture, channels: np.ndarray) -> gpu.types.GPUTexture:
    """The picture of `normals` (RGBA32F, or sums of such), alpha 0 where there are none; channels as resolve.draw has it."""
    shrink = max(1.0, max(normals.width, normals.height) / SIDE)
    into = target.get("picture", max(1, int(normals.width / shrink)), max(1, int(normals.height / shrink)), "RGBA16F")
    scale = normals.width / into.width, normals.height / into.height, 0.0, 0.0
    target.fill(into, PROGRAM, normals=normals, scale=scale, channels=shader.mat4(channels))
    into.finish()  # so that the clock sees what was drawn before it
    return into.texture
