# SPDX-License-Identifier: GPL-3.0-or-later
"""Places several samples per texel, and averages them. Memory does not grow with their number."""

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
"""The order of eight rows that averages waves in any direction most accurately, found among all orders."""


def offsets(count: int) -> list[tuple[float, float]]:
    """The positions of `count` samples, one of core.settings.SAMPLES, in a texel, from its center, in texels.

    No two samples share one of the `count` rows or columns. A single sample is at the center. More samples are the
    Hammersley set. Each bit of its numbers shifts samples towards the diagonal by the same amount, so half of the bits of
    one coordinate are inverted to cancel this. Eight samples have three bits, an odd number, and use an order of their own.
    """
    bits = count.bit_length() - 1
    upright = (1 << bits // 2) - 1
    rows = _EIGHT if count == 8 else [int(f"0{i:0{bits}b}"[:0:-1], 2) ^ upright if bits else 0 for i in range(count)]
    return [((i + 0.5) / count - 0.5, (row + 0.5) / count - 0.5) for i, row in enumerate(rows)]


def add(sums: target.Target, normals: gpu.types.GPUTexture, rows: range, *, is_first: bool) -> None:
    """Add `normals` (RGBA32F; alpha 1 hit, 0 empty, -1 missed) to `sums` (RGBA32F) in these rows. is_first: replace them."""
    target.dispatch(ADD, sums.width, rows, normals=normals, sums=sums.texture, is_first=int(is_first))


def average(into: target.Target, sums: target.Target, *, is_direction: bool = True) -> None:
    """Write the means of `sums` into `into` (RGBA32F), in the form of a single sample; directions are normalized again."""
    target.fill(into, AVERAGE, sums=sums.texture, is_direction=int(is_direction))
