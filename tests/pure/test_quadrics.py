# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the quadrics of posed meshes: against sums of squared distances, and by planes that fold, unseen at rest."""

import numpy as np
import pytest

from addon.mesh import collapse
from addon.mesh.collapse import CollapseOptions, State
from addon.mesh.quadrics import Mapped, Moved
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import face_normals
from tests.pure.test_collapse import grid
from tests.pure.test_fitting import sphere


def turned(degrees, axis=0):
    """A rotation (3, 3) around an axis."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    matrix = np.eye(3)
    one, other = [each for each in range(3) if each != axis]
    matrix[[one, one, other, other], [one, other, one, other]] = cosine, -sine, sine, cosine
    return matrix


def motion_of(turn, shift, count):
    """The same matrices (1, V, 3, 4) for all vertices."""
    return np.tile(np.concatenate([turn, np.reshape(shift, (3, 1))], axis=1), (1, count, 1, 1))


def test_quadrics_of_a_pose_are_squared_distances_there():
    """Of places in the rest pose, with the motion between those of two vertices."""
    rng = np.random.default_rng(4)
    points, triangles = sphere(4)
    motions = rng.normal(0.0, 1.0, (len(points), 3, 4))
    weights = rng.uniform(0.5, 2.0, len(triangles))
    moved = Moved.of(points, triangles, weights, motions.copy())
    a, b = np.array([0, 3, 5]), np.array([1, 7, 2])
    planes, offsets, constants = moved.summed(a, b)
    places = rng.normal(0.0, 1.0, (3, 3))
    found = np.einsum("ei,eij,ej->e", places, planes, places) + 2.0 * (offsets * places).sum(axis=1) + constants
    posed = np.einsum("vij,vj->vi", motions[..., :3], points) + motions[..., 3]
    normals = face_normals(posed, triangles)
    areas = np.linalg.norm(normals, axis=1)
    normals /= areas[:, None]
    for number, (one, other) in enumerate(zip(a, b, strict=True)):
        between = 0.5 * (motions[one] + motions[other])
        there = between[:, :3] @ places[number] + between[:, 3]
        squares = weights * areas / 6.0 * ((there - posed[triangles[:, 0]]) * normals).sum(axis=1) ** 2
        expected = sum(squares[(triangles == vertex).any(axis=1)].sum() for vertex in (one, other))
        assert found[number] == pytest.approx(expected, rel=1e-9)


def test_a_mesh_that_moves_as_a_whole_becomes_what_it_is_at_rest():
    """At a higher price, since the pose says the same again."""
    points, triangles = sphere(8)
    points, weights = points * [1.0, 2.0, 0.7] + [5.0, -3.0, 1.0], np.ones(len(triangles))
    motions = motion_of(turned(70.0) @ turned(30.0, 2), (4.0, 5.0, 6.0), len(points))
    edges = EdgeTable.of(triangles)
    every = np.arange(len(edges.ends))
    rest, posed = (
        State.of(points, triangles, weights, moved)._new_placements(edges, every) for moved in (None, motions)
    )
    np.testing.assert_allclose(posed[0], rest[0], atol=1e-9)
    np.testing.assert_allclose(posed[1], (1.0 + collapse.IN_POSE) * rest[1], rtol=1e-3, atol=1e-9)


def fold(points):
    """Motions (1, V, 3, 4) that fold a plane by 90 degrees along the line x = 0."""
    result = motion_of(np.eye(3), np.zeros(3), len(points))
    result[0, points[:, 0] > 1e-6, :, :3] = turned(90.0, 1)
    return result


def test_a_plane_keeps_the_line_along_which_it_folds():
    points, triangles = grid(16)
    is_across = []
    for motions in (None, fold(points)):
        places, left = collapse.collapse(points, triangles, CollapseOptions(24, motions=motions))
        assert len(left) in (23, 24)
        x = places[left][..., 0]
        is_across.append(((x.min(axis=1) < -1e-4) & (x.max(axis=1) > 1e-4)).any())
    assert is_across == [True, False]


def test_motions_lie_between_those_of_the_ends():
    """Turns and shifts that are linear along x stay linear: what is left has those of its place."""
    points, triangles = grid(12)
    points = points + [0.0, 0.0, 0.2] * np.sin(2.0 * points[:, :1] + points[:, 1:2] ** 2)
    share = 0.5 + 0.5 * points[:, 0]
    motions = np.eye(3, 4) + share[:, None, None] * (
        np.concatenate([turned(50.0, 1), np.ones((3, 1))], axis=1) - np.eye(3, 4)
    )
    state = State(points, triangles, (np.zeros((169, 3, 3)), np.zeros((169, 3)), np.zeros(169)))
    moved = Moved.of(points, triangles, np.ones(len(triangles)), motions.copy())
    state._poses.append(moved)
    state.run(80)
    used = np.unique(state.triangles)
    far = np.abs(moved.motions[used, 0, 3] - (0.5 + 0.5 * state.points[used, 0]))
    assert len(used) < 60 and far.mean() < 0.015  # places lie off the edges


def test_a_posed_mesh_on_its_way_stands_for_all_faces():
    points, triangles = sphere(16)
    motions = motion_of(turned(40.0), (1.0, 2.0, 3.0), len(points))
    weights = np.ones(len(triangles))
    whole, again = (State.of(points, triangles, weights, motions) for _ in range(2))
    whole.run(300)
    again.resume(collapse.partial_collapse(points, triangles, CollapseOptions(300, motions=motions)))
    used = np.unique(whole.triangles)
    (one,), (other,) = whole._poses, again._poses
    for before, now in zip((*one.quadrics, one.motions), (*other.quadrics, other.motions), strict=True):
        np.testing.assert_allclose(now[used], before[used], atol=1e-9)
    assert (EdgeTable.of(again.triangles).counts == 2).all()


def test_quadrics_of_places_are_squares_of_ways_along_the_triangle():
    """To where a UV lies in its plane, for a third of its area. A triangle without an area in the layout says nothing."""
    dice = np.random.default_rng(4)
    corners, uv = dice.normal(size=(2, 3, 3)), dice.random((2, 3, 2))
    uv[1] = uv[1, :1]
    maps = Mapped.of(corners, uv, np.arange(6).reshape(2, 3), np.array([2.0, 1.0]))
    place, shares = dice.normal(size=3), np.array([0.2, 0.7, 0.1])
    planes, offsets, constants = maps.at(np.arange(6), np.repeat(np.einsum("c,tcx->tx", shares, uv), 3, axis=0))
    found = place @ planes @ place + 2.0 * offsets @ place + constants
    normal = face_normals(corners)[0]
    way = place - shares @ corners[0]
    way -= normal * (way @ normal) / (normal @ normal)
    expected = 2.0 * 0.5 * np.linalg.norm(normal) / 3.0 * (way @ way)
    assert found == pytest.approx([expected] * 3 + [0.0] * 3)
    maps.merge(np.array([1, 1, 2, 3, 4, 5]))
    merged, _, _ = maps.at(np.arange(2), np.zeros((2, 2)))
    assert merged == pytest.approx(np.stack([0.0 * planes[0], 2.0 * planes[0]]))
