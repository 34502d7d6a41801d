# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the rasterizer that gives rays to bakers that have none."""

import numpy as np

from scripts.bench.contenders import worker

SIZE = 16


def test_the_centers_of_texels_are_found_seed_1():
    corners = np.random.default_rng(1).uniform(-4.0, SIZE + 4.0, (40, 3, 2))
    corners[7, 2] = corners[7, 1]  # a triangle without an area
    index, weights, triangles = worker.rasterized(corners, SIZE)
    positions = np.einsum("nc,ncx->nx", weights, corners[triangles])
    assert np.allclose(positions, np.stack([index % SIZE, index // SIZE], axis=1))
    assert np.allclose(weights.sum(axis=1), 1.0)
    assert weights.min() >= 0.0

    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(SIZE), np.arange(SIZE)))
    expected = set()
    for number, (a, b, c) in enumerate(corners):
        sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all(np.array(sides) > 0.0, axis=0) | np.all(np.array(sides) < 0.0, axis=0)
        expected |= {(number, int(texel)) for texel in np.flatnonzero(inside)}
    assert len(expected) > 100
    assert set(zip(triangles.tolist(), index.tolist(), strict=True)) == expected


def test_a_square_of_two_triangles_covers_all_texels():
    low, high = -0.5, SIZE - 0.5
    square = np.array([[low, low], [high, low], [high, high], [low, high]])
    index, _, triangles = worker.rasterized(square[[[0, 1, 2], [0, 2, 3]]], SIZE)
    assert set(index.tolist()) == set(range(SIZE * SIZE))
    assert set(triangles.tolist()) == {0, 1}


def test_centers_on_the_border_of_a_triangle_count():
    index, _, _ = worker.rasterized(np.array([[[2.0, 2.0], [4.0, 2.0], [2.0, 4.0]]]), SIZE)
    assert {divmod(texel, SIZE) for texel in index.tolist()} == {(2, 2), (2, 3), (2, 4), (3, 2), (3, 3), (4, 2)}
