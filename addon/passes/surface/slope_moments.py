# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums the slopes of normals and their products over samples, and widens roughness by their variance."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import target
from ..program import Program

if TYPE_CHECKING:
    import gpu

ADD = Program(
    compute="surface/slope_moments_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "normals"), ("RGBA32F", "FLOAT_2D", "directions")),
    images=(("RGBA32F", "FLOAT_2D", "squares", "READ WRITE"), ("RGBA32F", "FLOAT_2D", "products", "READ WRITE")),
    constants=(("INT", "first_row"), ("INT", "is_first"), ("INT", "has_directions")),
)
WIDEN = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="surface/widened_roughness_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(
        ("RGBA32F", "FLOAT_2D", "normals"),
        ("RGBA32F", "FLOAT_2D", "squares"),
        ("RGBA32F", "FLOAT_2D", "products"),
        ("RGBA32F", "FLOAT_2D", "roughness"),
    ),
    outputs=(("VEC4", "value_out"),),
)


def add(
    sums: target.Target,
    normals: gpu.types.GPUTexture,
    directions: gpu.types.GPUTexture | None,
    *,
    is_first: bool,
) -> None:
    """Add one sample of each texel to the second moments in `sums` (two RGBA32F): x x, y y, z z, count; x y, y z, z x.

    They are those of the unit `normals` (RGBA32F; alpha 1 hit, 0 empty, -1 missed), stretched to a height of 1 above the low
    surface, so that x and y of tangent space are slopes. directions: the low surface's normals in their space (RGBA32F); None
    for tangent space. is_first: replace what the sums held.
    """
    target.dispatch(
        ADD,
        sums.width,
        range(sums.height),
        normals=normals,
        directions=directions or normals,
        squares=sums.textures[0],
        products=sums.textures[1],
        is_first=int(is_first),
        has_directions=int(directions is not None),
    )


def widen(
    into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, roughness: gpu.types.GPUTexture
) -> None:
    """Write perceptual roughness into `into` (RGBA32F; alpha 1 known, 0 empty, -1 missed), the same in three channels.

    alpha' ^ 2 = alpha ^ 2 + the variances of both slopes, where alpha is the square of `roughness` (RGBA32F), and slopes are
    those against the mean normal. sums: of `add`. normals: the only sample, or the sum of all.
    """
    target.fill(into, WIDEN, normals=normals, squares=sums.textures[0], products=sums.textures[1], roughness=roughness)
