# SPDX-License-Identifier: GPL-3.0-or-later
"""Places several samples per texel, and averages them. Memory does not grow with their number."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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


ROUNDS = (2, 4, 8, 16)
"""How many samples a texel has after the rounds of adaptive samples; the last one takes all."""
UNEVEN = {(4, 8)}
"""Rounds that are left out: no four of the eight samples are spread as evenly in both directions."""
BEND = 4.0
"""How much bends count, compared with steps: most edges of a smooth mesh are bends."""
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


def rounds(count: int) -> list[list[tuple[float, float]]]:
    """The `offsets` of 4 samples or more in the rounds in which adaptive samples take them, with ROUNDS in all.

    The samples of a round come in pairs that lie opposite to each other around the center: their mean is exact for values that
    change linearly. The first pair, and the first two together, are closest to the mean of all samples, for edges in any
    direction, between two values and between two slopes. So is each further pair, with those before it.
    """
    places = offsets(count)
    pairs = _edges(np.array(places))
    pairs = pairs[: count // 2] + pairs[: count // 2 - 1 : -1]
    alone = np.square(pairs).sum(axis=1) / 4.0
    errors = np.square(pairs[:, None] + pairs).sum(axis=2) / 16.0 + alone[:, None]
    np.fill_diagonal(errors, np.inf)
    order = list(np.unravel_index(errors.argmin(), errors.shape))
    while len(order) < len(pairs):
        errors = np.square(pairs[order].sum(axis=0) + pairs).sum(axis=1)
        errors[order] = np.inf
        order.append(errors.argmin())
    order = [i for pair in order for i in (pair, count - 1 - pair)]
    stops = [stop for stop in ROUNDS if stop < count and (stop, count) not in UNEVEN] + [count]
    return [[places[i] for i in order[start:stop]] for start, stop in zip([0, *stops], stops, strict=False)]


def _edges(places: np.ndarray) -> np.ndarray:
    """Steps and bends along lines in many places and directions at places (N, 2), less their means over all: (N, E)."""
    turns = np.linspace(0.0, np.pi, 16, endpoint=False)
    across = places @ np.stack([np.cos(turns), np.sin(turns)])
    beyond = (across[:, :, None] - np.linspace(-0.6, 0.6, 25)).reshape(len(places), -1)
    values = np.concatenate([beyond > 0.0, np.maximum(beyond, 0.0) * BEND], axis=1)
    return values - values.mean(axis=0)


def add(sums: target.Target, normals: gpu.types.GPUTexture, rows: range, *, is_first: bool) -> None:
    """Add `normals` (RGBA32F; alpha 1 hit, 0 empty, -1 missed) to `sums` (RGBA32F) in these rows. is_first: replace them."""
    target.dispatch(ADD, sums.width, rows, normals=normals, sums=sums.texture, is_first=int(is_first))


def average(into: target.Target, sums: target.Target, *, is_direction: bool = True) -> None:
    """Write the means of `sums` into `into` (RGBA32F), in the form of a single sample; directions are normalized again."""
    target.fill(into, AVERAGE, sums=sums.texture, is_direction=int(is_direction))
