# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the margin against a brute-force search for the nearest written texel."""

import gpu
import numpy as np
import pytest

from addon.core import map_types
from addon.passes import margin_fill, target

pytestmark = pytest.mark.usefixtures("gpu_context")

NOTHING, WRITTEN, MISSED = 0.0, 1.0, -1.0
"""The alpha of a texel before the margin is filled."""


def resolved(alpha, reach):
    """Run the passes on texels (H, W) of this alpha that hold their own place.

    Returns for each texel the place (H, W, 2) whose value it got, as column and row; its alpha; its state.
    """
    height, width = alpha.shape
    rows, columns = np.indices(alpha.shape)
    texels = np.stack([columns, rows, np.zeros_like(rows), alpha], axis=-1).astype(np.float32)
    data = gpu.types.Buffer("FLOAT", texels.shape, texels)
    values = gpu.types.GPUTexture((width, height), format="RGBA32F", data=data)
    stored = target.Target(width, height, ("RGBA32F", "R8"))
    nearest = margin_fill.find_nearest(values, reach)
    margin_fill.fill_from_nearest(stored, values, nearest, halo=0, encode=np.eye(4), missed=(0.25, 0.5, 0.75))
    out, state = np.empty((height, width, 4), np.float32), np.empty((height, width), np.uint8)
    stored.read(out)
    stored.read(state, slot=1)
    return out[..., :2], out[..., 3], state


def squares(alpha):
    """The squared distance (H, W) from each texel to the nearest written one, by brute force."""
    rows, columns = np.indices(alpha.shape)
    y, x = np.nonzero(alpha == WRITTEN)
    return ((rows[..., None] - y) ** 2 + (columns[..., None] - x) ** 2).min(axis=-1)


def in_reach(alpha, reach):
    """Which texels (H, W) have a written one at most `reach` rows and columns away."""
    rows, columns = np.indices(alpha.shape)
    y, x = np.nonzero(alpha == WRITTEN)
    away = np.maximum(np.abs(rows[..., None] - y), np.abs(columns[..., None] - x)).min(axis=-1)
    return np.ones(alpha.shape, bool) if reach is None else away <= reach


def squares_of(place):
    """The squared distance (H, W) from each texel to the position (H, W, 2) whose value it got."""
    rows, columns = np.indices(place.shape[:2])
    return (place[..., 0] - columns) ** 2 + (place[..., 1] - rows) ** 2


MAPS = {
    "few seed 3": np.random.default_rng(3).random((48, 64)) < 0.01,
    "many seed 4": np.random.default_rng(4).random((64, 48)) < 0.5,
    "one": np.arange(40 * 90).reshape(40, 90) == 40 * 90 - 1,
    "islands seed 5": np.kron(np.random.default_rng(5).random((9, 7)) < 0.2, np.ones((7, 8))) > 0,
    "rows": np.tile(np.arange(70)[:, None] % 32 == 7, 33),
    "columns": np.tile(np.arange(70) % 32 == 7, (33, 1)),
    "a narrow map seed 6": np.random.default_rng(6).random((300, 16)) < 0.002,
}


@pytest.mark.parametrize("reach", [0, 1, 16, None])
@pytest.mark.parametrize("name", MAPS)
def test_the_margin_repeats_the_nearest_written_texel(name, reach):
    written = MAPS[name]
    before = np.where(written, WRITTEN, NOTHING)
    place, alpha, state = resolved(before, reach)
    rows, columns = np.indices(written.shape)
    filled = state == map_types.MARGIN

    assert np.array_equal(state == map_types.WRITTEN, written)
    assert np.array_equal(alpha, (written | filled).astype(np.float32))
    assert np.array_equal(place[written], np.stack([columns, rows], axis=-1)[written])
    assert np.array_equal(filled, in_reach(before, reach) & ~written)
    assert np.array_equal(squares_of(place)[filled], squares(before)[filled])
    assert written[place[filled][:, 1].astype(int), place[filled][:, 0].astype(int)].all()


@pytest.mark.parametrize("reach", [1, 16, None])
@pytest.mark.parametrize("name", MAPS)
def test_high_maps_with_wide_margins_take_more_dispatches_and_are_the_same(name, reach, monkeypatch):
    before = np.where(MAPS[name], WRITTEN, NOTHING)
    at_once = resolved(before, reach)
    monkeypatch.setattr(margin_fill, "MOST_TURNS", 0)
    assert all(np.array_equal(*both) for both in zip(at_once, resolved(before, reach), strict=True))


@pytest.mark.parametrize("name", MAPS)
def test_of_texels_as_near_the_lowest_row_counts_and_in_it_the_right_one(name):
    """So a map is the same to the bit however it is divided into bands and passes."""
    written = MAPS[name]
    place, _, _ = resolved(np.where(written, WRITTEN, NOTHING), None)
    rows, columns = np.indices(written.shape)
    y, x = np.nonzero(written)
    order = np.lexsort((-x, y))
    y, x = y[order], x[order]
    first = ((rows[..., None] - y) ** 2 + (columns[..., None] - x) ** 2).argmin(axis=-1)
    assert np.array_equal(place, np.stack([x[first], y[first]], axis=-1))


def test_the_margin_is_exact_on_a_large_map():
    """Distances reach thousands of texels, and their squares are large integers."""
    alpha = np.zeros((4096, 16), np.float32)
    alpha[0, 3] = alpha[4000, 12] = WRITTEN
    place, _, _ = resolved(alpha, None)
    assert np.array_equal(squares_of(place), squares(alpha))


@pytest.mark.parametrize("reach", [2, None])
def test_missed_texels_stay_holes_seed_7(reach):
    alpha = np.random.default_rng(7).choice([NOTHING, WRITTEN, MISSED], (40, 50), p=[0.8, 0.05, 0.15])
    place, out, state = resolved(alpha, reach)
    missed = alpha == MISSED
    assert np.array_equal(state == map_types.MISSED, missed)
    assert (out[missed] == 0.0).all()
    assert (place[missed] == (0.25, 0.5)).all()
    assert np.array_equal(state == map_types.MARGIN, (alpha == NOTHING) & in_reach(alpha, reach))


def test_an_empty_map_gets_no_margin():
    _, alpha, state = resolved(np.zeros((20, 30)), None)
    assert not alpha.any()
    assert not state.any()


def test_background_is_the_flat_normal_with_alpha_0():
    written = np.zeros((20, 20))
    written[0, 0] = WRITTEN
    place, alpha, state = resolved(written, 4)
    assert alpha[19, 19] == 0.0
    assert state[19, 19] == 0
    assert (place[19, 19] == 0.0).all()
