# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodes texels in the formats of blocks that GPUs read.

The shaders count in whole numbers, so that each driver makes the same blocks to the bit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..blocks import decoding, tables
from ..blocks.formats import BC4, BC5, BC6H, BC6H_SIGNED, BC7, BY_NAME, SIDE, BlockFormat, Purpose
from . import bc7_encoding, data_texture, target
from . import blender_gpu as gpu
from .shader import Program

_READS = (("RGBA32F", "FLOAT_2D", "texels"), ("R32F", "FLOAT_2D", "weights"))
_WRITES = (("RGBA32UI", "UINT_2D", "blocks", "WRITE"),)
BC4_CHANNELS = Program(
    compute="blocks/bc4_comp.glsl",
    texels=_READS,
    images=_WRITES,
    constants=(("INT", "has_weights"), ("INT", "channels")),
)
BC5_NORMALS = Program(
    compute="blocks/bc5_normal_comp.glsl", texels=_READS, images=_WRITES, constants=(("INT", "has_weights"),)
)
BC6H_COLORS = Program(
    compute="blocks/bc6h_comp.glsl",
    texels=(*_READS, ("RGBA32F", "FLOAT_2D", "modes")),
    images=_WRITES,
    constants=(("INT", "has_weights"), ("INT", "is_signed"), ("INT", "is_linear")),
)
BYTES = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="blocks/bytes_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "blocks"),),
    constants=(("INT", "words"),),
    outputs=(("VEC4", "bytes_out"),),
)
WORD = 4
"""Bytes that are read back as a texel."""
TEXELS_AT_ONCE = 2**20
"""The most texels that are encoded in one dispatch, 16 MiB of floats: a tenth of a second on a slow GPU."""


def encoded(
    texels: np.ndarray, block_format: BlockFormat, purpose: Purpose, weights: np.ndarray | None = None
) -> np.ndarray:
    """The blocks (H / 4, W / 4, bytes) uint8 of a map, those of the top row first.

    Args:
        texels: (H, W, 4) float32, the top row first, with sides that are multiples of 4. What the format cannot store, as
            values below 0 or above 1, becomes the nearest that it can. What is no number becomes 0.
        purpose: what the texels are, as Purpose says it.
        weights: (H, W) float32 from 0 to 1: how much a texel counts. The extremes of a block are those of texels that count.
            None: all count alike.

    Raises ValueError for other shapes, sides that are no multiples of 4, and formats without an encoder.
    """
    if texels.ndim != 3 or texels.shape[2] != 4 or (weights is not None and weights.shape != texels.shape[:2]):
        raise ValueError("A map has four channels, and a weight for each texel.")
    height, width = texels.shape[:2]
    if height % SIDE or width % SIDE or not height or not width:
        raise ValueError(f"Blocks of {SIDE} x {SIDE} texels do not fill {width} x {height}.")
    has_alpha = block_format == BC7 and bool((texels[..., 3] < 1.0).any())
    encode, texels_at_once = _encoder(block_format, purpose, has_alpha)
    out = np.empty((height // SIDE, width // SIDE, block_format.size), np.uint8)
    rows = max(1, texels_at_once // (width * SIDE))
    for first in range(0, len(out), rows):
        some = slice(first * SIDE, (first + rows) * SIDE)
        blocks = target.get("blocks", out.shape[1], len(out[first : first + rows]), "RGBA32UI")
        encode(
            blocks,
            texels=data_texture.image(texels[some]),
            weights=data_texture.image(np.ones((1, 1)) if weights is None else weights[some], "R32F"),
        )
        _read(blocks, out[first : first + rows])
    return out


def compressed(texels: np.ndarray, name: str) -> np.ndarray:
    """What GPUs show of a map that a program compresses itself: 8 bits become blocks with the least squared error of channels.

    Args:
        texels: (H, W, 4) float32 from 0 to 1, row 0 at v = 0, of any size.
        name: of the format, as BlockFormat has it.

    Returns:
        (H, W, 4) float32. Channels that the format lacks are 0, and alpha is 1.
    """
    block_format = BY_NAME[name]
    height, width = texels.shape[:2]
    steps = np.floor(np.clip(texels[::-1], 0.0, 1.0) * np.float32(255) + np.float32(0.5)) / np.float32(255)
    padding = ((0, -height % SIDE), (0, -width % SIDE), (0, 0))
    blocks = encoded(np.pad(steps, padding, mode="edge"), block_format, Purpose.DATA)
    shown = np.zeros((height, width, 4), np.float32)
    shown[..., 3] = 1.0
    shown[..., : block_format.channels] = decoding.decoded(blocks, block_format)[:height, :width][::-1]
    return shown


def _encoder(block_format: BlockFormat, purpose: Purpose, has_alpha: bool) -> tuple[Callable[..., None], int]:
    """What encodes blocks, from textures of texels and weights, and for how many texels at once."""
    if block_format == BC7:
        return partial(bc7_encoding.encode, purpose=purpose, has_alpha=has_alpha), bc7_encoding.TEXELS_AT_ONCE
    if block_format == BC5 and purpose == Purpose.NORMAL:
        return partial(_dispatch, BC5_NORMALS), TEXELS_AT_ONCE
    if block_format in (BC4, BC5):
        return partial(_dispatch, BC4_CHANNELS, channels=block_format.channels), TEXELS_AT_ONCE
    if block_format in (BC6H, BC6H_SIGNED):
        own = {"is_signed": int(block_format.is_signed), "is_linear": int(purpose != Purpose.COLOR)}
        return partial(_dispatch, BC6H_COLORS, modes=data_texture.image(_bc6h_modes()), **own), TEXELS_AT_ONCE
    raise ValueError(f"There is no encoder of {block_format.label}.")


def _bc6h_modes() -> np.ndarray:
    """The modes of BC6H as shaders/blocks/bc6h_comp.glsl reads them, (15, 82, 4) float32.

    Those of one region come first, then those of two, of each the finest first. A row has numbers in two texels, then for
    each bit the value that it is of, 3 end points + channel, or 12, the partition, and the bit of it. The last row has
    the texels of the second region of each partition, as bits, and its anchor.
    """
    ordered = sorted(tables.BC6H_MODES, key=lambda mode: (mode.regions, -mode.precision))
    rows = np.zeros((len(ordered) + 1, 82, 4), np.float32)
    for row, mode in zip(rows, ordered, strict=False):
        row[0] = mode.code, mode.code_bits, mode.precision, mode.is_relative
        row[1, :3] = mode.others
        for name, parts in tables.bc6h_fields(mode).items():
            slot = 12 if name == "p" else 3 * int(name[1]) + "rgb".index(name[0])
            for bits in parts:
                for bit in range(bits.width):
                    row[2 + bits.at + bit - mode.code_bits, :2] = slot, bits.up + bit
    rows[-1, :32, 0] = tables.PARTITIONS[2][:32] @ (1 << np.arange(16))
    rows[-1, :32, 1] = tables.ANCHORS[2][:32, 1]
    return rows


def _dispatch(
    program: Program,
    blocks: target.Target,
    *,
    texels: gpu.types.GPUTexture,
    weights: gpu.types.GPUTexture,
    **others: Any,
) -> None:
    """Run a program that encodes blocks in one go."""
    groups = -(-blocks.width // program.group[0]), -(-blocks.height // program.group[1])
    has_weights = int((weights.width, weights.height) == (texels.width, texels.height))
    bindings = {"blocks": blocks.texture, "texels": texels, "weights": weights, "has_weights": has_weights}
    target.dispatch_groups(program, groups, **bindings, **others)


def _read(blocks: target.Target, out: np.ndarray) -> None:
    """Fill `out` (R, C, bytes) uint8, contiguous, with blocks."""
    rows, columns, size = out.shape
    words = size // WORD
    read = target.get("bytes of blocks", columns * words, rows, "RGBA8")
    target.fill(read, BYTES, blocks=blocks.texture, words=words)
    read.read(out.reshape(rows, columns * words, WORD))
