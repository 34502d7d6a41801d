# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the encoders of blocks: against an encoder in numpy to the bit, and against what blocks can hold at best."""

import itertools

import numpy as np
import pytest

from addon.blocks.formats import BC4, BC5, Purpose
from addon.passes import block_encoding
from tests.support import angles
from tests.support import block_oracle as oracle

pytestmark = pytest.mark.usefixtures("gpu_context")


def normals(rng, height, width, *, steep=0.3):
    """Unit normals as texels (H, W, 4) float32: some blocks smooth, some with edges, some below the horizon."""
    slopes = np.cumsum(rng.normal(0.0, 0.02, (height, width, 2)), axis=0)
    slopes[:, width // 2 :] += rng.choice([-steep, 0.0, 3.0 * steep], (height, width - width // 2, 2))
    vectors = np.concatenate([slopes, np.ones((height, width, 1))], axis=2)
    vectors[height // 2 :, width // 2 :, 2] = rng.uniform(-0.5, 1.0, (height - height // 2, width - width // 2))
    vectors /= np.linalg.norm(vectors, axis=2, keepdims=True)
    return np.concatenate([0.5 + 0.5 * vectors, np.ones((height, width, 1))], axis=2).astype(np.float32)


def numbers(rng, height, width):
    """Texels (H, W, 4) float32: slopes of all lengths, noise, and blocks of ends and of what lies between them."""
    texels = (
        rng.random((height, width, 4)) * 2.0 ** -rng.integers(0, 12, (1, width, 1)) + rng.random((height, 1, 4)) - 0.3
    )
    texels[:8] = rng.choice([0.0, 1.0, 0.4, 0.6], (8, width, 4))
    texels[:4, :4] = rng.choice([0.0, 0.0005, 0.9994, 1.0], (4, 4, 1))
    texels[8, :4] = np.array([np.nan, np.inf, -np.inf, 1e30])[:, None]
    return texels.astype(np.float32)


def weights_of(rng, height, width):
    """Weights (H, W) float32: blocks with and without texels that count."""
    weights = rng.choice([0.0, 0.01, 0.2, 1.0, 3.0], (height, width)).astype(np.float32)
    weights[:, :4] = 0.0
    return weights


def blocks_by_oracle(texels, block_format, purpose, weights):
    """As block_encoding.encoded."""
    shape = texels.shape[0] // 4, texels.shape[1] // 4, block_format.size
    cut, weights = (
        oracle.tiles(texels),
        oracle.tiles(np.ones(texels.shape[:2], np.float32) if weights is None else weights),
    )
    if block_format == BC5 and purpose == Purpose.NORMAL:
        return oracle.least_angles(cut, weights).reshape(shape)
    return oracle.least_squares(cut, weights, block_format.channels).reshape(shape)


def shown_normals(blocks):
    """The unit normals (B, 16, 3) of blocks of BC5 (R, C, 16)."""
    flat = blocks.reshape(-1, 16)
    plane = np.stack([oracle.decoded(flat[:, part]) for part in (slice(8), slice(8, 16))], axis=-1) * 2.0 - 1.0
    vectors = np.concatenate([plane, np.sqrt(np.maximum(0.0, 1.0 - (plane**2).sum(axis=-1, keepdims=True)))], axis=-1)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("has_weights", [False, True])
@pytest.mark.parametrize(("block_format", "purpose"), [(BC4, Purpose.DATA), (BC5, Purpose.DATA), (BC5, Purpose.NORMAL)])
def test_blocks_equal_those_of_numpy_to_the_bit_seed_1(block_format, purpose, has_weights):
    rng = np.random.default_rng(1)
    texels = normals(rng, 32, 64) if purpose == Purpose.NORMAL else numbers(rng, 32, 64)
    weights = weights_of(rng, 32, 64) if has_weights else None
    found = block_encoding.encoded(texels, block_format, purpose, weights)
    assert np.array_equal(found, blocks_by_oracle(texels, block_format, purpose, weights))


@pytest.mark.parametrize("value", [0.0, 0.25, 0.5, 0.7312, 1.0])
def test_a_block_of_one_value_is_as_near_as_any_block_can_be(value):
    texels = np.full((4, 4, 4), value, np.float32)
    found = oracle.decoded(block_encoding.encoded(texels, BC4, Purpose.DATA)[0])
    ends = np.arange(256)
    possible = [((7 - part) * ends[:, None] + part * ends) / 1785.0 for part in range(8)]
    possible += [((5 - part) * ends[:, None] + part * ends) / 1275.0 for part in range(6)]
    least = min(np.abs(each - value).min() for each in possible)
    assert np.abs(found - np.float32(value)).max() <= least + 1.0 / oracle.ONE


def test_blocks_are_as_good_as_the_best_endpoints_of_all_seed_2():
    """Of values in 40 steps of 1/255, all pairs of endpoints are tried."""
    rng = np.random.default_rng(2)
    texels = np.zeros((4, 64, 4), np.float32)
    texels[..., 0] = (100.0 + 40.0 * rng.random((4, 64))) / 255.0
    cut = oracle.tiles(texels)[..., 0].astype(float)
    found = oracle.decoded(block_encoding.encoded(texels, BC4, Purpose.DATA).reshape(-1, 8))
    least = np.full(len(cut), np.inf)
    for low, high in itertools.combinations(range(90, 150), 2):
        for is_six in (False, True):
            values = oracle.palette(low, high, is_six) / oracle.ONE
            least = np.minimum(least, (np.abs(cut[:, :, None] - values).min(axis=2) ** 2).sum(axis=1))
    squares = ((found - cut) ** 2).sum(axis=1)
    assert (squares > least - 1e-9).all()
    assert squares.mean() < 1.02 * least.mean()


@pytest.mark.parametrize("little", [0.0, 0.02])
def test_texels_that_count_little_do_not_spoil_a_block(little):
    texels = np.full((4, 4, 4), 0.3, np.float32)
    texels[0, :, 0], texels[3, 3, 0] = np.linspace(0.5, 0.51, 4), 0.0
    weights = np.full((4, 4), little, np.float32)
    weights[0] = 1.0
    found, spoiled = (
        oracle.decoded(block_encoding.encoded(texels, BC4, Purpose.DATA, each)[0])[0, :4] for each in (weights, None)
    )
    assert np.abs(found - texels[0, :, 0]).max() < 0.0005
    assert np.abs(spoiled - texels[0, :, 0]).max() > 0.004


def test_normals_have_less_angle_than_with_each_channel_by_itself_seed_3():
    texels = normals(np.random.default_rng(3), 32, 32, steep=1.0)
    truth = oracle.tiles(texels)[..., :3] * 2.0 - 1.0
    squares = [
        ((shown_normals(block_encoding.encoded(texels, BC5, purpose)) - truth) ** 2).sum()
        for purpose in (Purpose.NORMAL, Purpose.DATA)
    ]
    assert squares[0] < 0.99 * squares[1]


def test_the_first_row_is_the_first_and_slabs_are_as_the_whole_seed_4(monkeypatch):
    texels = numbers(np.random.default_rng(4), 24, 16)
    whole = block_encoding.encoded(texels, BC5, Purpose.DATA)
    assert np.array_equal(whole[2:3], block_encoding.encoded(texels[8:12], BC5, Purpose.DATA))
    monkeypatch.setattr(block_encoding, "TEXELS_AT_ONCE", 16 * 8)
    assert np.array_equal(whole, block_encoding.encoded(texels, BC5, Purpose.DATA))


def test_normals_of_a_smooth_surface_keep_more_than_in_8_bits():
    """A part of a ball, as a map of 64 has it."""
    rows, columns = np.mgrid[-1.0:1.0:64j, -1.0:1.0:64j]
    plane = 0.6 * np.stack([columns, rows], axis=2)
    truth = np.concatenate([plane, np.sqrt(1.0 - (plane**2).sum(axis=2, keepdims=True))], axis=2)
    texels = np.concatenate([0.5 + 0.5 * truth, np.ones((64, 64, 1))], axis=2).astype(np.float32)
    blocks = shown_normals(block_encoding.encoded(texels, BC5, Purpose.NORMAL))
    in_8_bits = angles.degrees(angles.decode(np.round(texels * 255.0) / 255.0), truth)
    assert angles.degrees(blocks, oracle.tiles(truth)).mean() < 0.8 * in_8_bits.mean()


def test_normals_below_the_horizon_come_back_on_its_rim_seed_5():
    """A reader makes z from x and y: nothing nearer can be said of them."""
    turn = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi)
    truth = np.array([0.8 * np.cos(turn), 0.8 * np.sin(turn), -0.6])
    texels = np.ones((4, 4, 4), np.float32)
    texels[..., :3] = 0.5 + 0.5 * truth
    found = shown_normals(block_encoding.encoded(texels, BC5, Purpose.NORMAL))
    rim = np.array([np.cos(turn), np.sin(turn), 0.0])
    assert angles.degrees(found, rim).max() < 2.0


@pytest.mark.parametrize("shape", [(6, 8, 4), (8, 5, 4), (0, 8, 4)])
def test_other_sides_are_refused(shape):
    with pytest.raises(ValueError, match="do not fill"):
        block_encoding.encoded(np.zeros(shape, np.float32), BC4, Purpose.DATA)


def test_other_shapes_are_refused():
    for texels, weights in [((4, 4), None), ((4, 4, 3), None), ((4, 4, 4), (4, 8)), ((4, 4, 4), (4, 4, 1))]:
        with pytest.raises(ValueError, match="four channels"):
            block_encoding.encoded(
                np.zeros(texels, np.float32),
                BC4,
                Purpose.DATA,
                None if weights is None else np.ones(weights, np.float32),
            )
