# SPDX-License-Identifier: GPL-3.0-or-later
"""Curvature: the share of a ball around the point on the high surface that is inside the solid.

H. Pottmann and others, "Integral invariants for robust geometry processing" (2009). With the radius R of the ball, the length s
of a ray into the solid until it leaves it, and the length t of a ray outwards until it enters again, the share is
f = 1/2 * (mean of min(s, R)^3 / R^3 + mean of 1 - min(t, R)^3 / R^3), over all directions of each half of the ball.
On a sphere of radius r, f = 1/2 - 3 R / (16 r). The value is 1/2 + 2 * (1/2 - f): 0.5 on a plane, 1 on a convex edge of 90
degrees, 0 on a concave one.
"""

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
    compute="hemisphere/curvature_comp.glsl",
    texels=(*reach.TEXELS, *reach.NORMALS),
    images=reach.SUMS,
    constants=reach.CONSTANTS,
)


def add(
    sums: target.Target,
    hits: gpu.types.GPUTexture,
    surface: cast.Tables,
    *,
    radius: float,
    lattice: Lattice,
    rays: range,
    rows: range,
    is_first: bool,
) -> None:
    """Add pairs of rays to `sums` (RGBA32F): x has the sum of what the inner half of the ball lacks, y of what the outer holds.

    radius: of the ball, in local space. As reach.add has it.
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
        farthest=radius,
    )


def values(into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, rays: int) -> None:
    """Write curvature into `into` (RGBA32F): 0.5 flat, above it convex, below it concave. As reach.mean has it."""
    reach.mean(into, sums, normals, rays, factors=(1.0, -1.0, 0.0, 0.0), base=0.5)


def convexity(into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, rays: int) -> None:
    """Write max(0, 2 * curvature - 1) into `into` (RGBA32F): 1 on a convex edge of 90 degrees. As reach.mean has it."""
    reach.mean(into, sums, normals, rays, factors=(2.0, -2.0, 0.0, 0.0), lowest=0.0)


def cavity(into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, rays: int) -> None:
    """Write max(0, 1 - 2 * curvature) into `into` (RGBA32F): 1 on a concave edge of 90 degrees. As reach.mean has it."""
    reach.mean(into, sums, normals, rays, factors=(-2.0, 2.0, 0.0, 0.0), lowest=0.0)


def mean_curvature_scale(radius: float) -> float:
    """The factor on (curvature - 0.5) that gives the mean curvature H, in 1 / the unit of `radius`, on smooth surfaces."""
    return 8.0 / 3.0 / radius
