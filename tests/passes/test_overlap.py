# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the count of triangles on each texel, on layouts where it is known."""

import numpy as np
import pytest

from addon.core import udim
from addon.engine import coverage
from addon.mesh import uv_layout
from addon.mesh.triangle_mesh import Mesh
from addon.passes import audit, mesh_upload
from tests.support import maps, oracle, random_cases

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


def overlap_share(low, size):
    """The share of the texels of `low` that two or more of its triangles cover."""
    counts = coverage.counts(low, size)[0]
    return np.count_nonzero(counts > 1) / np.count_nonzero(counts)


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
HALVES = [(0, 1, 2), (0, 2, 3)]


def test_triangles_with_a_common_edge_share_no_texels():
    n = 17  # a grid whose lines run through texel centers
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([first, first + 1, first + n + 1], 1), np.stack([first, first + n + 1, first + n], 1)]
    )
    assert overlap_share(laid_out(uv, triangles), (24, 24)) == 0.0


def test_half_of_the_map_is_covered_twice():
    uv = [*SQUARE, (0, 0), (0.5, 0), (0.5, 1), (0, 1)]
    assert overlap_share(laid_out(uv, [*HALVES, (4, 5, 6), (4, 6, 7)]), (64, 64)) == pytest.approx(0.5)


def test_a_layout_that_was_moved_is_counted_anew():
    uv = np.array([*SQUARE, (0, 0), (0.5, 0), (0.5, 1), (0, 1)], np.float32)
    triangles = [*HALVES, (4, 5, 6), (4, 6, 7)]
    first = overlap_share(laid_out(uv, triangles), (64, 64))
    uv[5:7, 0] = 0.25
    assert overlap_share(laid_out(uv, triangles), (64, 64)) == pytest.approx(first / 2)
    assert overlap_share(laid_out(uv, triangles[:2]), (64, 64)) == 0.0


def test_many_triangles_on_one_place_count_as_one_overlap():
    uv = SQUARE * 30
    triangles = [np.array(half) + 4 * i for i in range(30) for half in HALVES]
    assert overlap_share(laid_out(uv, triangles), (32, 32)) == 1.0


def test_random_triangles_seed_4():
    rng = np.random.default_rng(4)
    triangles = rng.random((40, 3, 2))
    size = 64
    j, i = np.indices((size, size))
    centers = np.stack([(i.ravel() + 0.5) / size, (j.ravel() + 0.5) / size], axis=1)
    counts = sum((oracle.depth_inside(centers, triangle[None]) > 0.0).astype(int) for triangle in triangles)
    truth = np.count_nonzero(counts > 1) / np.count_nonzero(counts)
    mesh = laid_out(triangles.reshape(-1, 2), np.arange(120).reshape(-1, 3))
    assert overlap_share(mesh, (size, size)) == pytest.approx(truth, abs=2e-3)


@pytest.mark.parametrize(
    "size",
    [
        (coverage.SAMPLES_A_SIDE, 8),
        (2 * coverage.SAMPLES_A_SIDE, 8),
        (3 * coverage.SAMPLES_A_SIDE - 1, 5),
        (7, coverage.SAMPLES_A_SIDE + 1),
    ],
)
@pytest.mark.parametrize("tile", [1001, 1013])
def test_samples_of_a_large_map_are_texels_of_the_map_seed_9(size, tile):
    rng = np.random.default_rng(9)
    uv = rng.random((60, 2)).astype(np.float32) + ((tile - 1001) % 10, (tile - 1001) // 10)
    low = laid_out(uv, np.arange(60).reshape(-1, 3))
    all_of_them = audit.counts(mesh_upload.upload(low.triangles, uv=low.uv), size, udim.uv_to_clip(tile))
    sampled = coverage.counts(low, size, [tile])[0]
    assert max(sampled.shape) <= coverage.SAMPLES_A_SIDE
    columns, rows = coverage.sampled(size).steps
    truth = all_of_them[::rows, ::columns]
    assert sampled.shape == truth.shape
    # Rasterizers round corners to a fraction of a texel, and texels are larger if fewer are drawn.
    assert np.count_nonzero(sampled != truth) <= 0.005 * truth.size


def test_mirrored_triangles_have_negative_areas():
    assert (uv_layout.areas(laid_out(SQUARE, HALVES)) > 0).all()
    areas = uv_layout.areas(laid_out(SQUARE, [HALVES[0], HALVES[1][::-1], (0, 1, 1)]))
    assert areas.tolist() == [1.0, -1.0, 0.0]


@pytest.mark.parametrize("column", [0, 1000, 2046])
def test_every_second_texel_of_a_large_map_is_sampled_at_its_center(column):
    """A pair of triangles covers the middle half of one column of texels. Only even columns are sampled."""
    left, right = (column + 0.25) / 2048, (column + 0.75) / 2048
    low = laid_out([(left, 0), (right, 0), (right, 1), (left, 1)], HALVES)
    counts = coverage.counts(low, (2048, 64))[0]
    assert counts.shape == (64, 1024)
    assert (counts[:, column // 2] == 1.0).all()
    assert np.count_nonzero(counts) == 64


@pytest.mark.parametrize(
    "sliver", [[(2.5, 0.5)] * 3, [(1.5, 0.2), (1.5, 0.4), (1.5, 0.8)], [(0.2, 3.5), (0.8, 3.5), (0.4, 3.5)]]
)
def test_triangles_without_extent_are_on_no_tile(sliver):
    assert uv_layout.tiles(laid_out([*SQUARE, *sliver], [*HALVES, (4, 5, 6)])) == [1001]


# Triangle ids


RIM = 1 / 128
"""Tolerance in texels: rasterizers round corners to 1/256 texel, and a center closer to an edge may be on either side."""


def layers(uv, triangles, size, count, tile=1001):
    mesh = audit.upload_with_ids(np.asarray(triangles, np.int32), np.asarray(uv, np.float32))
    return np.stack(
        [numbers.copy() for numbers in audit.layers_of_triangles(mesh, size, udim.uv_to_clip(tile), count)]
    ).astype(int)


@random_cases.seeds(3, fast=2)
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
