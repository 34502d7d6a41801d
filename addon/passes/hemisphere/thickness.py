# SPDX-License-Identifier: GPL-3.0-or-later
"""Thickness: how far rays go from the high surface into the solid before they leave it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import target
from ..program import Program
from . import reach

if TYPE_CHECKING:
    import gpu

    from ..bake import cast
    from .lattice import Lattice

ADD = Program(
    compute="hemisphere/thickness_comp.glsl",
    texels=(*reach.TEXELS, *reach.NORMALS),
    images=reach.SUMS,
    constants=reach.CONSTANTS,
)


def add(
    sums: target.Target,
    hits: gpu.types.GPUTexture,
    surface: cast.Tables,
    *,
    farthest: float,
    lattice: Lattice,
    rays: range,
    rows: range,
    is_first: bool,
) -> None:
    """Add rays to `sums` (RGBA32F): x has the sum of their lengths inside the solid, as shares of `farthest`, at most 1.

    farthest: in local space. Rays are distributed as the cosine to the inward normal; they end at the first triangle that they
    meet from behind. As reach.add has it.
    """
    reach.add(
        ADD,
        sums,
        hits,
        surface,
        surface,
        lattice=lattice,
        rays=rays,
        rows=rows,
        is_first=is_first,
        surface_normals=surface.normals,
        farthest=farthest,
    )


def values(into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, rays: int) -> None:
    """Write thickness into `into` (RGBA32F): 0 thin, 1 at least `farthest` in all directions. As reach.mean has it."""
    reach.mean(into, sums, normals, rays, factors=(1.0, 0.0, 0.0, 0.0))
