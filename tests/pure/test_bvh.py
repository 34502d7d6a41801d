# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the tree has the layout that its docstrings describe."""

import numpy as np
import pytest

from addon.mesh import bvh


def unpack(packed):
    """Undo bvh.pack: low, high (…,), written from its docstring and not from its code."""
    bits = np.ascontiguousarray(packed).view(np.uint32)
    return bits & 0x7FFF, bits >> 15


def tree_of(corners):
    """The tree of triangles (T, 3, 3) that share no points."""
    return bvh.build(corners.reshape(-1, 3), np.arange(len(corners) * 3).reshape(-1, 3))


def test_pack_keeps_extreme_pairs_and_makes_normal_floats():
    values = np.array([256, 257, 511, 512, 16383, 16384, 32639, 32640, 32766, 32767], np.uint16)
    low, high = (grid.ravel() for grid in np.meshgrid(values, values))
    packed = bvh.pack(low, high)
    assert packed.dtype == np.float32
    assert np.isfinite(packed).all()
    assert (np.abs(packed) >= np.finfo(np.float32).tiny).all()
    assert all(np.array_equal(*pair) for pair in zip(unpack(packed), (low, high), strict=True))


@pytest.mark.parametrize("count", [1, 2, 4, 5, 16, 17, 1000])
def test_every_triangle_lies_inside_all_its_ancestors_boxes_seed_5(count):
    rng = np.random.default_rng(5)
    corners = (rng.random((count, 1, 3)) * (1, 100, 1e-3) + rng.random((count, 3, 3)) * 0.01).astype(np.float32)
    tree = tree_of(corners)
    assert np.array_equal(np.sort(tree.order), np.arange(count))
    steps = (corners[tree.order].astype(np.float64) - tree.origin) * tree.scale
    for i in range(count):
        node = tree.first_leaf + i
        while node > 0:
            node, slot = (node - 1) // 4, (node - 1) % 4
            low, high = unpack(tree.nodes[node, :, slot])
            assert (low <= steps[i].min(axis=0)).all()
            assert (high >= steps[i].max(axis=0)).all()


def test_missing_children_have_empty_boxes():
    tree = tree_of(np.random.default_rng(0).random((5, 3, 3)).astype(np.float32))
    levels = {0: [0], 1: [1, 2]}  # five triangles make two nodes of triangles under one root
    missing = [(0, 2), (0, 3), (2, 1), (2, 2), (2, 3)]
    for node, slot in missing:
        low, high = unpack(tree.nodes[node, :, slot])
        assert (low > high).all()
    assert len(tree.nodes) == sum(map(len, levels.values()))
    assert tree.first_leaf == 5


@pytest.mark.parametrize("place", [0.0, 0.7, -3e4])
def test_a_single_point_lies_inside_its_box(place):
    corners = np.full((3, 3, 3), place, np.float32)
    tree = tree_of(corners)
    low, high = unpack(tree.nodes[0, :, 0])
    steps = (corners[0, 0].astype(np.float64) - tree.origin) * tree.scale
    assert (low <= steps).all()
    assert (steps <= high).all()
    assert (tree.scale < np.finfo(np.float32).max).all()


def test_flat_mesh_gets_a_finite_tree():
    corners = np.random.default_rng(1).random((64, 3, 3)).astype(np.float32)
    corners[..., 2] = 3.0
    tree = tree_of(corners)
    assert np.isfinite(tree.scale).all()
    assert np.isfinite(tree.nodes).all()


def test_neighbors_in_order_are_close_in_space_seed_2():
    """The boxes of four consecutive triangles are small."""
    corners = np.random.default_rng(2).random((4096, 1, 3)).astype(np.float32).repeat(3, axis=1)
    tree = tree_of(corners)
    centers = corners[tree.order, 0].reshape(-1, 4, 3)
    extent = (centers.max(axis=1) - centers.min(axis=1)).max(axis=1)
    assert np.median(extent) < 0.2  # unsorted, four points span 0.8


# Kd order


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
