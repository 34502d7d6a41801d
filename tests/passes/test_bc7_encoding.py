# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the encoder of BC7: against numpy to the bit, against the decoder, and against what blocks can hold at best."""

import dataclasses

import numpy as np
import pytest

from addon.blocks.decoding import decoded
from addon.blocks.formats import BC7, Purpose
from addon.passes import bc7_encoding, block_encoding
from addon.passes.bc7_encoding import Step
from tests.support import bc7_encoder

pytestmark = pytest.mark.usefixtures("gpu_context")

FIRST = (
    Step(1, 3),
    Step(3, 2),
    Step(2),
    Step(0, 1),
    Step(4, 0, 1),
    Step(4, 0, 2, True),
    Step(5, 0, 3),
    Step(6),
    Step(7, 1),
)
"""Each mode once, with ranks and rotations, so that each may be the best."""


def colors(rng, height, width):
    """Texels (H, W, 4) float32: waves with grain, noise, ends of the range, and blocks of one color."""
    y, x = np.indices((height, width)) / height
    channels = [0.5 + 0.4 * np.sin(9 * x + 3 * y), 0.4 + 0.3 * np.cos(7 * x * y), 0.2 + 0.7 * x * y, 1.5 - 2.0 * y]
    texels = np.stack(channels, axis=-1) + 0.03 * rng.standard_normal((height, width, 1))
    texels[: height // 2, : width // 4] *= rng.choice([0.1, 1.0], (height // 2, width // 4, 4))
    texels[-8:-4, :16] = rng.random((4, 16, 4))
    texels[-4:, : width // 2] = rng.choice([0.0, 1.0], (4, width // 2, 4))
    texels[:4] = np.repeat(rng.random((1, width // 4, 4)), 4, axis=1)
    return np.clip(texels, -0.1, 1.1).astype(np.float32)


def weights_of(rng, height, width):
    """Weights (H, W) float32: blocks with and without texels that count."""
    weights = rng.choice([0.0, 0.01, 0.2, 1.0, 1.0], (height, width)).astype(np.float32)
    weights[:, :4] = 0.0
    return weights


def linear(values):
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("has_weights", [False, True])
@pytest.mark.parametrize("has_alpha", [False, True])
@pytest.mark.parametrize("purpose", [Purpose.COLOR, Purpose.DATA])
def test_blocks_equal_those_of_numpy_to_the_bit_seed_1(monkeypatch, purpose, has_alpha, has_weights):
    rng = np.random.default_rng(1)
    texels = colors(rng, 16, 32)
    if not has_alpha:
        texels[..., 3] = 1.0
    weights = weights_of(rng, 16, 32) if has_weights else None
    monkeypatch.setattr(bc7_encoding, "WITH_ALPHA", FIRST)
    monkeypatch.setitem(bc7_encoding.OPAQUE, purpose, FIRST)
    found = block_encoding.encoded(texels, BC7, purpose, weights)
    assert np.array_equal(found, bc7_encoder.encoded(texels, purpose, has_alpha, FIRST, weights))


@pytest.mark.parametrize("step", [*FIRST, Step(4), Step(5, rotation=1)], ids=str)
def test_each_mode_shows_what_it_encodes_seed_2(monkeypatch, step):
    """Two colors, halved as partition 0 halves a block: each mode can hold them."""
    rng = np.random.default_rng(2)
    pairs = rng.random((16, 16, 1, 2, 4)) * 0.5 + 0.25
    pairs[..., 3] = 1.0 if step.mode in (0, 1, 2, 3) else pairs[..., 3]
    texels = np.broadcast_to(pairs.repeat(2, axis=3), (16, 16, 4, 4, 4)).swapaxes(1, 2).reshape(64, 64, 4)
    texels = np.ascontiguousarray(texels, np.float32)
    step = dataclasses.replace(step, rank=0)
    monkeypatch.setattr(bc7_encoding, "WITH_ALPHA", (step,))
    monkeypatch.setitem(bc7_encoding.OPAQUE, Purpose.DATA, (step,))
    blocks = block_encoding.encoded(texels, BC7, Purpose.DATA)
    number = np.log2(blocks[..., 0] & -blocks[..., 0].astype(int))
    assert (number == step.mode).all()
    steps_of = {0: 5, 1: 7, 2: 5, 3: 8, 4: 5, 5: 7, 6: 7, 7: 6}[step.mode]
    off = np.abs(decoded(blocks, BC7) - texels)
    assert off.mean() < 0.3 / (2**steps_of - 1) and off.max() < 1.5 / (2**steps_of - 1)


def test_opaque_texels_stay_opaque_seed_3():
    rng = np.random.default_rng(3)
    texels = colors(rng, 64, 64)
    texels[:, 32:, 3] = 1.0
    shown = decoded(block_encoding.encoded(texels, BC7, Purpose.COLOR), BC7)
    assert (shown[:, 32:, 3] == 1.0).all() and np.abs(shown[:, :32, 3] - np.clip(texels[:, :32, 3], 0, 1)).mean() < 0.05


def test_blocks_of_one_color_are_exact_to_half_a_step_seed_4():
    rng = np.random.default_rng(4)
    texels = np.ones((64, 64, 4), np.float32)
    texels[..., :3] = rng.random((16, 16, 3)).repeat(4, 0).repeat(4, 1)
    off = np.abs(decoded(block_encoding.encoded(texels, BC7, Purpose.DATA), BC7) - texels)
    assert off.max() <= 0.76 / 255.0 and off.mean() < 0.3 / 255.0


def test_texels_that_do_not_count_spoil_no_others_seed_5():
    rng = np.random.default_rng(5)
    texels = colors(rng, 64, 64)
    texels[..., 3] = 1.0
    weights = (rng.random((64, 64)) < 0.7).astype(np.float32)
    texels[weights == 0.0, :3] = rng.random((np.count_nonzero(weights == 0.0), 3))
    off = [
        np.square(decoded(block_encoding.encoded(texels, BC7, Purpose.DATA, each), BC7) - texels)[weights > 0.0].mean()
        for each in (weights, None)
    ]
    assert off[0] < 0.5 * off[1]


def test_colors_are_closer_in_linear_values_and_data_as_stored_seed_6():
    rng = np.random.default_rng(6)
    y, x = np.indices((64, 64)) / 64.0
    texels = np.stack([0.9 * x, 0.5 + 0.4 * np.sin(9.0 * x * y), y, np.ones_like(x)], axis=-1)
    texels[..., :3] = np.clip(texels[..., :3] + 0.06 * rng.standard_normal((64, 64, 3)), 0.0, 1.0)
    texels = texels.astype(np.float32)
    as_color, as_data = (
        decoded(block_encoding.encoded(texels, BC7, purpose), BC7) for purpose in (Purpose.COLOR, Purpose.DATA)
    )

    def off(shown, change):
        return np.square(change(shown) - change(texels))[..., :3].mean()

    assert off(as_color, linear) < 0.9 * off(as_data, linear)
    assert off(as_data, lambda values: values) < 0.9 * off(as_color, lambda values: values)


@pytest.mark.parametrize("alpha", [1.0, 0.5])
def test_partitions_are_ranked_before_any_block_is_encoded(monkeypatch, alpha):
    """Mesa's zink mixes up the textures of compute shaders that take turns: some blocks of opaque colors were wrong there."""
    calls, dispatch = [], bc7_encoding.target.dispatch
    monkeypatch.setattr(
        bc7_encoding.target,
        "dispatch",
        lambda program, *args, **own: (calls.append(program), dispatch(program, *args, **own)),
    )
    block_encoding.encoded(np.full((4, 4, 4), alpha, np.float32), BC7, Purpose.DATA)
    assert calls == sorted(calls, key=[bc7_encoding.RANK, bc7_encoding.ENCODE].index) and calls[0] == bc7_encoding.RANK
