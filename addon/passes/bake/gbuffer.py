# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the low mesh in UV space: the start and the direction of each texel's ray."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.udim import UvToClip
from .. import shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="bake/gbuffer_vert.glsl",
    fragment="bake/gbuffer_frag.glsl",
    inputs=(("VEC2", "uv"), ("VEC3", "position"), ("VEC3", "direction")),
    varyings=(("VEC3", "v_position"), ("VEC3", "v_direction")),
    constants=(("VEC4", "uv_to_clip"),),
    outputs=(("VEC4", "position_out"), ("VEC4", "direction_out")),
)


def draw(into: target.Target, low: gpu.types.GPUBatch, uv_to_clip: UvToClip) -> None:
    """Clear `into` (two RGBA32F) and write positions and unit directions, with alpha 1, on the texels that `low` covers.

    low: batch with attributes uv, position and direction. Directions point away from the surface, with any length.
    """
    compiled = shader.load(PROGRAM)
    with target.drawing(into):
        compiled.bind()
        target.bind(compiled, PROGRAM, uv_to_clip=uv_to_clip)
        low.draw(compiled)
