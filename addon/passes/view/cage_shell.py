# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws a mesh with each point at a place on its ray, in one color."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import shader, target
from ..program import Program

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="view/cage_shell_vert.glsl",
    fragment="view/cage_shell_frag.glsl",
    inputs=(("VEC3", "position"), ("VEC3", "direction"), ("FLOAT", "start")),
    constants=(("MAT4", "view_projection"), ("VEC4", "color"), ("FLOAT", "scale"), ("FLOAT", "offset")),
    outputs=(("VEC4", "color_out"),),
)


def draw(
    batch: gpu.types.GPUBatch,
    view_projection,
    color: tuple[float, float, float, float],
    *,
    scale: float,
    offset: float,
) -> None:
    """Draw into the bound framebuffer each point at the distance start * scale + offset outside the surface.

    batch: attributes position and unit direction, in world space, and start.
    """
    compiled = shader.load(PROGRAM)
    compiled.bind()
    target.bind(compiled, PROGRAM, view_projection=view_projection, color=color, scale=scale, offset=offset)
    batch.draw(compiled)
