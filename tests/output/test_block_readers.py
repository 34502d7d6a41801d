# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the decoder of blocks against OpenImageIO and Pillow, on random blocks of each mode."""

import numpy as np
import pytest

from addon.blocks import formats
from addon.blocks.decoding import decoded
from tests.support import packed_blocks, pictures


def compared(block_format, tmp_path, seed):
    """Random blocks, our texels, and those of OpenImageIO in its own type."""
    blocks = packed_blocks.random_blocks(block_format.name, seed, 256)
    path = tmp_path / "blocks.dds"
    path.write_bytes(packed_blocks.dds(blocks, block_format.dxgi))
    theirs = pictures.as_stored(path)
    return blocks, decoded(blocks, block_format), theirs[..., : block_format.channels]


@pytest.mark.parametrize("block_format", [formats.BC4, formats.BC5])
def test_one_channel(block_format, tmp_path):
    """Others round to 8 bits: OpenImageIO ((6 a + b + 1) / 7, rounded down), Pillow rounds down."""
    blocks, ours, theirs = compared(block_format, tmp_path, 31)
    assert np.abs(ours * 255 - theirs).max() < 0.9
    down = packed_blocks.pillow(blocks, block_format.dxgi)[..., : block_format.channels]
    np.testing.assert_array_equal(np.floor(ours * 255 + 1e-4), down)


def test_colors(tmp_path):
    blocks, ours, theirs = compared(formats.BC7, tmp_path, 32)
    np.testing.assert_array_equal(np.rint(ours * 255), theirs)
    down = packed_blocks.pillow(blocks, formats.BC7.dxgi)
    assert not ours[-4:].any()
    np.testing.assert_array_equal(np.rint(ours * 255)[:-4], down[:-4])  # where no mode is, Pillow has opaque black


@pytest.mark.parametrize("block_format", [formats.BC6H, formats.BC6H_SIGNED])
def test_floats(block_format, tmp_path):
    _, ours, theirs = compared(block_format, tmp_path, 33)
    assert theirs.dtype == np.float16
    np.testing.assert_array_equal(ours, theirs.astype(np.float32))


def test_floats_as_bytes():
    """Pillow reads floats from 0 to 1 as 8 bits, which it rounds down."""
    blocks = packed_blocks.random_blocks("bc6h", 34, 256)
    ours = np.clip(decoded(blocks, formats.BC6H), 0, 1) * 255
    difference = ours - packed_blocks.pillow(blocks, formats.BC6H.dxgi)[..., :3]
    assert np.abs(difference - 0.55).max() < 0.56
