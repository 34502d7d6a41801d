# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds which blocks of a map show which materials, so that a pass over one image runs only where the image is.

Software drivers run all of a compute shader for every texel, also where its conditions do not hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import data_texture, target
from ..program import Program
from .material_table import MaterialTable

if TYPE_CHECKING:
    import gpu

FIND = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="surface/served_blocks_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "hits"), ("RGBA32F", "FLOAT_2D", "labels")),
    outputs=(("VEC4", "materials_out"),),
)
BLOCK = 32
"""Texels. As in shaders/lib/served_lib.glsl; workgroups are 8 x 8."""
BITS = 24
"""The whole numbers that a float holds exactly have so many bits."""


@dataclass(frozen=True)
class Blocks:
    """masks (rows, columns, 4) int: the materials that each block shows, material m in bit m % 96, by 24 bits."""

    masks: np.ndarray

    def serving(self, materials: MaterialTable, number: int) -> np.ndarray:
        """The columns and rows (N, 2) of the blocks that may show a material with the feed of this number."""
        wanted = np.zeros(4, np.int64)
        bits = np.flatnonzero(materials.feeds == number) % (BITS * 4)
        np.bitwise_or.at(wanted, bits // BITS, 1 << bits % BITS)
        return np.argwhere((self.masks & wanted).any(axis=-1))[:, ::-1]


def find(hits: target.Target, labels: gpu.types.GPUTexture) -> Blocks:
    """The blocks of a map, from its `hits` (RGBA32UI). labels: as in plain_values.add_constants. Waits for the GPU."""
    rows, columns = -(-hits.height // BLOCK), -(-hits.width // BLOCK)
    shown = target.Target(columns, rows, ("RGBA32F",))
    target.fill(shown, FIND, hits=hits.texture, labels=labels)  # drawn: Target.read does not wait for compute shaders
    masks = np.empty((rows, columns, 4), np.float32)
    shown.read(masks)
    return Blocks(masks.astype(np.int64))


def every(width: int, height: int) -> Blocks:
    """All blocks of a map, whatever they show."""
    return Blocks(np.full((-(-height // BLOCK), -(-width // BLOCK), 4), 2**BITS - 1))


def dispatch(
    program: Program, size: tuple[int, int], blocks: Blocks | None, materials: MaterialTable, number: int, **bindings
) -> None:
    """Run `program` on the blocks that may show a material with the feed of this number. size: of the map."""
    served = (blocks or every(*size)).serving(materials, number)
    if len(served):
        listed = data_texture.upload(np.pad(served, ((0, 0), (0, 1))).astype(np.float32))
        target.dispatch_groups(
            program,
            ((BLOCK // program.group[0]) ** 2, len(served)),
            blocks=listed,
            materials=materials.texture,
            feed=number,
            **bindings,
        )
