# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns unit normals into the stored map."""

import gpu
import numpy as np

from . import shader, target

PROGRAM = shader.Program(
    vertex="fullscreen_vert.glsl",
    fragment="resolve_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "normals"), ("INT_2D", "offsets")),
    constants=(("INT", "halo"), ("INT", "margin"), ("MAT4", "channels"), ("VEC4", "missed")),
    outputs=(("VEC4", "map_out"), ("FLOAT", "state_out")),
)
MARGIN, WRITTEN, MISSED = 1, 2, 3
"""What the state texture says of a texel; 0 is background."""


def draw(
    into: target.Target,
    normals: gpu.types.GPUTexture,
    offsets: target.Target,
    *,
    halo: int,
    margin: int,
    channels: np.ndarray,
    missed: tuple[float, float, float],
) -> None:
    """Write the map (RGBA32F) and the state of its texels (R8) into `into`, whose row 0 is row `halo` of `normals`.

    normals: alpha above 0 where a texel was written, below 0 where its ray missed. offsets: what margin.draw found there.
    channels: (3, 3), from a normal to what red, green and blue hold. missed: the colour that stands for a miss.
    """
    target.fill(
        into,
        PROGRAM,
        normals=normals,
        offsets=offsets.texture,
        halo=halo,
        margin=margin,
        channels=shader.mat4(channels),
        missed=(*missed, 0.0),
    )
