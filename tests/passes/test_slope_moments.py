# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the roughness of a texel from the slopes in it, against normals drawn from known Beckmann distributions."""

import numpy as np
import pytest

from addon.passes import samples, target
from tests.support.hemisphere import SIZE, texture

pytestmark = pytest.mark.usefixtures("gpu_context")

SAMPLES = 64
WITHIN = 0.02
"""The share by which alpha may be off."""
EXACT = 2e-4
"""The largest error of roughness where the answer is known for each texel."""


def rotation(degrees):
    turn = np.radians(degrees)
    return np.array([[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]])


def of_slopes(slopes):
    """Unit normals (..., 3) of surfaces with these slopes (..., 2)."""
    normals = np.concatenate([-slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def beckmann(alpha, rng, count=SAMPLES):
    """Normals (count, SIZE, SIZE, 3) of a surface whose slopes are Gaussian."""
    return of_slopes(rng.normal(0.0, alpha / np.sqrt(2.0), (count, SIZE, SIZE, 2)))


def widened(normals, roughness=0.0, *, direction=None, state=1.0, known=1.0):
    """The roughness (SIZE, SIZE, 4) of texels with samples `normals` (count, SIZE, SIZE, 3). state: alpha of all samples.
    known: that of the roughness."""

    def upload(values, alpha=1.0):
        texels = np.empty((SIZE, SIZE, 4), np.float32)
        texels[..., :3], texels[..., 3] = values, alpha
        return texture(texels.reshape(-1, 4))

    sums = target.get("test's slopes", SIZE, SIZE, "RGBA32F", "RGBA32F")
    directions = None if direction is None else upload(direction)
    for number, sample in enumerate(normals):
        samples.add_slopes(sums, upload(sample, state), directions, is_first=number == 0)
    into = target.get("test's roughness", SIZE, SIZE, "RGBA32F")
    samples.widen_roughness(into, sums, upload(normals.sum(axis=0)), upload(roughness, known))
    found = np.empty((SIZE, SIZE, 4), np.float32)
    into.read(found)
    return found


@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.7])
def test_beckmann_normals_come_back_seed_1(alpha):
    found = widened(beckmann(alpha, np.random.default_rng(1)))[..., 0].astype(float)
    # The normals of the texels have the rest: the variance of the mean of so many samples.
    share = 1.0 - 1.0 / SAMPLES
    assert np.mean(found**4) == pytest.approx(share * alpha**2, rel=2.0 * WITHIN)
    assert np.sqrt(np.mean(found**4) / share) == pytest.approx(alpha, rel=WITHIN)


def test_it_adds_to_the_roughness_of_the_material():
    """Two slopes of one size: alpha ^ 2 grows by its square."""
    slopes = np.zeros((2, SIZE, SIZE, 2))
    slopes[0, ..., 1], slopes[1, ..., 1] = 0.2, -0.2
    found = widened(of_slopes(slopes), 0.5)
    assert np.abs(found[..., 0] - (0.25**2 + 0.2**2) ** 0.25).max() < EXACT
    assert (found[..., 3] == 1.0).all()


@pytest.mark.parametrize("axis", [0, 1])
def test_slopes_count_against_the_mean_normal(axis):
    """Two normals on either side of a tilted one are as rough as the same two around an upright one."""
    slopes = np.zeros((2, SIZE, SIZE, 2))
    slopes[0, ..., axis], slopes[1, ..., axis] = 0.02, -0.02
    found = widened(of_slopes(slopes) @ rotation(50.0).T, 0.1)
    assert np.abs(found[..., 0] - (0.1**4 + 0.02**2) ** 0.25).max() < EXACT


def test_other_spaces_take_the_low_surface_s_normal_seed_2():
    normals = beckmann(0.3, np.random.default_rng(2), 16)
    turn = rotation(70.0) @ rotation(30.0)[[1, 2, 0]][:, [1, 2, 0]]
    flat, turned = widened(normals), widened(normals @ turn.T, direction=turn[:, 2])
    assert np.abs(flat - turned).max() < EXACT


def test_one_normal_leaves_roughness_as_it_is_seed_3():
    """Rounding adds nothing, also where normals lean far."""
    normals = beckmann(0.7, np.random.default_rng(3), 1)
    assert np.abs(widened(normals.repeat(5, axis=0), 0.03)[..., 0] - 0.03).max() < EXACT


def test_roughness_ends_at_1():
    slopes = np.zeros((2, SIZE, SIZE, 2))
    slopes[0, ..., 0], slopes[1, ..., 0] = 3.0, -3.0
    assert (widened(of_slopes(slopes), 0.5)[..., 0] == 1.0).all()


def test_misses_do_not_count_seed_4():
    normals = beckmann(0.7, np.random.default_rng(4), 2)
    assert np.abs(widened(normals, 0.3, state=-1.0)[..., 0] - 0.3).max() < EXACT


@pytest.mark.parametrize("known", [0.0, -1.0])
def test_without_a_roughness_there_is_no_value(known):
    flat = of_slopes(np.zeros((1, SIZE, SIZE, 2)))
    assert (widened(flat, 0.3, known=known)[..., 3] == known).all()
