# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the roughness of mip levels against normals that are drawn from known Beckmann distributions."""

import numpy as np
import pytest

from addon.engine.mip_levels import LEVELS, RoughLevels, halved, slabs, spread

SIZE = 256
WITHIN = 0.02
"""The share by which alpha may be off."""


def levels_of(normals, roughness):
    return RoughLevels(normals.__getitem__, roughness.__getitem__, len(normals))


def levels(normals, roughness):
    """The mean of alpha ^ 2 of each level. normals (SIZE, SIZE, 3), roughness (SIZE, SIZE)."""

    def texels(values):
        result = np.ones((*values.shape[:2], 4), np.float32)
        result[..., :3] = values
        return result

    rough, sums, found = levels_of(texels(normals), texels(roughness[..., None])), normals, []
    while len(sums) > 1:
        sums = halved(sums)
        mean = sums / np.linalg.norm(sums, axis=-1, keepdims=True)
        found.append(float(np.mean(rough.next(texels(mean))[..., 0].astype(float) ** 4)))
    return found


def beckmann(alpha, rng):
    slopes = rng.normal(0.0, alpha / np.sqrt(2.0), (SIZE, SIZE, 2))
    normals = np.concatenate([-slopes, np.ones((SIZE, SIZE, 1))], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.7])
def test_beckmann_normals_come_back_seed_1(alpha):
    found = levels(beckmann(alpha, np.random.default_rng(1)), np.zeros((SIZE, SIZE)))
    assert np.sqrt(found[3:]) == pytest.approx(alpha, rel=WITHIN)


def test_the_roughness_of_the_material_adds_to_it_seed_2():
    normals, base = beckmann(0.3, np.random.default_rng(2)), 0.2
    found = levels(normals, np.full((SIZE, SIZE), np.sqrt(base)))
    assert np.sqrt(found[3:]) == pytest.approx(np.hypot(0.3, base), rel=WITHIN)


def test_a_tilted_surface_is_as_rough_seed_3():
    turn = np.radians(50.0)
    matrix = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    normals, roughness = beckmann(0.1, np.random.default_rng(3)), np.zeros((SIZE, SIZE))
    assert levels(normals @ matrix.T, roughness) == pytest.approx(levels(normals, roughness), rel=1e-3)


def test_equal_normals_lose_nothing():
    normals = np.broadcast_to(np.array([0.48, 0.6, 0.64]), (SIZE, SIZE, 3))
    assert np.sqrt(levels(normals, np.full((SIZE, SIZE), 0.3))) == pytest.approx(0.3**2, rel=1e-3)


def test_only_known_texels_count():
    """One texel in each block is known; the others hold anything."""
    normals, roughness = np.zeros((4, 4, 4), np.float32), np.full((4, 4, 4), 0.9, np.float32)
    normals[..., 2], normals[..., 3], roughness[..., 3] = 1.0, 1.0, 0.0
    roughness[::2, ::2] = 0.25, 0.25, 0.25, 1.0
    roughness[3, 3, 3] = -1.0
    roughness[2, 2, 3] = 0.0
    found = levels_of(normals, roughness).next(normals[::2, ::2])
    assert found[..., 3].tolist() == [[1.0, 1.0], [1.0, -1.0]]
    assert np.abs(found[found[..., 3] > 0.0][:, :3] - 0.25).max() < 1e-5


@pytest.mark.parametrize(("size", "smaller"), [((4, 6), (2, 3)), ((5, 7), (2, 3)), ((1, 3), (1, 1)), ((1, 1), (1, 1))])
def test_blocks_share_a_texel(size, smaller):
    values = np.arange(1.0, size[0] * size[1] + 1.0).reshape(size)
    sums = halved(values)
    assert sums.shape == smaller
    assert sums.sum() == values.sum()
    numbers = spread(np.arange(sums.size).reshape(smaller), size, 1, slice(None))
    assert np.array_equal(np.bincount(numbers.ravel(), values.ravel()).reshape(smaller), sums)


def test_levels_of_levels_count_texels_of_the_whole_map_seed_4():
    """Normals are equal, so that each level is the mean of alpha ^ 2 of what is known, however uneven that is."""
    rng = np.random.default_rng(4)
    normals, roughness = np.zeros((SIZE, SIZE, 4), np.float32), np.ones((SIZE, SIZE, 4), np.float32)
    normals[..., 2:] = 1.0
    roughness[..., :3] = rng.random((SIZE, SIZE, 1))
    roughness[..., 3] = rng.random((SIZE, SIZE)) < np.linspace(0.01, 1.0, SIZE)
    rough, known, squares = levels_of(normals, roughness), roughness[..., 3], roughness[..., 0] ** 4
    sums = known * squares
    while len(sums) > 1:
        sums, known = halved(sums), halved(known)
        up = np.zeros((*sums.shape, 4), np.float32)
        up[..., 2:] = 1.0
        found = rough.next(up)
        is_known = known > 0
        assert np.array_equal(found[..., 3] > 0, is_known)
        assert np.abs(found[..., 0] ** 4 - sums / np.maximum(known, 1))[is_known].max() < 1e-5


@pytest.mark.parametrize("height", [1, 40, 128, 300, 383, 384, 385, 700])
def test_parts_of_a_map_become_parts_of_its_levels_seed_5(height):
    values = np.random.default_rng(5).random((height, 3)).astype(np.float32)
    parts = list(slabs(height))
    assert [i for part in parts for i in range(height)[part]] == list(range(height))
    assert max(part.stop - part.start for part in parts) < 2 << LEVELS
    whole, pieces = values, [values[part] for part in parts]
    for _ in range(LEVELS):
        whole, pieces = halved(whole), [halved(piece) for piece in pieces]
        assert np.array_equal(np.concatenate(pieces), whole)
