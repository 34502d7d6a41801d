# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the encoder of floats: against an encoder in numpy to the bit, and by what is read back."""

import numpy as np
import pytest

from addon.blocks import tables
from addon.blocks.decoding import decoded
from addon.blocks.formats import BC6H, BC6H_SIGNED, Purpose
from addon.passes import block_encoding
from tests.support import float_block_oracle as oracle
from tests.support.block_oracle import tiles

pytestmark = pytest.mark.usefixtures("gpu_context")


def colors(rng, height, width):
    """Texels (H, W, 4) float32: from even blocks to blocks across all halfs, with edges, zeros and signs."""
    of_blocks = (height // 4, width // 4, 4)
    spread = 2.0 ** (rng.integers(-11, 3, (*of_blocks[:2], 1)) + rng.choice([-0.7, 0.7], of_blocks))
    spread, middle = (each.repeat(4, 0).repeat(4, 1) for each in (spread, rng.uniform(-9, 9, of_blocks)))
    texels = np.exp2(rng.uniform(-1, 1, (height, width, 4)) * spread + middle)
    texels[: height // 4] *= rng.choice([-1.0, 1.0], (height // 4, width, 4))
    slope = np.linspace(-1, 1, 4 * width).reshape(width, 4) + np.linspace(0, 0.2, 8)[:, None, None]
    texels[-8:] = slope * np.where(np.arange(width) % 7 < 3, 1, 30)[:, None]
    texels[:4, :8] = 0.25
    texels[:4, 8:12] = rng.choice([0.0, 1e-7, 3e-5, 65504.0, 1e9, np.inf, np.nan, 6e-8], (4, 4, 4))
    return texels.astype(np.float32)


def weights_of(rng, height, width):
    """Weights (H, W) float32: blocks with and without texels that count."""
    weights = rng.choice([0.0, 0.01, 0.3, 1.0, 1.0], (height, width)).astype(np.float32)
    weights[:, :4] = 0.0
    weights[:, 4:8] *= np.arange(4) < 2
    return weights


def assert_equal_blocks(rng, block_format, purpose, width, has_weights):
    """The blocks of random texels, which are those of the encoder in numpy."""
    texels = colors(rng, 32, width)
    weights = weights_of(rng, 32, width) if has_weights else None
    found = block_encoding.encoded(texels, block_format, purpose, weights)
    given = tiles(np.ones((32, width), np.float32) if weights is None else weights)
    is_linear = purpose == Purpose.DATA
    expected = oracle.encoded(tiles(texels[..., :3]), given, block_format.is_signed, is_linear)
    assert np.array_equal(found.reshape(-1, 16), expected)
    return found


def test_blocks_of_all_modes_equal_those_of_numpy_to_the_bit_seed_1():
    found = [
        assert_equal_blocks(np.random.default_rng(1), block_format, purpose, 64, has_weights=False)
        for block_format in (BC6H, BC6H_SIGNED)
        for purpose in (Purpose.COLOR, Purpose.DATA)
    ]
    assert {mode.code for mode in tables.BC6H_MODES} == set(codes(np.array(found)).ravel().tolist())


@pytest.mark.parametrize(("block_format", "purpose"), [(BC6H, Purpose.DATA), (BC6H_SIGNED, Purpose.COLOR)])
def test_blocks_with_weights_equal_those_of_numpy_to_the_bit_seed_6(block_format, purpose):
    assert_equal_blocks(np.random.default_rng(6), block_format, purpose, 32, has_weights=True)


def codes(blocks):
    """The mode of each block (R, C), as its first bits."""
    low = blocks[..., 0] & 31
    return np.where(low & 3 < 2, low & 3, low)


@pytest.mark.parametrize("block_format", [BC6H, BC6H_SIGNED])
def test_a_block_of_one_color_is_the_nearest_half_seed_2(block_format):
    rng = np.random.default_rng(2)
    halfs = rng.integers(0, 31744, (8, 16, 4)).astype(np.uint16).view(np.float16).astype(np.float32)
    halfs *= rng.choice([-1.0, 1.0], halfs.shape) if block_format.is_signed else 1.0
    found = decoded(block_encoding.encoded(halfs.repeat(4, 0).repeat(4, 1), block_format, Purpose.DATA), block_format)
    assert np.array_equal(found, halfs[..., :3].repeat(4, 0).repeat(4, 1))


def test_two_colors_are_as_near_as_ends_of_ten_bits_seed_3():
    """Whatever lies between both, a mode of one region has ends that are at most 15.5 steps of halfs away."""
    rng = np.random.default_rng(3)
    steps = rng.integers(0, 31744, (2, 8, 8, 4)).repeat(4, 1).repeat(4, 2)
    steps = np.where(rng.random((32, 32, 1)) < 0.5, *steps).astype(np.uint16)
    texels = steps.view(np.float16).astype(np.float32)
    found = decoded(block_encoding.encoded(texels, BC6H, Purpose.COLOR), BC6H)
    off = np.abs(found.astype(np.float16).view(np.uint16).astype(int) - steps[..., :3])
    assert off.max() <= 16


def test_purposes_keep_what_they_say_seed_4():
    """The squares of differences of values for data, of their logarithms for colors."""
    rng = np.random.default_rng(4)
    texels = np.exp2(rng.normal(0, 1, (64, 64, 4))).astype(np.float32)
    data, color = (
        decoded(block_encoding.encoded(texels, BC6H, purpose), BC6H) for purpose in (Purpose.DATA, Purpose.COLOR)
    )
    truth = texels[..., :3]
    assert ((data - truth) ** 2).mean() < 0.7 * ((color - truth) ** 2).mean()
    assert (np.log2(color / truth) ** 2).mean() < 0.8 * (np.log2(data / truth) ** 2).mean()


def test_two_surfaces_have_a_region_each_seed_5():
    """Red to black beside black to blue: no line has both, two regions do."""
    rng = np.random.default_rng(5)
    texels = np.zeros((16, 16, 4), np.float32)
    ramp = np.linspace(1, 1.4, 4, dtype=np.float32)[:, None]
    texels[..., 0], texels[..., 2] = 1.2, np.tile(ramp, (4, 16))
    texels[:, np.arange(16) % 4 > 1, :3] = texels[:, np.arange(16) % 4 > 1, :3][..., ::-1] * np.float32(1.05)
    texels *= rng.uniform(0.99, 1.01, texels.shape)
    blocks = block_encoding.encoded(texels, BC6H, Purpose.COLOR)
    two = [mode.code for mode in tables.BC6H_MODES if mode.regions == 2]
    assert np.isin(codes(blocks), two).all()
    assert (np.abs(decoded(blocks, BC6H) - texels[..., :3]) <= 0.04 * texels[..., :3]).all()


def test_texels_that_do_not_count_do_not_spoil_a_block():
    texels = np.full((4, 4, 4), 7.0, np.float32)
    texels[0] = 0.5
    weights = np.zeros((4, 4), np.float32)
    weights[0] = 0.1
    found = decoded(block_encoding.encoded(texels, BC6H, Purpose.COLOR, weights), BC6H)
    assert (found[0] == 0.5).all()


def test_what_the_format_lacks_becomes_the_nearest():
    texels = np.array([-3.0, np.nan, 0.0, 70000.0, np.inf, -np.inf], np.float32)
    texels = np.broadcast_to(texels[:, None, None], (6, 4, 4)).repeat(4, 0)
    for block_format, expected in ((BC6H, [0, 0, 0, 65504, 65504, 0]), (BC6H_SIGNED, [-3, 0, 0, 65504, 65504, -65504])):
        found = decoded(block_encoding.encoded(texels, block_format, Purpose.DATA), block_format)
        assert found[::4, 0, 0].tolist() == expected


def test_floats_between_two_halfs_become_the_nearest_or_the_even_one():
    steps = np.array([1.5, 2.5, 3.49, 1023.5, 1024.5, 1025.5, 15360.5, 15361.5, 31742.5, 0.5, 0.51, 1e-9])
    ends = np.floor(steps).astype(np.uint16), np.floor(steps + 1).astype(np.uint16)
    low, high = (each.view(np.float16).astype(np.float64) for each in ends)
    values = (low + (high - low) * (steps % 1)).astype(np.float32)
    texels = np.broadcast_to(values[:, None, None], (len(values), 4, 4)).repeat(4, 0)
    found = decoded(block_encoding.encoded(texels, BC6H, Purpose.DATA), BC6H)[::4, 0, 0]
    assert found.tolist() == values.astype(np.float16).astype(float).tolist()
