# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that triangles share: fewer, and the same at each corner to the bit."""

import numpy as np
import pytest

from addon.mesh import shared_values


def grid(n):
    """Corners of n x n quads: their vertices (4 n^2,) and triangles (2 n^2, 3), indices into the corners."""
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1, 1)
    vertices = (first + [0, 1, n + 2, n + 1]).reshape(-1).astype(np.int32)
    triangles = (np.arange(n * n)[:, None, None] * 4 + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3).astype(np.int32)
    return (n + 1) ** 2, vertices, triangles


def kept(*meshes):
    """How many values are left of meshes: the arguments of `share`. Those of all corners are what went in, to the bit."""
    counts = [mesh[0] for mesh in meshes]
    values, own = shared_values.joined([shared_values.share(*mesh) for mesh in meshes], counts)
    before = np.cumsum([0, *counts[:-1]])
    vertices = [mesh[1][mesh[3]] + first for first, mesh in zip(before, meshes, strict=True)]
    places = shared_values.places(own, np.concatenate(vertices))
    assert places.dtype == own.dtype == np.int32
    expected = np.concatenate([mesh[2][mesh[3]] for mesh in meshes])
    assert np.array_equal(np.ascontiguousarray(values[places]).view(np.int32), expected.view(np.int32))
    return len(values)


def random(rows, seed, channels=3):
    return np.random.default_rng(seed).normal(size=(rows, channels)).astype(np.float32)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("domain", ["", "POINT"])
def test_smooth_values_are_those_of_the_vertices_seed_1(domain, channels):
    count, vertices, triangles = grid(5)
    assert kept((count, vertices, random(count, 1, channels)[vertices], triangles, domain)) == count


@pytest.mark.parametrize("domain", ["", "FACE"])
def test_flat_triangles_have_one_value_each_seed_2(domain):
    count, vertices, triangles = grid(5)
    values = np.repeat(random(len(vertices) // 4, 2), 4, axis=0)
    # Without a domain, the corners that gave the vertices their values may keep them.
    most = len(triangles) + (0 if domain else count)
    assert kept((count, vertices, values, triangles, domain)) <= most


def test_hard_edges_add_values_only_along_them_seed_3():
    count, vertices, triangles = grid(8)
    values = random(count, 3)[vertices].reshape(-1, 4, 3)
    values[28:32] *= np.float32(-1.0)  # half a row of quads
    # The triangles that touch the ten vertices of these quads: three for each, at each corner.
    assert count < kept((count, vertices, values.reshape(-1, 3), triangles)) <= count + 3 * 28


def test_corners_that_share_nothing_keep_their_values_seed_4():
    count, vertices, triangles = grid(6)
    assert kept((count, vertices, random(len(vertices), 4), triangles)) <= triangles.size + count


def test_a_zero_with_a_sign_is_another_value():
    count, vertices, triangles = grid(2)
    values = np.zeros((len(vertices), 3), np.float32)
    values[:4, 0] = -0.0
    kept((count, vertices, values, triangles))


@pytest.mark.parametrize("axis", range(3))
def test_one_number_makes_another_value_seed_9(axis):
    count, vertices, triangles = grid(3)
    values = random(count, 9)[vertices]
    values[0, axis] += np.float32(0.5)
    values[19, axis] += np.float32(0.5)
    kept((count, vertices, values, triangles))


def test_corners_that_no_triangle_uses_change_nothing_seed_5():
    count, vertices, triangles = grid(4)
    values = random(count, 5)[vertices]
    values[-4:] = np.nan  # of the last quad
    kept((count, vertices, values, triangles[:-2]))


def test_mirrored_triangles_seed_7():
    """Mesh.front_triangles is a view backwards."""
    count, vertices, triangles = grid(4)
    flat = np.repeat(random(len(vertices) // 4, 8), 4, axis=0)
    kept((count, vertices, random(len(vertices), 7), triangles[:, ::-1]))
    kept((count, vertices, flat, triangles[:, ::-1], "FACE"))


def test_several_meshes_are_joined_seed_11():
    """Smooth, flat, and mixed ones: numbers go on from mesh to mesh, whichever have values of vertices."""
    count, vertices, triangles = grid(4)
    smooth = count, vertices, random(count, 11)[vertices], triangles, "POINT"
    flat = count, vertices, np.repeat(random(len(vertices) // 4, 12), 4, axis=0), triangles, "FACE"
    mixed = count, vertices, random(len(vertices), 13), triangles, ""
    for meshes in ([smooth, flat, mixed], [flat, smooth], [flat, flat], [mixed, mixed, smooth]):
        kept(*meshes)
    assert kept(flat, flat) == 2 * len(triangles)
