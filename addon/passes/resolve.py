# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns unit normals into the stored map."""

from . import shader, target

PROGRAM = shader.Program(
    vertex="fullscreen_vert.glsl",
    fragment="resolve_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "normals"), ("INT_2D", "offsets")),
    constants=(("INT", "halo"), ("INT", "margin"), ("FLOAT", "green"), ("VEC4", "missed")),
    outputs=(("VEC4", "map_out"), ("FLOAT", "state_out")),
)
MARGIN, WRITTEN, MISSED = 1, 2, 3
"""What the state texture says of a texel; 0 is background."""


def draw(
    into: target.Target,
    normals: target.Target,
    offsets: target.Target,
    *,
    halo: int,
    margin: int,
    flip_green: bool,
    missed: tuple[float, float, float],
) -> None:
    """Write the map (RGBA32F) and the state of its texels (R8) into `into`, whose row 0 is row `halo` of `normals`.

    normals: alpha above 0 where a texel was written, below 0 where its ray missed. offsets: what margin.draw found there.
    missed: the colour that stands for a miss.
    """
    target.fill(
        into,
        PROGRAM,
        normals=normals.texture,
        offsets=offsets.texture,
        halo=halo,
        margin=margin,
        green=-1.0 if flip_green else 1.0,
        missed=(*missed, 0.0),
    )
