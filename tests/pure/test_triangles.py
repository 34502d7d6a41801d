# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the arithmetic of triangles, and what they share, against closed forms: cubes, strips, fans, triangles without area."""

import numpy as np
import pytest

from addon.mesh import topology, triangles
from addon.mesh.topology import EdgeTable

CUBE = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
CUBE_FACES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
CUBE_TRIANGLES = np.concatenate([CUBE_FACES[:, [0, 1, 2]], CUBE_FACES[:, [0, 2, 3]]])
EXACT = 1e-12


def moebius(count=12):
    """A strip of `count` quads, its ends joined with half a turn."""
    quads = []
    for i in range(count):
        a, b, c, d = 2 * i, 2 * i + 1, 2 * i + 2, 2 * i + 3
        if i == count - 1:
            c, d = 1, 0
        quads += [(a, c, b), (b, c, d)]
    return np.array(quads)


def fan(count):
    """`count` triangles on one edge."""
    return np.array([(0, 1, 2 + i) for i in range(count)])


def test_the_faces_of_a_cube_point_outward_and_enclose_it():
    normals, twice = triangles.unit_normals(CUBE, CUBE_TRIANGLES)
    middles = CUBE[CUBE_TRIANGLES].mean(axis=1) - 0.5
    assert (np.abs(normals).max(axis=1) == 1.0).all()
    assert ((normals * middles).sum(axis=1) > 0.4).all()
    assert (twice == 1.0).all()
    assert triangles.face_areas(CUBE, CUBE_TRIANGLES).sum() == 6.0
    assert triangles.enclosed_volumes(CUBE[CUBE_TRIANGLES]).sum() == pytest.approx(6.0)
    assert np.abs(triangles.vertex_normals(CUBE, CUBE_TRIANGLES) - (2.0 * CUBE - 1.0) / 3.0**0.5).max() < EXACT


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_normals_of_corners_are_those_of_points_to_the_bit_seed_1(dtype):
    rng = np.random.default_rng(1)
    points, faces = rng.normal(size=(50, 3)).astype(dtype), rng.integers(0, 50, (80, 3))
    a, b, c = np.moveaxis(points[faces], 1, 0)
    normals = triangles.face_normals(points, faces)
    assert normals.dtype == dtype
    assert np.array_equal(normals, np.cross(b - a, c - a))
    assert np.array_equal(normals, triangles.face_normals(points[faces]))
    assert triangles.face_normals(points, faces, np.float64).dtype == np.float64


def test_triangles_without_area_have_no_normal_and_closest_points():
    points = np.array([(0.0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 0, 0)])
    faces = np.array([(0, 1, 2), (0, 0, 0), (1, 2, 3)])
    normals, areas = triangles.unit_normals(points, faces)
    assert not normals.any()
    assert not areas.any()
    asked = np.array([(1.5, 3.0, 0.0)] * 3)
    assert triangles.closest_points(asked, points[faces]).tolist() == [[1.5, 0, 0], [0, 0, 0], [1.5, 0, 0]]
    assert (triangles.barycentric(asked, points[faces]) == 1.0 / 3.0).all()


def test_barycentric_coordinates_give_the_place_back_and_end_at_the_rim_seed_2():
    rng = np.random.default_rng(2)
    corners, weights = rng.normal(size=(200, 3, 3)), rng.dirichlet(np.ones(3), 200)
    places = (corners * weights[..., None]).sum(axis=1)
    assert np.abs(triangles.barycentric(places, corners) - weights).max() < 1e-9
    above = places + triangles.unit(triangles.face_normals(corners))
    assert np.abs(triangles.barycentric(above, corners) - weights).max() < 1e-9
    outside = triangles.barycentric(3.0 * corners[:, 0] - corners[:, 1] - corners[:, 2], corners)
    assert np.abs(outside - (1.0, 0.0, 0.0)).max() < EXACT


def test_closest_points_lie_on_faces_edges_and_corners():
    corners = np.array([[(0.0, 0, 0), (1, 0, 0), (0, 1, 0)]] * 4)
    asked = np.array([(0.2, 0.2, 5.0), (0.5, -2.0, 0.0), (-1.0, -1.0, 1.0), (1.0, 1.0, 0.0)])
    assert triangles.closest_points(asked, corners).tolist() == [[0.2, 0.2, 0], [0.5, 0, 0], [0, 0, 0], [0.5, 0.5, 0]]


def test_angles_and_lengths():
    assert triangles.unit(np.array([(0.0, 0, 0), (0, 3, 0)])).tolist() == [[0, 0, 0], [0, 1, 0]]
    one, other = np.array([(1.0, 0, 0)] * 3), np.array([(1.0, 0, 0), (0, 1, 0), (-1, 0, 0)])
    assert np.degrees(triangles.angles_between(one, other)) == pytest.approx([0.0, 90.0, 180.0])
    near = np.array([np.cos(1e-6), np.sin(1e-6), 0.0])
    assert triangles.angles_between(one[0], near) == pytest.approx(1e-6, rel=1e-6)
    matrix = np.array([(0.0, -2, 0, 1), (2, 0, 0, 2), (0, 0, 2, 3), (0, 0, 0, 1)])
    assert triangles.transformed(np.eye(3), matrix).tolist() == [[1, 4, 3], [-1, 2, 3], [1, 2, 5]]


def test_the_edges_of_a_cube():
    edges = EdgeTable.of(CUBE_TRIANGLES)
    assert len(edges.counts) == 18
    assert (edges.counts == 2).all()
    assert edges.bad_edge_share == 0.0
    assert not len(edges.alone)
    assert (edges.ends[:, 0] < edges.ends[:, 1]).all()
    assert np.array_equal(edges.ends, np.unique(edges.ends, axis=0))
    assert np.array_equal(edges.keys, topology.edge_keys(*edges.ends[:, ::-1].T, edges.width))
    sides = np.stack([edges.first, edges.last], axis=1)
    assert np.array_equal(np.sort(sides, axis=1), edges.ends[edges.numbers])
    assert np.array_equal(edges.partners[edges.partners], np.arange(36))
    assert np.array_equal(edges.partners // 3, edges.neighbors.reshape(-1))


def test_a_moebius_strip_has_one_edge_against_or_more_and_one_border():
    edges = EdgeTable.of(moebius())
    assert np.count_nonzero(edges.is_against) == 1
    assert np.count_nonzero(edges.is_open) == 24
    assert edges.bad_edge_share == 1.0 / len(edges.counts)
    border = edges.ends[edges.is_open]
    assert (topology.connected(24, *border.T) == 0).all()  # one border, not two as of a ring


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_triangles_on_one_edge_lead_around_it(count):
    edges = EdgeTable.of(fan(count))
    middle = edges.keys == topology.edge_keys(np.array([1]), np.array([0]), edges.width)
    assert edges.counts[middle].tolist() == [count]
    assert edges.is_crowded.tolist() == (middle & (count > 2)).tolist()
    assert np.count_nonzero(edges.is_open) == 2 * count + (count == 1)
    across, expected = edges.neighbors, np.full((count, 3), -1)
    if count > 1:
        expected[:, 0] = np.roll(np.arange(count), -1)
    assert np.array_equal(across, expected)
    assert (edges.partners >= 0).sum() == (2 if count == 2 else 0)
    assert np.count_nonzero(edges.is_against) == (count == 2)
    assert edges.bad_edge_share == (count > 1) / len(edges.counts)


def test_edges_that_are_points_have_no_other_side():
    edges = EdgeTable.of(np.array([(0, 0, 1), (0, 0, 2)]))
    assert edges.neighbors.tolist() == [[-1, 0, 0], [-1, 1, 1]]
    assert (edges.partners[[0, 3]] == -1).all()


def test_keys_of_many_vertices_are_sorted_alike_seed_3():
    """Those that are too large to be packed with their sides are sorted in another way."""
    rng = np.random.default_rng(3)
    faces = rng.integers(0, 40, (60, 3))
    small, large = EdgeTable.of(faces), EdgeTable.of(faces, 2**31)
    assert np.array_equal(small.sides, large.sides)
    assert np.array_equal(small.ends, large.ends)
    assert len(EdgeTable.of(faces[:0]).keys) == 0


def test_places_exactly_or_nearly_the_same():
    points = np.float32([(0, 0, 0), (1, 0, 0), (-0.0, 0, 0), (1 + 1e-6, 0, 0), (1, 0, 0), (5, 5, 5)])
    assert topology.places(points).tolist() == [0, 1, 0, 3, 1, 5]
    assert topology.places(points, 1e-4).tolist() == [0, 1, 0, 1, 1, 5]
    chosen = np.array([True, False, True, True, True, False])
    assert topology.places(points, 1e-4, chosen).tolist() == [0, 1, 0, 3, 3, 5]
    assert topology.places(points[:0]).tolist() == []


@pytest.mark.parametrize("high_bits", [0, 7])
def test_the_first_of_equal_hashes_is_found_seed_8(high_bits):
    """Also of hashes that differ in their highest bits alone."""
    rng = np.random.default_rng(8)
    keys = rng.choice(rng.integers(0, 2**56, 40, np.uint64), 100)
    keys |= rng.integers(0, 2**high_bits, len(keys), np.uint64) << np.uint64(57)
    assert topology.firsts(keys).tolist() == [keys.tolist().index(key) for key in keys.tolist()]
    assert topology.firsts(keys[:0]).tolist() == []


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_components_are_those_of_a_flood(seed):
    """Numbered in the order of their lowest vertices."""
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 300, (90, 3)) if seed < 6 else np.arange(90).reshape(-1, 3)
    parts = [{vertex} for vertex in range(300)]
    for face in faces.tolist():
        joined = set().union(*(parts[vertex] for vertex in face))
        for vertex in joined:
            parts[vertex] = joined
    lowest = np.array([min(parts[face[0]]) for face in faces.tolist()])
    used, expected = np.unique(lowest, return_inverse=True)
    labels, count = topology.components(tuple(faces.T), 300)
    assert count == len(used)
    assert np.array_equal(labels, expected)
    assert topology.components(tuple(faces[:0].T), 300)[1] == 0
    assert np.array_equal(topology.connected(300, *EdgeTable.of(faces).ends.T), [min(part) for part in parts])


def test_small_helpers():
    assert topology.ranges(np.array([5, 0, 9]), np.array([2, 0, 3])).tolist() == [5, 6, 9, 10, 11]
    starts, lengths = topology.runs(np.array([True, True, False, True]))
    assert (starts.tolist(), lengths.tolist()) == ([0, 3], [2, 1])
    used, numbers = topology.numbered(np.array([[7, 2], [2, 9]]))
    assert (used.tolist(), numbers.tolist()) == ([2, 7, 9], [[1, 0], [0, 2]])
    sums = topology.sums_of(np.array([0, 2, 0]), np.array([(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)]), 3)
    assert sums.tolist() == [[6, 8], [0, 0], [3, 4]]
    assert topology.has_corners(np.array([(0, 1, 2), (0, 0, 2), (1, 0, 1)])).tolist() == [True, False, False]
