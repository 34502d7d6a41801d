# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals that triangles share: fewer, and the same at each corner to the bit."""

import numpy as np
import pytest

from addon.mesh.spatial import shared_normals


def grid(n):
    """Corners of n x n quads: their vertices (4 n^2,) and triangles (2 n^2, 3), indices into the corners."""
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1, 1)
    vertices = (first + [0, 1, n + 2, n + 1]).reshape(-1).astype(np.int32)
    triangles = (np.arange(n * n)[:, None, None] * 4 + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3).astype(np.int32)
    return (n + 1) ** 2, vertices, triangles


def by_corner(count, vertices, normals, triangles, domain=""):
    """The normals of all corners from `share` are those that went in, to the bit. Returns how many are left."""
    shared, numbers = shared_normals.share(count, vertices, normals, triangles, domain)
    assert numbers.shape == triangles.shape
    assert numbers.dtype == np.int32
    found = np.ascontiguousarray(shared[numbers]).view(np.int32)
    assert np.array_equal(found, np.ascontiguousarray(normals[triangles]).view(np.int32))
    return len(shared)


def random(rows, seed):
    return np.random.default_rng(seed).normal(size=(rows, 3)).astype(np.float32)


@pytest.mark.parametrize("domain", ["", "POINT"])
def test_smooth_normals_are_those_of_the_vertices_seed_1(domain):
    count, vertices, triangles = grid(5)
    assert by_corner(count, vertices, random(count, 1)[vertices], triangles, domain) == count


@pytest.mark.parametrize("domain", ["", "FACE"])
def test_flat_triangles_have_one_normal_each_seed_2(domain):
    count, vertices, triangles = grid(5)
    normals = np.repeat(random(len(vertices) // 4, 2), 4, axis=0)
    # Without a domain, the corners that gave the vertices their normals may keep them.
    most = len(triangles) + (0 if domain else count)
    assert by_corner(count, vertices, normals, triangles, domain) <= most


def test_hard_edges_add_normals_only_along_them_seed_3():
    count, vertices, triangles = grid(8)
    normals = random(count, 3)[vertices].reshape(-1, 4, 3)
    normals[28:32] *= np.float32(-1.0)  # half a row of quads
    # Those of four quads in a row: four corners at each of their ten vertices.
    assert count < by_corner(count, vertices, normals.reshape(-1, 3), triangles) <= count + 40


def test_corners_that_share_nothing_keep_their_normals_seed_4():
    count, vertices, triangles = grid(6)
    assert by_corner(count, vertices, random(len(vertices), 4), triangles) <= len(vertices) + count


def test_a_zero_with_a_sign_is_another_normal():
    count, vertices, triangles = grid(2)
    normals = np.zeros((len(vertices), 3), np.float32)
    normals[:4, 0] = -0.0
    by_corner(count, vertices, normals, triangles)


@pytest.mark.parametrize("axis", range(3))
def test_one_number_makes_another_normal_seed_9(axis):
    count, vertices, triangles = grid(3)
    normals = random(count, 9)[vertices]
    normals[0, axis] += np.float32(0.5)
    normals[19, axis] += np.float32(0.5)
    by_corner(count, vertices, normals, triangles)


def test_corners_that_no_triangle_uses_change_nothing_seed_5():
    count, vertices, triangles = grid(4)
    normals = random(count, 5)[vertices]
    normals[-4:] = np.nan  # of the last quad
    # They may have given four vertices their normals: then the other corners there have their own, nine in all.
    assert by_corner(count, vertices, normals, triangles[:-2]) <= count + 9


def test_mirrored_triangles_seed_7():
    """Mesh.front_triangles is a view backwards."""
    count, vertices, triangles = grid(4)
    flat = np.repeat(random(len(vertices) // 4, 8), 4, axis=0)
    by_corner(count, vertices, random(len(vertices), 7), triangles[:, ::-1])
    by_corner(count, vertices, flat, triangles[:, ::-1], "FACE")
