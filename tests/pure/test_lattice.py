# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the lattices of rays, without a GPU."""

import math

import numpy as np
import pytest

from addon.core.progress import SLICE_ROWS, Pace
from addon.passes import hemisphere

COUNTS = [1, 2, 3, 16, 50, 64, 97, 100, 128, 256, 1000, 1024]


def points(chosen):
    """The points (count, 2) in steps of 1 / count."""
    return np.arange(chosen.count)[:, None] * np.array(chosen.step) % chosen.count


@pytest.mark.parametrize("count", COUNTS)
def test_each_row_and_column_has_one_point(count):
    for axis in points(hemisphere.lattice_of(count)).T:
        assert sorted(axis) == list(range(count))


@pytest.mark.parametrize("count", COUNTS)
def test_the_cell_has_the_area_of_a_point_and_spans_the_lattice(count):
    chosen = hemisphere.lattice_of(count)
    cell = np.array(chosen.cell).reshape(2, 2)
    assert abs(np.linalg.det(cell)) == pytest.approx(1.0 / count)
    known = {tuple(point) for point in points(chosen)}
    assert {tuple(vector) for vector in np.rint(cell * count).astype(int) % count} <= known


@pytest.mark.parametrize("count", [64, 97, 128, 256, 1024])
def test_steps_are_short_so_that_successive_rays_go_similar_ways(count):
    step = (np.array(hemisphere.lattice_of(count).step) + count / 2.0) % count - count / 2.0
    assert math.hypot(*step) < 1.5 * math.sqrt(count)


def test_the_lattice_is_the_best_by_its_error_for_128_points():
    """By the definition, which counts all waves that fit a lattice; the code has a sum over points instead."""
    waves = np.stack(np.meshgrid(np.arange(-300, 301), np.arange(-300, 301)), axis=-1).reshape(-1, 2)
    waves = waves[(waves != 0).any(axis=1)]
    weights = np.prod(1.0 / np.maximum(np.abs(waves), 1), axis=1, dtype=np.float64) ** 2

    def error(step):
        return weights[(waves @ step) % 128 == 0].sum()

    own = error(np.array(hemisphere.lattice_of(128).step))
    others = [error(np.array((1, a))) for a in range(1, 128, 2)]
    assert own <= min(others) * (1.0 + 1e-9)


@pytest.mark.parametrize("samples", [1, 4, 8, 64])
def test_samples_share_the_rays_of_a_texel(samples):
    chosen = hemisphere.lattice_of(128)
    shares = [hemisphere.rays_of_sample(chosen, sample, samples) for sample in range(samples)]
    assert sorted(ray for share in shares for ray in share) == list(range(128))
    assert {len(share) for share in shares} == {128 // samples}


@pytest.mark.parametrize("rays", [range(128), range(3, 100, 8), range(5), range(33)])
def test_slices_have_all_rays_of_all_rows_once(rays):
    seen = np.zeros((50, 128), int)
    first = np.zeros(50, int)
    drawn = []
    covered = np.full(7, 8.0 * 64)
    slices = hemisphere.slices(
        Pace(0.0), hemisphere.ADD_OPENNESS, (64, 50), covered, rays, draw=lambda *slice_: drawn.append(slice_)
    )
    for rows, numbers, is_first in slices:
        assert drawn[-1] == (rows, numbers, is_first)
        assert rows.start % SLICE_ROWS == 0
        assert len(numbers) <= hemisphere.AT_ONCE
        seen[np.ix_(rows, numbers)] += 1
        first[rows] += is_first
        assert is_first == (seen[rows.start].sum() == len(numbers))
    assert (seen[:, list(rays)] == 1).all()
    assert seen.sum() == 50 * len(rays)
    assert (first == 1).all()
