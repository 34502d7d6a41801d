# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that kd_order returns the order that its docstring describes."""

import numpy as np
import pytest

from addon.mesh import bvh


def are_separated(first, second):
    """Whether a plane across an axis separates points (3, N) from (3, M)."""
    return bool(np.any((first.max(axis=1) <= second.min(axis=1)) | (second.max(axis=1) <= first.min(axis=1))))


@pytest.mark.parametrize("count", [0, 1, 3, 4, 5, 9, 17, 65, 1000, 4096, 70_000])
@pytest.mark.parametrize("part", [64, bvh.PART])
def test_runs_are_separated_by_planes_seed_11(count, part, monkeypatch):
    monkeypatch.setattr(bvh, "PART", part)
    points = np.random.default_rng(11).integers(0, 2**16, (3, count), dtype=np.uint16)
    order = bvh.kd_order(points)
    assert np.array_equal(np.sort(order), np.arange(count))
    points = points[:, order]
    size = 4
    while size < count:
        for start in range(0, count, 2 * size):
            first, second = points[:, start : start + size], points[:, start + size : start + 2 * size]
            assert not second.size or are_separated(first, second)
        size *= 2


@pytest.mark.parametrize("part", [4, 16, bvh.PART])
def test_the_longest_axis_is_divided_first(part, monkeypatch):
    monkeypatch.setattr(bvh, "PART", part)  # several threads halve longer runs
    side = np.arange(64, dtype=np.uint16)
    for axis in range(3):
        points = np.zeros((3, 64), np.uint16)
        points[axis] = side[::-1]
        points[axis - 1] = side % 4
        found = points[axis, bvh.kd_order(points)].reshape(-1, 4)
        assert np.array_equal(np.sort(found, axis=1), side.reshape(-1, 4))


def test_identical_points_are_ordered():
    assert np.array_equal(np.sort(bvh.kd_order(np.full((3, 100), 7, np.uint16))), np.arange(100))
