# SPDX-License-Identifier: GPL-3.0-or-later
"""Ambient occlusion and bent normals: which directions are visible from the point on the high surface.

With the unit normal n and the visibility V(w) of a direction w, 0 to 1:
ambient occlusion = 1 / pi * integral over the hemisphere around n of V(w) dot(n, w) dw,
and the bent normal is the mean of V(w) w. Rays are distributed as dot(n, w), so that both are means over rays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import shader, target
from ..program import Program
from . import reach

if TYPE_CHECKING:
    import gpu

    from ..bake import cast
    from .lattice import Lattice

FADES = ("NONE", "LINEAR", "SMOOTH")
"""How blocked directions become visible with the distance of what blocks them, by the numbers in openness_comp.glsl."""
UNLIMITED = 1e8
"""The length of rays without a limit, in local space."""
FRONTS, BOTH = 1, 3
"""The sides of triangles that block, as in shaders/lib/reach_lib.glsl."""
NO_FLOOR = -1e30

ADD = Program(
    compute="hemisphere/openness_comp.glsl",
    texels=(*reach.TEXELS, *reach.NORMALS),
    images=reach.SUMS,
    constants=(
        ("VEC4", "placed"),
        ("IVEC4", "blocking"),
        *reach.CONSTANTS,
    ),
)
BENT_NORMAL = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="hemisphere/bent_normal_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "sums"), ("RGBA32F", "FLOAT_2D", "normals")),
    constants=(("MAT4", "normal_matrix"), ("FLOAT", "rays"), ("INT", "is_unit")),
    outputs=(("VEC4", "value_out"),),
)


@dataclass(frozen=True)
class Occluders:
    """What blocks rays, and how.

    tables: the triangles; None for those of the surface itself. scale, offset: what takes a point of the surface's space to
    that of `tables`: point * scale + offset; the axes are the same. farthest: rays end here; None for no limit. fade: one of
    FADES; with a limit only. two_sided: backs block too. bias: directions within this angle of the tangent plane are left out,
    in radians. floor: the height z of a plane that blocks rays from above; None for no floor. Lengths are in the surface's
    space.
    """

    tables: cast.Tables | None = None
    scale: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    farthest: float | None = None
    fade: str = "NONE"
    two_sided: bool = False
    bias: float = 0.0
    floor: float | None = None


def add(
    sums: target.Target,
    hits: gpu.types.GPUTexture,
    surface: cast.Tables,
    occluders: Occluders,
    *,
    lattice: Lattice,
    rays: range,
    rows: range,
    is_first: bool,
) -> None:
    """Add rays to `sums` (RGBA32F): xyz has the sum of the visible directions, w of their visibility. As reach.add has it.

    Directions have world axes, as the tables do.
    """
    is_limited = occluders.farthest is not None
    reach.add(
        ADD,
        sums,
        hits,
        surface,
        occluders.tables or surface,
        lattice=lattice,
        rays=rays,
        rows=rows,
        is_first=is_first,
        cone=math.cos(occluders.bias) ** 2,
        surface_normals=surface.normals,
        placed=(*occluders.offset, occluders.scale),
        farthest=occluders.farthest * occluders.scale if is_limited else UNLIMITED,
        free=NO_FLOOR if occluders.floor is None else occluders.floor * occluders.scale + occluders.offset[2],
        blocking=(
            FADES.index(occluders.fade) if is_limited else 0,
            BOTH if occluders.two_sided else FRONTS,
            int(occluders.tables is None),
            0,
        ),
    )


def ambient_occlusion(into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, rays: int) -> None:
    """Write ambient occlusion into `into` (RGBA32F): 0 all blocked, 1 all visible. As reach.mean has it."""
    reach.mean(into, sums, normals, rays, factors=(0.0, 0.0, 0.0, 1.0))


def bent_normals(
    into: target.Target,
    sums: target.Target,
    normals: gpu.types.GPUTexture,
    rays: int,
    normal_matrix: np.ndarray,
    *,
    is_unit: bool = False,
) -> None:
    """Write the mean visible directions into `into` (RGBA32F), shorter than 1, or normalized.

    normal_matrix: (3, 3), applied to the directions, as in cast.look_up. Where all is blocked, the value has the direction of
    the high surface's normal and, without is_unit, a length of about 0. Otherwise as reach.mean has it.
    """
    target.fill(
        into,
        BENT_NORMAL,
        sums=sums.texture,
        normals=normals,
        normal_matrix=shader.mat4(normal_matrix),
        rays=float(rays),
        is_unit=int(is_unit),
    )
