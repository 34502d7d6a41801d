# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts values to the stored map, and fills the margin with the nearest written texels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import shader, target
from ..program import Program
from .margin_search import Nearest

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="margin/margin_fill_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "values"), ("R16I", "INT_2D", "offsets"), ("R32I", "INT_2D", "source_rows")),
    constants=(("INT", "halo"), ("MAT4", "encode"), ("VEC4", "missed")),
    outputs=(("VEC4", "map_out"), ("FLOAT", "state_out")),
)


def draw(
    into: target.Target,
    values: gpu.types.GPUTexture,
    nearest: Nearest,
    *,
    halo: int,
    encode: np.ndarray,
    missed: tuple[float, float, float],
) -> None:
    """Write the map (RGBA32F) and the state of its texels (R8) into `into`, whose row 0 is row `halo` of `values`.

    values: alpha above 0 where a texel was written, below 0 where its ray missed. nearest: what margin_search.search
    returned for `values`. encode: (4, 4), from a value and 1 to red, green and blue. missed: the color of misses.
    """
    target.fill(
        into,
        PROGRAM,
        values=values,
        offsets=nearest.offsets,
        source_rows=nearest.rows,
        halo=halo,
        encode=shader.mat4(encode),
        missed=(*missed, 0.0),
    )
