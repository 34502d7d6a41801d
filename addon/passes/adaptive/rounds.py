# SPDX-License-Identifier: GPL-3.0-or-later
"""In how many rounds each texel takes samples, and the sums of those that take more than the first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .. import target
from ..program import Program
from . import active
from .active import Active

if TYPE_CHECKING:
    import gpu

PROGRAM = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="adaptive/rounds_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "one"), ("RGBA32F", "FLOAT_2D", "other")),
    constants=(("VEC4", "limits"), ("VEC2", "separation"), ("FLOAT", "most")),
    outputs=(("FLOAT", "rounds_out"), ("VEC4", "sum_out")),
)
ADD = Program(
    compute="adaptive/add_active_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    samplers=active.SAMPLERS,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), *active.CONSTANTS),
)
AVERAGE = Program(
    compute="adaptive/average_active_comp.glsl",
    samplers=active.SAMPLERS,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), *active.CONSTANTS),
)
UNLIMITED = 1e30
EMPTY = 255
"""In place of rounds, as in rounds_frag.glsl and stopped_frag.glsl."""
FORMATS = "R8", "RGBA32F"
"""Of the target of `draw`."""


def draw(
    into: target.Target,
    one: gpu.types.GPUTexture,
    other: gpu.types.GPUTexture,
    *,
    offset: tuple[float, float],
    limits: Sequence[float],
) -> np.ndarray:
    """Write into `into` (FORMATS) how many rounds each texel takes part in, and its mean or its sum.

    Returns the rounds (height, width) uint8, EMPTY where both samples found nothing.

    one, other: normals (RGBA32F; alpha 1 hit, 0 empty, -1 missed) of the two samples of the first round. offset: of `one` from
    the center, in texels; the other one is opposite. limits: in degrees, for each round but the last one.

    A texel ends with the first round whose limit is not below its bend: the largest second difference, along a row or a column,
    of the means of both samples, or twice what they differ beyond the slope of these means. It takes part in all rounds where
    not all these samples hit: at borders, and where nothing is known yet. So do EMPTY texels, but for those that
    active.find leaves out.
    """
    squared = [(2.0 * math.radians(limit)) ** 2 for limit in limits]  # sums of two samples are compared
    target.fill(
        into,
        PROGRAM,
        one=one,
        other=other,
        limits=(*squared, *[UNLIMITED] * (4 - len(squared))),
        separation=(2.0 * offset[0], 2.0 * offset[1]),
        most=float(len(limits) + 1),
    )
    needed = np.empty((into.height, into.width, 1), np.uint8)
    into.read(needed)
    return needed[..., 0]


def add(sums: gpu.types.GPUTexture, normals: gpu.types.GPUTexture, some: Active) -> None:
    """Add one more sample of some texels to their sums, the second texture of `draw`."""
    target.dispatch(ADD, normals.width, range(some.rows), sums=sums, normals=normals, **active.bindings(some, normals))


def average(sums: gpu.types.GPUTexture, some: Active) -> None:
    """Replace the sums of some texels by their means, as a single sample has them."""
    target.dispatch(AVERAGE, sums.width, range(some.rows), sums=sums, **active.bindings(some, sums))
