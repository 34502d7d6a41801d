# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs compute shaders that walk trees, each dispatch with few turns of their loops, until no texel is left unfinished.

Drivers in software end all loops of a shader after 65,535 turns, in silence, and others take a long dispatch for a hang. So a
lane that has no turns left marks its texel (shaders/lib/turns_lib.glsl). Only if there are such texels, further dispatches go
on with them, exactly where they were: first from the beginning, since the one for all texels keeps nothing but the mark.
"""

from __future__ import annotations

import numpy as np

from ..core.progress import SLICE_ROWS
from . import target
from .shader import Program

CARRIED = (("RGBA32UI", "UINT_2D", "carried", "READ WRITE"),)
"""What a Program declares that `dispatch` runs, beside first_row."""
ALL, BEGIN, GO_ON = range(3)
"""The stages of shaders/lib/carried_lib.glsl."""
LANES = 2**16
"""The most lanes whose state is kept at once: with up to 80 bytes each, 5 MiB."""
MOST_ROWS = 2**10
"""Of these lanes, so that each GPU has such textures."""
_LEFT = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="lib/carried_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "carried"),),
    outputs=(("VEC4", "left_out"),),
)


def dispatch(program: Program, again: Program, width: int, rows: range, *, parts: int, **bindings) -> None:
    """As target.dispatch, until all texels are finished, which it waits for.

    again: what goes on with texels that `program` has left; it may be the same. parts: the texels that a lane has in `carried`
    while it is unfinished.
    """
    if not _leaves(program, width, rows, stage=ALL, carried=target.get("unfinished", 1, 1, "RGBA32UI"), **bindings):
        return
    across = -(-width // SLICE_ROWS) * SLICE_ROWS
    most = max(SLICE_ROWS, min(LANES // across, MOST_ROWS, len(rows) + SLICE_ROWS - 1) // SLICE_ROWS * SLICE_ROWS)
    carried = target.get("carried", across, most * parts + 1, "RGBA32UI")
    for start in range(rows.start, rows.stop, most):
        some, stage = range(start, min(start + most, rows.stop)), BEGIN
        while _leaves(again, width, some, stage=stage, carried=carried, **bindings):
            stage = GO_ON


def _leaves(program: Program, width: int, rows: range, *, stage: int, carried: target.Target, **bindings) -> bool:
    """Run a stage. Returns whether it left texels unfinished."""
    row = rows.start + stage  # rows start at multiples of SLICE_ROWS
    left, texel = target.get("left", 1, 1, "RGBA32F"), np.empty((1, 1, 4), np.float32)
    with target.limited_to(range(1), range(1)):
        target.clear(carried)
        target.dispatch(program, width, range(row, row + len(rows)), carried=carried.texture, **bindings)
        target.fill(left, _LEFT, carried=carried.texture)
    left.read(texel)
    return bool(texel[0, 0, 0] == 1.0)
