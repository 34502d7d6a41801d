# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests neighbors and hard edges of triangles against plain loops over edges, and known answers."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from addon.core import threads
from addon.mesh import edges, face_shapes, shared_values, subdividing
from addon.mesh.edges import has_area, neighbors, past_flat
from addon.mesh.triangle_mesh import CORNER_BLOCK, FaceCorners, Mesh
from tests.support import random_cases


def by_edge(points, triangles):
    """The (triangle, corner) pairs at each edge, by the places of its ends, without edges of no length."""
    found = defaultdict(list)
    for number, triangle in enumerate(triangles):
        for k in range(3):
            ends = frozenset(tuple(points[triangle[i % 3]] + 0.0) for i in (k, k + 1))
            if len(ends) == 2:
                found[ends].append((number, k))
    return found


def check(points, triangles):
    """Compare with a loop: one neighbor where two triangles meet, a circle of all where more do, none at a border."""
    points, triangles = np.float32(points), np.asarray(triangles)
    found = neighbors(points, triangles)
    assert found.shape == triangles.shape
    assert np.issubdtype(found.dtype, np.integer)
    seen = np.zeros(triangles.shape, bool)
    for places in by_edge(points, triangles).values():
        for number, k in places:
            seen[number, k] = True
        across = [found[place] for place in places]
        numbers = [number for number, _ in places]
        if len(places) == 1:
            assert across == [-1]
            continue
        # From each, steps across reach every other one before the first again.
        assert sorted(across) == sorted(numbers)
        if len(set(numbers)) == len(numbers):
            step, at, reached = dict(zip(numbers, across, strict=True)), numbers[0], []
            for _ in numbers:
                at = step[at]
                reached.append(at)
            assert sorted(reached) == sorted(numbers)
    assert (found[~seen] == -1).all()
    return found


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def test_neighbors_of_two_triangles():
    assert check(SQUARE, [(0, 1, 2), (0, 2, 3)]).tolist() == [[-1, -1, 1], [0, -1, -1]]


def test_split_vertices_are_the_same_place():
    points = [*SQUARE[:3], SQUARE[0], *SQUARE[2:]]
    assert check(points, [(0, 1, 2), (3, 4, 5)]).tolist() == [[-1, -1, 1], [0, -1, -1]]


def test_minus_zero_is_zero():
    points = [(0.0, 0.0, 0.0), (1, 0, 0), (1, 1, 0), (-0.0, 0.0, -0.0), (1, 1, -0.0), (0, 1, 0)]
    assert neighbors(np.float32(points), np.array([(0, 1, 2), (3, 4, 5)])).tolist() == [[-1, -1, 1], [0, -1, -1]]


def test_either_winding_is_a_neighbor():
    assert check(SQUARE, [(0, 1, 2), (0, 3, 2)]).tolist() == [[-1, -1, 1], [-1, -1, 0]]


def test_several_triangles_at_an_edge_lead_around():
    points = [*SQUARE, (0.5, 0.5, 1), (0.5, 0.5, -1)]
    check(points, [(0, 2, 1), (0, 2, 3), (2, 0, 4), (0, 2, 5)])


@pytest.mark.parametrize("triangle", [(0, 0, 1), (1, 1, 1), (0, 1, 0)])
def test_edges_without_length_have_no_neighbor(triangle):
    check(SQUARE, [triangle, (0, 1, 2)])


@random_cases.seeds(8, fast=2)
def test_neighbors_in_a_tangle(seed):
    """Few points in few places, so that many triangles share each edge, and some are there twice or degenerate."""
    rng = np.random.default_rng(seed)
    places = rng.integers(-1, 2, (12, 3)).astype(np.float32) * np.float32(rng.choice([1.0, -1.0], (12, 1)))
    triangles = rng.integers(0, 12, (60, 3))
    check(places, triangles)


def test_neighbors_of_a_single_triangle_and_of_none():
    assert neighbors(np.float32(SQUARE), np.array([(0, 1, 2)])).tolist() == [[-1, -1, -1]]
    assert neighbors(np.float32(SQUARE), np.zeros((0, 3), int)).shape == (0, 3)


def past(points, triangles):
    points, triangles = np.float32(points), np.array(triangles)
    return [found.tolist() for found in past_flat(points, triangles, has_area(points, triangles))]


def test_triangles_without_area_are_passed_over():
    """Between the two halves of a square lies one whose third corner is in the place of its second."""
    across, nearest = past([*SQUARE, (1, 1, 0)], [(0, 1, 2), (0, 2, 4), (0, 4, 3)])
    assert across == [[-1, -1, 2], [-1, -1, -1], [0, -1, -1]]
    assert nearest[1] in (0, 2)
    assert nearest[::2] == [0, 2]


def test_a_needle_is_passed_over_and_leads_to_its_neighbor():
    across, nearest = past([*SQUARE, (1, 0.5, 1e-7)], [(0, 1, 2), (0, 2, 3), (1, 2, 4)])
    assert across == [[-1, -1, 1], [0, -1, -1], [-1, -1, -1]]
    assert nearest == [0, 1, 0]


def test_a_needle_leads_across_its_longest_edge():
    """It has a neighbor at each edge."""
    points = [(0, 0, 0), (3, 0, 0), (1, 0, 0), (0, 1, 0), (3, 1, 0), (1, -1, 0)]
    _, nearest = past(points, [(0, 2, 3), (0, 1, 2), (2, 1, 4), (1, 0, 5)])
    assert nearest == [0, 3, 2, 3]


def test_a_triangle_without_area_and_neighbors_stays_itself():
    assert past([*SQUARE, (2, 0, 0), (3, 0, 0)], [(0, 1, 2), (4, 5, 5)]) == [[[-1, -1, -1], [-1, -1, -1]], [0, 1]]
    assert past([(0, 0, 0)], [(0, 0, 0)]) == [[[-1, -1, -1]], [0]]


@random_cases.seeds(4, fast=2)
def test_without_flat_triangles_the_neighbors_are_all(seed):
    rng = np.random.default_rng(seed)
    points, triangles = (
        rng.random((12, 3)).astype(np.float32),
        rng.permuted(np.tile(np.arange(12), (40, 1)), axis=1)[:, :3],
    )
    across, nearest = past(points, triangles)
    assert across == neighbors(points, triangles).tolist()
    assert nearest == list(range(40))


# Hard edges


def corners_mesh(points, triangles, normals=None, *, split=False):
    """A mesh of triangles (T, 3), indices into points (V, 3), with corner normals (T, 3, 3): the faces' by default.

    split: no two triangles share a vertex.
    """
    points, triangles = np.float32(points), np.asarray(triangles)
    vertices = triangles.reshape(-1)
    if normals is None:
        a, b, c = (points[triangles[:, k]].astype(np.float64) for k in range(3))
        faces = np.cross(b - a, c - a)
        faces /= np.maximum(np.linalg.norm(faces, axis=1, keepdims=True), 1e-30)
        normals = np.repeat(faces[:, None], 3, axis=1)
    if split:
        points, vertices = points[vertices], np.arange(len(vertices))
    return Mesh(
        name="mesh",
        positions=points,
        vertices=vertices.astype(np.int32),
        normals=np.float32(normals).reshape(-1, 3),
        triangles=np.arange(len(vertices), dtype=np.int32).reshape(-1, 3),
        to_world=np.eye(4),
    )


def listed(mesh):
    """The hard edges: the places of their ends, with the angle between the faces in degrees, once per side."""
    ends, cosines = edges.hard_edges(mesh)
    assert ends.shape == (len(cosines), 2)
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    return sorted(
        (tuple(sorted(map(tuple, (mesh.positions[pair] + 0.0).tolist()))), round(float(angle), 2))
        for pair, angle in zip(ends, angles, strict=True)
    )


def roof(degrees):
    """Two quads that share the edge from (0, 0, 0) to (0, 1, 0); their normals are `degrees` apart."""
    x, z = np.cos(np.radians(degrees)), -np.sin(np.radians(degrees))
    points = [(-1, 0, 0), (0, 0, 0), (0, 1, 0), (-1, 1, 0), (x, 0, z), (x, 1, z)]
    return points, [(0, 1, 2), (0, 2, 3), (1, 4, 5), (1, 5, 2)]


RIDGE = ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("degrees", [5.0, 30.0, 90.0, 135.0])
def test_a_hard_edge_is_listed_from_both_sides_with_its_angle(degrees, split):
    assert listed(corners_mesh(*roof(degrees), split=split)) == [(RIDGE, degrees)] * 2


@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_angles_between_faces_are_those_in_the_scene(mirrored):
    points, triangles = roof(90.0)
    turned = np.array(points) @ [(1, 0, 1), (0, 1, 0), (-1, 0, 1)]  # both sides slope by 45 degrees
    mesh = replace(corners_mesh(turned, triangles), to_world=np.diag([1.0, 1.0, mirrored * np.sqrt(3.0), 1.0]))
    assert [angle for _, angle in listed(mesh)] == [120.0] * 2


def test_small_differences_and_smooth_edges_are_not_hard():
    assert listed(corners_mesh(*roof(0.9))) == []
    assert len(listed(corners_mesh(*roof(1.1)))) == 2
    points, triangles = roof(90.0)
    smooth = np.tile((0.0, 0.0, 1.0), (len(triangles), 3, 1))
    assert listed(corners_mesh(points, triangles, smooth)) == []


def test_normals_that_differ_at_one_end_make_an_edge_hard():
    points, triangles = roof(90.0)
    normals = np.tile((0.0, 0.0, 1.0), (len(triangles), 3, 1))
    normals[2, 0] = 1.0, 0.0, 0.0  # of the corner at (0, 0, 0), on the right
    normals[3, 0] = 1.0, 0.0, 0.0
    assert listed(corners_mesh(points, triangles, normals)) == [(RIDGE, 90.0)] * 2


def test_minus_zero_is_the_same_place_as_zero():
    points, triangles = roof(90.0)
    mesh = corners_mesh(points, triangles, split=True)
    mesh.positions[6:][mesh.positions[6:] == 0.0] = -0.0
    assert listed(mesh) == [(RIDGE, 90.0)] * 2


def test_the_angle_does_not_depend_on_the_winding():
    points, triangles = roof(40.0)
    turned = [triangle[::-1] for triangle in triangles[2:]]
    normals = corners_mesh(points, triangles).normals.reshape(-1, 3, 3)
    normals[2:] = normals[2:, ::-1]
    assert listed(corners_mesh(points, triangles[:2] + turned, normals)) == [(RIDGE, 40.0)] * 2


def test_borders_and_edges_of_three_faces_are_not_listed():
    points, triangles = roof(90.0)
    assert listed(corners_mesh(points, triangles[:2])) == []
    third = [*points, (0, 0, 1), (0, 1, 1)]
    assert listed(corners_mesh(third, [*triangles, (1, 6, 7), (1, 7, 2)])) == []


@random_cases.seeds(6, fast=2)
def test_hard_edges_of_a_rough_sheet(seed):
    """Against a loop over the edges, with random normals at some corners, split vertices, and degenerate triangles."""
    rng = np.random.default_rng(seed)
    side = 6
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    points = np.stack([x.ravel(), y.ravel(), rng.normal(0, 0.3, side * side)], axis=1)
    first = (x[:-1, :-1] + y[:-1, :-1] * side).ravel()
    triangles = np.concatenate(
        [np.stack([first, first + 1, first + side + 1], 1), np.stack([first, first + side + 1, first + side], 1)]
    )
    triangles[rng.integers(0, len(triangles), 3), 2] = triangles[0, 0]
    normals = np.tile((0.0, 0.0, 1.0), (len(triangles), 3, 1))
    is_turned = rng.random((len(triangles), 3)) < 0.15
    normals[is_turned] = (0.6, 0.0, 0.8)
    mesh = corners_mesh(points, triangles, normals, split=bool(seed % 2))
    expected = []
    for ends, places in by_edge(np.float32(points), triangles).items():
        if len(places) != 2 or places[0][0] == places[1][0]:
            continue
        corners = [
            {tuple(np.float32(points[triangles[t, (k + i) % 3]]).tolist()): normals[t, (k + i) % 3] for i in (0, 1)}
            for t, k in places
        ]
        if any((corners[0][place] != corners[1][place]).any() for place in corners[0]):
            expected += [tuple(sorted(tuple(map(float, end)) for end in ends))] * 2
    assert expected
    assert [ends for ends, _ in listed(mesh)] == sorted(expected)


# Face corners


@random_cases.seeds(6, fast=2)
def test_what_is_found_equals_a_search_through_all(seed):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(3, 7, 400)
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    count = 300
    # Close faces have close vertices, as in meshes that programs make; then in any order.
    near = np.repeat(np.linspace(0, count - 20, len(sizes)).astype(int), sizes)
    vertices = near + rng.integers(0, 20, len(near)) if seed % 2 else rng.integers(0, count, len(near))
    faces = FaceCorners(starts, vertices.astype(np.int32))
    assert len(vertices) > 2 * CORNER_BLOCK
    wanted = np.unique(rng.integers(0, count, rng.integers(1, 40)))
    corners = faces.corners_at(wanted, count)
    assert np.array_equal(corners, np.flatnonzero(np.isin(vertices, wanted)))
    face_of = np.repeat(np.arange(len(sizes)), sizes)
    found = faces.faces_of(corners)
    assert np.array_equal(found, np.unique(face_of[corners]))
    assert np.array_equal(faces.corners_of(found), np.flatnonzero(np.isin(face_of, found)))
    assert np.array_equal(faces.sizes(found), sizes[found])
    of_triangles = np.repeat(np.arange(len(sizes)), sizes - 2)
    assert np.array_equal(faces.triangles_of(found), np.flatnonzero(np.isin(of_triangles, found)))


def test_no_vertices_have_no_corners():
    faces = FaceCorners(np.array([0, 3], np.int32), np.array([0, 1, 2], np.int32))
    corners = faces.corners_at(np.empty(0, int), 3)
    assert len(corners) == len(faces.faces_of(corners)) == len(faces.corners_of(faces.faces_of(corners))) == 0


# Face shapes


CUTS = {"first and third": [(0, 1, 2), (0, 2, 3)], "second and fourth": [(0, 1, 3), (1, 2, 3)]}


def mesh(points, triangles, numbers, *, normals=None, to_world=None):
    """A mesh in which each corner has its own point."""
    vertices = np.arange(len(points))
    return Mesh(
        name="low",
        positions=np.asarray(points, np.float32),
        vertices=np.asarray(vertices, np.int32),
        normals=np.asarray(np.zeros((len(points), 3)) if normals is None else normals, np.float32),
        triangles=np.asarray(triangles, np.int32),
        to_world=np.eye(4) if to_world is None else to_world,
        faces=np.asarray(numbers, np.int32),
    )


def quad(height=0.0, cut="first and third", to_world=None):
    """A square of side 1 with one corner lifted."""
    points = [(0, 0, 0), (1, 0, 0), (1, 1, height), (0, 1, 0)]
    return mesh(points, CUTS[cut], [0, 0], to_world=to_world)


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize(("degrees", "is_non_planar"), [(0.0, False), (0.9, False), (1.1, True), (40.0, True)])
def test_quad_is_non_planar_by_the_angle_between_its_triangulations(cut, degrees, is_non_planar):
    # One triangulation has a triangle in the plane. Both triangles of the other are tilted against the plane, but less
    # against the lifted triangle.
    assert face_shapes.non_planar(quad(np.tan(np.radians(degrees)), cut)).tolist() == [is_non_planar]


def test_angles_include_the_scale_of_the_object():
    tall = quad(0.001, to_world=np.diag([1.0, 1.0, 100.0, 1.0]))
    assert not face_shapes.non_planar(quad(0.001)).any()
    assert face_shapes.non_planar(tall).all()


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_result_does_not_depend_on_size(scale):
    to_world = np.diag([scale, scale, scale, 1.0])
    assert face_shapes.non_planar(quad(0.1, to_world=to_world)).all()
    assert not face_shapes.non_planar(quad(0.0, to_world=to_world)).any()


def test_concave_quad_is_non_planar_where_a_diagonal_lies_outside():
    dart = [(0, 0, 0), (2, -1, 0), (0.5, 0, 0), (2, 1, 0)]
    assert face_shapes.non_planar(mesh(dart, CUTS["first and third"], [0, 0])).all()


def test_planar_quad_with_three_corners_in_line_is_planar():
    assert not face_shapes.non_planar(
        mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0)], CUTS["second and fourth"], [0, 0])
    ).any()


@pytest.mark.parametrize("turn", range(4))
def test_one_tilted_sliver_makes_a_quad_non_planar(turn):
    points = [(0, 0, 0), (2, -1, 0), (1, 2, 0), (0.48, 1.01, 0.01)]
    assert face_shapes.non_planar(mesh(points[turn:] + points[:turn], CUTS["first and third"], [0, 0])).all()


@pytest.mark.parametrize(("height", "is_non_planar"), [(0.0, False), (0.01, False), (0.2, True)])
def test_n_gon_with_a_lifted_corner_is_non_planar(height, is_non_planar):
    angles = 2 * np.pi * np.arange(6) / 6
    points = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    points[3, 2] = height
    fan = [(0, i, i + 1) for i in range(1, 5)]
    assert face_shapes.non_planar(mesh(points, fan, [0] * 4)).tolist() == [is_non_planar]


def test_mixed_faces_are_reported_by_face_index():
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    points += [(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 0)]
    points += [(0, 0, 0), (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0)]
    triangles = [(0, 1, 2), (3, 4, 5), (3, 5, 6), (7, 8, 9), (7, 9, 10), (7, 10, 11)]
    mixed = mesh(points, triangles, [0, 1, 1, 2, 2, 2])
    assert face_shapes.non_triangles(mixed).tolist() == [False, True, True]
    assert face_shapes.non_planar(mixed).tolist() == [False, True, False]


TRIANGLE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]


@pytest.mark.parametrize("corner", range(3))
@pytest.mark.parametrize(
    ("degrees", "is_behind"), [(0, False), (89, False), (91, True), (180, True), (269, True), (271, False)]
)
def test_one_normal_behind_its_triangle_is_found(corner, degrees, is_behind):
    normals = np.tile((0.0, 0.0, 1.0), (3, 1))
    normals[corner] = np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))
    assert face_shapes.normals_behind(mesh(TRIANGLE, [(0, 1, 2)], [0], normals=normals)).tolist() == [is_behind]
    assert face_shapes.normals_behind(mesh(TRIANGLE, [(0, 2, 1)], [0], normals=-normals)).tolist() == [is_behind]


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_triangle_without_area_has_no_normals_behind(scale):
    behind = np.tile((0.0, 0.0, -1.0), (6, 1))
    points = np.array([*TRIANGLE, (0, 0, 0), (1, 0, 0), (2, 0, 0)]) * scale
    assert face_shapes.normals_behind(mesh(points, [(0, 1, 2), (3, 4, 5)], [0, 1], normals=behind)).tolist() == [
        True,
        False,
    ]


def test_all_triangles_are_checked_across_blocks():
    """The count is more than one block, and not a multiple of a block."""
    count = threads.ELEMENTS_AT_ONCE + 3
    points, normals = np.tile(TRIANGLE, (count, 1)), np.tile((0.0, 0.0, 1.0), (3 * count, 1))
    truth = np.arange(count) % 7 == 0
    normals[::3][truth] *= -1.0
    found = face_shapes.normals_behind(mesh(points, np.arange(3 * count).reshape(-1, 3), range(count), normals=normals))
    np.testing.assert_array_equal(found, truth)


# Shared values


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


# Subdividing


CORNERS = np.array([(0, 0), (4, 0), (0, 2), (5, 5), (5, 6), (7, 5)], np.float32)
TRIANGLES = np.array([(0, 1, 2), (3, 4, 5)])


def doubled_areas(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


@pytest.mark.parametrize("counts", [(1, 1), (2, 5), (7, 1), (3, 3)])
def test_pieces_are_equal_and_fill_their_triangle(counts):
    pieces = subdividing.divide(np.array(counts))
    points = pieces.interpolate(CORNERS, TRIANGLES)
    areas, parents = doubled_areas(points, pieces.triangles), pieces.parents[pieces.triangles]
    for number, (count, whole) in enumerate(zip(counts, doubled_areas(CORNERS, TRIANGLES), strict=True)):
        own = areas[(parents == number).all(axis=1)]
        assert len(own) == count**2
        assert np.allclose(own, whole / count**2, rtol=1e-4)  # equal areas of the same sign
    assert len(areas) == sum(count**2 for count in counts)


def test_corners_stay_where_they_are():
    pieces = subdividing.divide(np.array([4, 2]))
    points = pieces.interpolate(CORNERS, TRIANGLES)
    assert {tuple(corner) for corner in CORNERS} <= {tuple(point) for point in points}


def test_nothing_has_no_pieces():
    pieces = subdividing.divide(np.zeros(0, int))
    assert len(pieces.triangles) == len(pieces.interpolate(CORNERS, TRIANGLES)) == 0
