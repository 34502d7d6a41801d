# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the levels of pages against means in float64, and the upload of odd images."""

import numpy as np
import pytest

from addon.core.material_feeds import ImagePixels
from addon.passes import surface_tables

SINGLE = 1e-6


def mean_over_parts(values, count):
    """The means (count, ...) of equal parts of the first axis, with shares of the values that a border cuts."""
    size = len(values)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.arange(count + 1) * size / count
    whole = np.minimum(np.floor(at).astype(int), size - 1)
    sums = total[whole] + values[whole] * (at - whole).reshape(-1, *[1] * (values.ndim - 1))
    return np.diff(sums, axis=0) * count / size


def test_parts_of_the_oracle():
    assert np.allclose(mean_over_parts(np.arange(6.0), 3), (0.5, 2.5, 4.5))
    assert np.allclose(mean_over_parts(np.array((0.0, 1.0, 5.0)), 2), (1 / 3, 11 / 3))


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (1, 7), (2, 1), (64, 64), (37, 100), (255, 129)])
@pytest.mark.parametrize("is_byte", [False, True])
def test_each_level_has_the_means_of_its_parts_seed_1(size, is_byte):
    """Odd sizes shift nothing: each pixel is an equal part of the level before, all of which it covers."""
    values = np.random.default_rng(1).integers(0, 256, (*size, 4)).astype(np.float32) / np.float32(255)
    page = surface_tables.upload_image(ImagePixels(values, is_byte=is_byte))
    sizes = surface_tables.level_sizes(size[1], size[0])
    assert sizes[-1] == (1, 1)
    assert page.top == len(sizes) - 1
    levels = np.array(page.levels.read()).reshape(page.levels.height, page.levels.width, 4)
    truth = values.astype(np.float64)
    used = np.zeros(levels.shape[:2], int)
    for level, (width, height) in enumerate(sizes[1:], 1):
        x, y = surface_tables.level_origin(sizes, level)
        assert x + width <= levels.shape[1]
        assert y + height <= levels.shape[0]
        used[y : y + height, x : x + width] += 1
        truth = mean_over_parts(mean_over_parts(truth, height).swapaxes(0, 1), width).swapaxes(0, 1)
        assert np.abs(levels[y : y + height, x : x + width] - truth).max() < SINGLE
    assert used.max() <= 1


@pytest.mark.usefixtures("gpu_context")
def test_colors_are_averaged_in_linear_light():
    values = np.zeros((2, 2, 4), np.float32)
    values[0, :, :3], values[1, :, 3] = 1.0, 1.0
    for weighs_alpha, expected in ((False, (0.5, 0.5, 0.5, 0.5)), (True, (0.0, 0.0, 0.0, 0.5))):
        page = surface_tables.upload_image(ImagePixels(values, is_srgb=True, is_byte=True, weighs_alpha=weighs_alpha))
        assert np.allclose(np.array(page.levels.read()).ravel(), expected)


@pytest.mark.usefixtures("gpu_context")
def test_values_that_are_not_finite_do_not_spread():
    values = np.full((8, 8, 4), 0.5, np.float32)
    values[0, 0], values[7, 7] = np.nan, np.inf
    page = surface_tables.upload_image(ImagePixels(values))
    levels = np.array(page.levels.read()).reshape(page.levels.height, page.levels.width, 4)
    assert np.isfinite(np.array(page.pixels.read())).all()
    assert np.isfinite(levels).all()
    assert np.isnan(values[0, 0]).all()  # the caller's pixels stay
    assert levels[0, 0, 0] == np.float32(0.375)
    assert (levels[1:3, 1:3] == 0.5).all()


def test_an_image_that_is_too_large_is_reduced():
    values = np.random.default_rng(2).random((7, 10, 4), np.float32)
    assert surface_tables.fitting(values, 10)[0] is values
    reduced, parts = surface_tables.fitting(values, 4)
    assert parts == 3
    assert reduced.shape == (3, 4, 4)
    assert np.allclose(reduced[0, 0], values[:3, :3].mean(axis=(0, 1)))
    assert np.allclose(reduced[2, 3], values[6:, 9:].mean(axis=(0, 1)))


def test_an_image_without_pixels_is_refused():
    with pytest.raises(ValueError, match="no pixels"):
        surface_tables.upload_image(ImagePixels(np.zeros((0, 5, 4), np.float32)))


@pytest.mark.usefixtures("gpu_context")
def test_a_very_wide_image_has_all_its_levels():
    values = np.zeros((3, 16384, 4), np.float32)
    values[:, ::2] = 1.0
    page = surface_tables.upload_image(ImagePixels(values, is_byte=True))
    assert page.top == 14
    assert page.levels.width == 8192
    x, y = surface_tables.level_origin(surface_tables.level_sizes(16384, 3), 14)
    levels = np.array(page.levels.read()).reshape(page.levels.height, page.levels.width, 4)
    assert np.allclose(levels[y, x], 0.5, atol=SINGLE)
