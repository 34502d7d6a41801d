# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the triangles on each texel, layer by layer, on layouts where they are known."""

import numpy as np
import pytest

from addon.core import udim
from addon.passes import audit
from tests.support import maps, oracle

pytestmark = pytest.mark.usefixtures("gpu_context")

RIM = 1 / 128
"""Tolerance in texels: rasterizers round corners to 1/256 texel, and a center closer to an edge may be on either side."""


def layers(uv, triangles, size, count, tile=1001):
    mesh = audit.upload_with_ids(np.asarray(triangles, np.int32), np.asarray(uv, np.float32))
    return np.stack(
        [numbers.copy() for numbers in audit.layers_of_triangles(mesh, size, udim.uv_to_clip(tile), count)]
    ).astype(int)


@pytest.mark.parametrize("seed", range(3))
def test_random_triangles(seed):
    rng = np.random.default_rng(seed)
    triangles, size, count = rng.random((12, 3, 2)), 48, 12
    centers = maps.texel_uv(size, size).reshape(-1, 2)
    depths = np.stack([oracle.depth_inside(centers, triangle[None]) for triangle in triangles], axis=1)
    is_clear = (np.abs(depths) > RIM / size).all(axis=1)
    assert is_clear.mean() > 0.9
    drawn = layers(triangles.reshape(-1, 2), np.arange(36).reshape(-1, 3), (size, size), count)
    drawn = drawn.reshape(count, -1)
    assert (depths > 0).sum(axis=1).max() > 4
    for depth, found in zip(depths[is_clear], drawn[:, is_clear].T, strict=True):
        truth = [*np.flatnonzero(depth > 0.0)[::-1] + 1, 0]
        np.testing.assert_array_equal(found, np.resize(truth, count))  # then they repeat


def test_large_numbers_are_exact():
    """One triangle per texel, so many that their numbers need both parts."""
    size = 300
    i, j = np.meshgrid(np.arange(size), np.arange(size))
    first = np.stack([i.ravel(), j.ravel()], axis=1)
    uv = (first[:, None] + np.array([(0.1, 0.1), (0.9, 0.1), (0.5, 1.0)])) / size + (2, 3)
    numbers = layers(uv.reshape(-1, 2), np.arange(3 * size * size).reshape(-1, 3), (size, size), 1, tile=1033)[0]
    np.testing.assert_array_equal(numbers.ravel(), np.arange(1, size * size + 1))


def test_triangles_can_share_corners():
    numbers = layers([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)], (8, 4), 1)[0]
    assert numbers[0, -1] == 1
    assert numbers[-1, 0] == 2
    assert numbers.shape == (4, 8)
