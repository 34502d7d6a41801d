# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels that several triangles cover, on layouts where their number is known."""

import numpy as np
import pytest

from addon.bake import audit
from addon.mesh.arrays import Mesh, mirrored
from tests.support import oracle

pytestmark = pytest.mark.usefixtures("gpu_context")


def laid_out(uv, triangles):
    uv = np.asarray(uv, np.float32)
    return Mesh(
        name="low",
        positions=np.zeros((len(uv), 3), np.float32),
        vertices=np.arange(len(uv), dtype=np.int32),
        normals=np.zeros((len(uv), 3), np.float32),
        triangles=np.asarray(triangles, np.int32),
        to_world=np.eye(4),
        uv=uv,
    )


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
HALVES = [(0, 1, 2), (0, 2, 3)]


def test_triangles_that_meet_along_an_edge_share_nothing():
    n = 17  # a grid whose lines run through texel centres
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([first, first + 1, first + n + 1], 1), np.stack([first, first + n + 1, first + n], 1)]
    )
    assert audit.overlap_share(laid_out(uv, triangles), (24, 24)) == 0.0


def test_half_of_the_map_twice():
    uv = [*SQUARE, (0, 0), (0.5, 0), (0.5, 1), (0, 1)]
    assert audit.overlap_share(laid_out(uv, [*HALVES, (4, 5, 6), (4, 6, 7)]), (64, 64)) == pytest.approx(0.5)


def test_many_on_the_same_place_count_as_one_overlap():
    uv = SQUARE * 30
    triangles = [np.array(half) + 4 * i for i in range(30) for half in HALVES]
    assert audit.overlap_share(laid_out(uv, triangles), (32, 32)) == 1.0


def test_random_triangles_seed_4():
    rng = np.random.default_rng(4)
    triangles = rng.random((40, 3, 2))
    size = 64
    j, i = np.indices((size, size))
    centres = np.stack([(i.ravel() + 0.5) / size, (j.ravel() + 0.5) / size], axis=1)
    counts = sum((oracle.depth_inside(centres, triangle[None]) > 0.0).astype(int) for triangle in triangles)
    truth = np.count_nonzero(counts > 1) / np.count_nonzero(counts)
    mesh = laid_out(triangles.reshape(-1, 2), np.arange(120).reshape(-1, 3))
    assert audit.overlap_share(mesh, (size, size)) == pytest.approx(truth, abs=2e-3)


def test_mirrored_triangles_are_counted():
    assert mirrored(laid_out(SQUARE, HALVES)) == 0
    assert mirrored(laid_out(SQUARE, [HALVES[0], HALVES[1][::-1]])) == 1
