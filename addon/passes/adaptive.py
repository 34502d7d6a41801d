# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive samples: how many each texel takes, their sums, and passes that run on some texels alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import blender_gpu as gpu
from . import data_texture, target
from .program import Program

STOPPED = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="adaptive/stopped_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "rounds"), ("FLOAT_2D", "covered")),
    constants=(("FLOAT", "number"), ("INT", "covered_side")),
    outputs=(("FLOAT", "nothing_out"),),
)
NOTHING = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="adaptive/nothing_frag.glsl",
    inputs=(("VEC2", "position"),),
    outputs=(("VEC4", "nothing_out"),),
)
ACTIVE_SAMPLERS = (("FLOAT_2D", "active_texels"),)
ACTIVE_CONSTANTS = (("INT", "active_count"),)
"""What a Program declares that takes its texels with shaders/lib/active_lib.glsl."""
BLOCK = 8
"""The side of a workgroup, as in active_lib.glsl."""
COVERED = 4
"""The side of the squares in which empty texels can be left out."""


@dataclass(frozen=True)
class Active:
    """Some texels of a map.

    stopped: depth, in which all other texels are drawn. texels: the list. count: its length. rows: of workgroups as wide as the
    map, times their side, that work on the list. blocks (rows, columns) bool: which squares of BLOCK texels have some of them.
    """

    stopped: gpu.types.GPUTexture
    texels: gpu.types.GPUTexture
    count: int
    rows: int
    blocks: np.ndarray


def clear_active(into: target.Target, some: Active, slot: int = 0) -> None:
    """Set these texels of a texture of `into` (RGBA32F) to 0. Clearing all of it takes longer than to draw few."""
    only = target.Target.of(into.width, into.height, into.formats[slot], into.textures[slot])
    target.fill(only, NOTHING, stopped=some.stopped)


def upload_covered(covered: np.ndarray) -> gpu.types.GPUTexture:
    """Squares (rows, columns) bool of COVERED texels, as `find` takes them."""
    values = np.ascontiguousarray(covered, np.float32)
    return gpu.types.GPUTexture(values.shape[::-1], format="R8", data=gpu.types.Buffer("FLOAT", values.shape, values))


def find_active(
    rounds: gpu.types.GPUTexture, needed: np.ndarray, number: int, covered: gpu.types.GPUTexture | None = None
) -> Active | None:
    """The texels that take samples in round `number`, counted from 1; None if there are none. Valid until the next call.

    rounds: what rounds.draw wrote. needed: the same (height, width) uint8, less what `covered` leaves out. covered: from
    `upload_covered`: empty texels outside of these squares take no more samples; None if there are none.
    """
    height, width = needed.shape
    listed, blocks = in_blocks(needed >= number)
    if not len(listed):
        return None
    pairs = np.zeros((-(-len(listed) // 2) * 2, 2), np.float32)
    pairs[: len(listed)] = listed
    groups, across = -(-len(listed) // BLOCK**2), -(-width // BLOCK)
    bound = {"rounds": rounds, "number": float(number), "covered": covered or rounds, "covered_side": COVERED}
    depth = target.get("stopped texels", width, height, "R8", "DEPTH_COMPONENT32F")
    target.fill(depth, STOPPED, clear=True, writes_depth=True, **bound)
    texels = data_texture.upload(pairs.reshape(-1, 4))
    return Active(depth.textures[1], texels, len(listed), -(-groups // across) * BLOCK, blocks)


def active_bindings(some: Active | None, unused: gpu.types.GPUTexture) -> dict:
    """What a Program with SAMPLERS and CONSTANTS is bound to. some: None for all texels; then `unused` is any texture."""
    return {"active_texels": some.texels if some else unused, "active_count": some.count if some else -1}


def in_blocks(is_active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The places (N, 2) int of the texels, x and y, square by square: texels of a workgroup are close to each other. And which
    squares have some, as Active has them."""
    height, width = is_active.shape
    across, up = -(-width // BLOCK), -(-height // BLOCK)
    padded = is_active
    if (up * BLOCK, across * BLOCK) != (height, width):
        padded = np.zeros((up * BLOCK, across * BLOCK), bool)
        padded[:height, :width] = is_active
    ordered = padded.reshape(up, BLOCK, across, BLOCK).transpose(0, 2, 1, 3)
    lanes = np.flatnonzero(ordered)
    blocks = np.zeros(up * across, bool)
    block, inner = np.divmod(lanes, BLOCK**2)
    y, x = np.divmod(block, across)
    blocks[block] = True
    places = np.stack([x * BLOCK + inner % BLOCK, y * BLOCK + inner // BLOCK], axis=1)
    return places, blocks.reshape(up, across)


if TYPE_CHECKING:
    import gpu

ROUNDS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="adaptive/rounds_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "one"), ("RGBA32F", "FLOAT_2D", "other")),
    constants=(("VEC4", "limits"), ("VEC2", "separation"), ("FLOAT", "most")),
    outputs=(("FLOAT", "rounds_out"), ("VEC4", "sum_out")),
)
ADD_SAMPLE = Program(
    compute="adaptive/add_active_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    samplers=ACTIVE_SAMPLERS,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), *ACTIVE_CONSTANTS),
)
AVERAGE_SAMPLES = Program(
    compute="adaptive/average_active_comp.glsl",
    samplers=ACTIVE_SAMPLERS,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), *ACTIVE_CONSTANTS),
)
UNLIMITED = 1e30
EMPTY = 255
"""In place of rounds, as in rounds_frag.glsl and stopped_frag.glsl."""
ROUND_FORMATS = "R8", "RGBA32F"
"""Of the target of `draw`."""


def draw_rounds(
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
        ROUNDS,
        one=one,
        other=other,
        limits=(*squared, *[UNLIMITED] * (4 - len(squared))),
        separation=(2.0 * offset[0], 2.0 * offset[1]),
        most=float(len(limits) + 1),
    )
    needed = np.empty((into.height, into.width, 1), np.uint8)
    into.read(needed)
    return needed[..., 0]


def add_sample(sums: gpu.types.GPUTexture, normals: gpu.types.GPUTexture, some: Active) -> None:
    """Add one more sample of some texels to their sums, the second texture of `draw`."""
    target.dispatch(
        ADD_SAMPLE, normals.width, range(some.rows), sums=sums, normals=normals, **active_bindings(some, normals)
    )


def average_samples(sums: gpu.types.GPUTexture, some: Active) -> None:
    """Replace the sums of some texels by their means, as a single sample has them."""
    target.dispatch(AVERAGE_SAMPLES, sums.width, range(some.rows), sums=sums, **active_bindings(some, sums))
