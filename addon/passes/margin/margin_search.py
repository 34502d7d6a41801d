# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the nearest written texel of each texel, exactly, in two passes whose cost does not grow with the distance.

A. Meijster, J. Roerdink and W. Hesselink, "A general algorithm for computing distance transforms in linear time" (2000):
the first pass searches along rows, the second searches the results along columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .. import blender_gpu as gpu
from .. import shader, target
from ..program import Program

GROUP = 64
ROWS = Program(
    compute="margin/margin_rows_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "values"),),
    constants=(("INT", "farthest"),),
    images=(("R16I", "INT_2D", "offsets", "WRITE"),),
    group=(GROUP, 1),
)
COLUMNS = Program(
    compute="margin/margin_columns_comp.glsl",
    texels=(("R16I", "INT_2D", "offsets"),),
    constants=(("INT", "reach"),),
    images=(("R32I", "INT_2D", "source_rows", "READ WRITE"),),
    group=(GROUP, 1),
)


@dataclass(frozen=True)
class Nearest:
    """The nearest written texel of each texel: `rows` (R32I) holds its row, and `offsets` (R16I), in that row, the number of
    columns to it. 32767 means none in reach."""

    offsets: gpu.types.GPUTexture
    rows: gpu.types.GPUTexture


def search(values: gpu.types.GPUTexture, reach: int | None) -> Nearest:
    """Find the nearest texel of `values` (RGBA32F) whose alpha is above 0, for each texel with one in reach.

    reach: in texels, along rows and along columns, so that a margin of 2^n - 1 fills every block of 2^n x 2^n texels that
    contains a written one; None for no limit.
    """
    width, height = values.width, values.height
    reach = max(width, height) if reach is None else min(reach, max(width, height))
    offsets = target.get("margin's offsets", width, height, "R16I").texture
    rows = target.get("margin's rows", width, height, "R32I").texture
    _dispatch(ROWS, height, values=values, farthest=farthest(reach), offsets=offsets)
    _dispatch(COLUMNS, width, offsets=offsets, reach=reach, source_rows=rows)
    return Nearest(offsets, rows)


def farthest(reach: int) -> int:
    """The largest distance, in whole texels, of the nearest written texel along a row or column: the radius of the circle
    through the corners of the square of `reach`."""
    return math.isqrt(2 * reach * reach)


def _dispatch(program: Program, count: int, **bindings) -> None:
    compiled = shader.load(program)
    compiled.bind()
    target.bind(compiled, program, **bindings)
    gpu.compute.dispatch(compiled, -(-count // GROUP), 1, 1)
