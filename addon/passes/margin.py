# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds for each texel the nearest written one, by jump flooding."""

from . import shader, target

SEED = shader.Program(
    vertex="fullscreen_vert.glsl",
    fragment="margin_seed_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "normals"),),
    outputs=(("IVEC2", "nearest_out"),),
)
FLOOD = shader.Program(
    vertex="fullscreen_vert.glsl",
    fragment="margin_flood_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("INT_2D", "nearest"),),
    constants=(("INT", "jump"),),
    outputs=(("IVEC2", "nearest_out"),),
)


def flood(normals: target.Target, margin: int) -> target.Target:
    """The texel coordinates (RG16I) of the nearest written texel at most `margin` texels away, or (-1, -1).

    Some farther ones are found as well; whoever reads must look at the distance. A last step of one texel mends most of
    what jump flooding can get wrong.
    """
    size = normals.width, normals.height
    nearest, spare = (target.get(role, *size, "RG16I") for role in ("margin a", "margin b"))
    target.fill(nearest, SEED, normals=normals.texture)
    for jump in jumps(margin):
        target.fill(spare, FLOOD, nearest=nearest.texture, jump=jump)
        nearest, spare = spare, nearest
    return nearest


def jumps(margin: int) -> list[int]:
    """The steps that reach `margin` texels: powers of two downwards, then 1 once more."""
    if margin == 0:
        return []
    return [2**power for power in reversed(range(margin.bit_length()))] + [1]
