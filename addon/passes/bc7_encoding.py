# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodes blocks of BC7: one dispatch for each mode, partition and rotation, of which each keeps what is better than before.

The shaders count in whole numbers, so that each driver makes the same blocks to the bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ..blocks import tables
from ..blocks.formats import Purpose
from . import blender_gpu as gpu
from . import data_texture, target
from .shader import Program

_READS = (("RGBA32F", "FLOAT_2D", "texels"), ("R32F", "FLOAT_2D", "weights"), ("RGBA32F", "FLOAT_2D", "table"))
RANK = Program(
    compute="blocks/bc7_partitions_comp.glsl",
    texels=_READS,
    images=(("RGBA32UI", "UINT_2D", "ranked", "WRITE"),),
    constants=(("IVEC4", "how"), ("INT", "first_row")),
)
ENCODE = Program(
    compute="blocks/bc7_mode_comp.glsl",
    texels=(*_READS, ("RGBA32UI", "UINT_2D", "ranked")),
    images=(("RGBA32UI", "UINT_2D", "blocks", "READ WRITE"), ("RGBA32UI", "UINT_2D", "costs", "READ WRITE")),
    constants=(("IVEC4", "shape"), ("IVEC4", "more"), ("IVEC4", "how"), ("INT", "is_first"), ("INT", "first_row")),
)
OWN, SHARED = 1, 2
"""Whether each endpoint ends with a bit of its own, or both of a subset with the same, as in bc7_mode_comp.glsl."""


@dataclass(frozen=True)
class Step:
    """A dispatch of ENCODE.

    Attributes:
        mode: Of BC7.
        rank: Which of the partitions that suit a block best, from 0 to 3.
        rotation: The channel that changes places with alpha, from 1; 0 for none.
        is_turned: Whether colors have the longer indices, in mode 4.
        sweeps: How often each channel of the endpoints is tried a step up and down.
    """

    mode: int
    rank: int = 0
    rotation: int = 0
    is_turned: bool = False
    sweeps: int = 1


_ROTATED = tuple(Step(4, rotation=rotation) for rotation in (1, 2, 3))
_OF_ALL = (Step(6), *(Step(1, rank) for rank in range(4)), Step(3), Step(2))
OPAQUE = {
    Purpose.NORMAL: (*(step for step in _OF_ALL if step.rank < 3), *_ROTATED[:2]),
    Purpose.COLOR: (*_OF_ALL, *_ROTATED),
    Purpose.DATA: (*_OF_ALL, Step(2, 1), Step(0), *_ROTATED),
}
"""The steps for maps without alpha. Mode 5 won nothing beside these on packed maps, and longer indices 0.1 dB. What only packed
maps have won 0.05 dB of normals and 0.01 dB of colors, for a third of the time."""
WITH_ALPHA = (
    *(Step(6), Step(1), Step(1, 1), Step(7), Step(7, 1), Step(4), Step(4, is_turned=True), Step(5)),
    *_ROTATED,
)
"""The steps for maps with alpha."""
TEXELS_AT_ONCE = 2**20
"""The most texels whose steps follow upon each other without a pause: seconds of GPUs without memory of their own."""


@cache
def _packed_tables() -> np.ndarray:
    """(128, 4) int: the texels of the second and third subset as bits, and their anchors; for two subsets, then for three."""
    bits, result = 1 << np.arange(16), np.zeros((128, 4), int)
    for first, subsets in ((0, 2), (64, 3)):
        for subset in range(1, subsets):
            result[first : first + 64, subset - 1] = (tables.PARTITIONS[subsets] == subset) @ bits
            result[first : first + 64, subset + 1] = tables.ANCHORS[subsets][:, subset]
    return result


def encode(
    blocks: target.Target,
    texels: gpu.types.GPUTexture,
    weights: gpu.types.GPUTexture,
    *,
    purpose: Purpose,
    has_alpha: bool,
    steps: tuple[Step, ...] | None = None,
) -> None:
    """Encode blocks of BC7.

    Args:
        blocks: RGBA32UI, a texel for each.
        texels: RGBA32F, the top row first.
        weights: R32F, how much each texel counts; a single texel counts for all.
        purpose: the angle of normals counts as the squares of their differences.
        has_alpha: whether alpha is anything but 1 anywhere. Blocks without alpha have exactly 255 there.
        steps: what is tried; None for OPAQUE or WITH_ALPHA.
    """
    columns, rows = blocks.width, blocks.height
    costs = target.get("costs of blocks", columns, rows, "RGBA32UI")
    common = {"texels": texels, "weights": weights, "table": data_texture.upload_numbers(*_packed_tables().T)}
    is_color = int(purpose == Purpose.COLOR)
    # All ranks come first: in Mesa's zink, compute shaders that take turns may get the textures of an earlier call.
    steps = steps or (WITH_ALPHA if has_alpha else OPAQUE[purpose])
    ranked: dict[tuple[int, int], target.Target] = {}
    for mode in (tables.BC7_MODES[step.mode] for step in steps):
        partitions = mode.subsets, 1 << mode.partition_bits
        if partitions not in ranked:
            ranked[partitions] = target.get(
                "partitions of {} subsets, {}".format(*partitions), columns, rows, "RGBA32UI"
            )
            if mode.subsets > 1:
                how = is_color, int(has_alpha), 64 * (mode.subsets - 2), partitions[1]
                target.dispatch(RANK, columns, range(rows), ranked=ranked[partitions].texture, how=how, **common)
    for number, step in enumerate(steps):
        mode = tables.BC7_MODES[step.mode]
        kind = OWN * (mode.own_lowest > 0) + SHARED * (mode.shared_lowest > 0)
        index_bits = mode.index_bits, mode.second_index_bits
        if step.is_turned:
            index_bits = index_bits[::-1]
        color_bits = mode.color_bits + (kind > 0)
        alpha_bits = mode.alpha_bits and mode.alpha_bits + (kind > 0)
        target.dispatch(
            ENCODE,
            columns,
            range(rows),
            ranked=ranked[mode.subsets, 1 << mode.partition_bits].texture,
            blocks=blocks.texture,
            costs=costs.texture,
            shape=(mode.number, mode.subsets, color_bits, alpha_bits),
            more=(kind, *index_bits, step.rank),
            how=(is_color, int(has_alpha), step.rotation, step.sweeps),
            is_first=int(number == 0),
            **common,
        )
