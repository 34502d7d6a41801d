# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays that start later than others: below their hits, or below the low surface."""

from __future__ import annotations

from .. import target
from ..program import Program

PROGRAM = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="audit/later_rays_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(
        ("RGBA32UI", "UINT_2D", "hits"),
        ("RGBA32F", "FLOAT_2D", "positions"),
        ("RGBA32F", "FLOAT_2D", "directions"),
    ),
    constants=(("FLOAT", "gap"), ("INT", "from_hits")),
    outputs=(("VEC4", "position_out"), ("VEC4", "direction_out")),
)


def draw(into: target.Target, rays: target.Target, hits: target.Target, gap: float, *, from_hits: bool) -> None:
    """Write into `into` (two RGBA32F) the same rays as in `rays`, as rays.draw writes them, but with later starts.

    They start `gap` below their `hits`, as cast.trace writes them, and texels whose ray hit nothing have no ray. Without
    `from_hits`, they start `gap` below the low surface.
    """
    target.fill(
        into,
        PROGRAM,
        hits=hits.texture,
        positions=rays.textures[0],
        directions=rays.textures[1],
        gap=gap,
        from_hits=int(from_hits),
    )
