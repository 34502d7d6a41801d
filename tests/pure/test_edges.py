# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests neighbors and hard edges of triangles against plain loops over edges, and known answers."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from addon.mesh import edges
from addon.mesh.edges import has_area, neighbors, past_flat
from addon.mesh.triangle_mesh import Mesh


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


@pytest.mark.parametrize("seed", range(8))
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


@pytest.mark.parametrize("seed", range(4))
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


@pytest.mark.parametrize("seed", range(6))
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
