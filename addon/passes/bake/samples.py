# SPDX-License-Identifier: GPL-3.0-or-later
"""Several samples a texel: where they lie, and their mean. Memory does not grow with their number."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import target
from ..program import Program

if TYPE_CHECKING:
    import gpu

ADD = Program(
    compute="bake/accumulate_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), ("INT", "is_first")),
)
AVERAGE = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/average_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "sums"),),
    constants=(("INT", "is_direction"),),
    outputs=(("VEC4", "normal_out"),),
)


_EIGHT = (3, 6, 0, 5, 2, 7, 1, 4)
"""Of all orders of eight rows the one whose means of waves in any direction are nearest to those over the texel."""


def offsets(count: int) -> list[tuple[float, float]]:
    """Where `count` samples, one of bake.settings.SAMPLES, lie in a texel, from its center, in texels.

    No two lie in the same row or column of `count`. One is the center. The others are the Hammersley set, which as it is
    leans to the diagonal, each bit of a number by as much: half of the bits of one coordinate are turned over, so that
    it leans to neither side. Eight have three bits, and an order of their own.
    """
    bits = count.bit_length() - 1
    upright = (1 << bits // 2) - 1
    rows = _EIGHT if count == 8 else [int(f"0{i:0{bits}b}"[:0:-1], 2) ^ upright if bits else 0 for i in range(count)]
    return [((i + 0.5) / count - 0.5, (row + 0.5) / count - 0.5) for i, row in enumerate(rows)]


def add(sums: target.Target, normals: gpu.types.GPUTexture, rows: range, *, is_first: bool) -> None:
    """Add `normals` (RGBA32F; alpha 1 hit, 0 nothing, -1 missed) to `sums` (RGBA32F) in these rows, or start anew."""
    target.dispatch(ADD, sums.width, rows, normals=normals, sums=sums.texture, is_first=int(is_first))


def average(into: target.Target, sums: target.Target, *, is_direction: bool = True) -> None:
    """Write the means of `sums` into `into` (RGBA32F), as if they were one sample; directions are of length one again."""
    target.fill(into, AVERAGE, sums=sums.texture, is_direction=int(is_direction))
