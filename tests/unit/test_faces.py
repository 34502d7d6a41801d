# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces that are not flat, and triangles that hang together, on meshes where both are known."""

import numpy as np
import pytest

from addon.mesh import faces
from addon.mesh.arrays import Mesh

CUTS = {"first and third": [(0, 1, 2), (0, 2, 3)], "second and fourth": [(0, 1, 3), (1, 2, 3)]}


def mesh(points, triangles, numbers, *, uv=None, vertices=None, to_world=None):
    """Corners are points of their own unless `vertices` says otherwise."""
    vertices = np.arange(len(points)) if vertices is None else vertices
    return Mesh(
        name="low",
        positions=np.asarray(points, np.float32),
        vertices=np.asarray(vertices, np.int32),
        normals=np.zeros((len(vertices), 3), np.float32),
        triangles=np.asarray(triangles, np.int32),
        to_world=np.eye(4) if to_world is None else to_world,
        uv=None if uv is None else np.asarray(uv, np.float32),
        faces=np.asarray(numbers, np.int32),
    )


def quad(height=0.0, cut="first and third", to_world=None):
    """A square of side 1 with one corner lifted."""
    points = [(0, 0, 0), (1, 0, 0), (1, 1, height), (0, 1, 0)]
    return mesh(points, CUTS[cut], [0, 0], to_world=to_world)


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize(("degrees", "is_uneven"), [(0.0, False), (0.9, False), (1.1, True), (40.0, True)])
def test_a_lifted_corner_by_the_angle_between_both_ways_to_cut(cut, degrees, is_uneven):
    # Cut one way, a triangle stays in the plane, and both of the other way lean out of it along a side; these and the
    # lifted one lean less against each other.
    assert faces.uneven(quad(np.tan(np.radians(degrees)), cut)).tolist() == [is_uneven]


def test_angles_are_those_of_the_object_as_it_is_scaled():
    tall = quad(0.001, to_world=np.diag([1.0, 1.0, 100.0, 1.0]))
    assert not faces.uneven(quad(0.001)).any()
    assert faces.uneven(tall).all()


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_size_does_not_matter(scale):
    to_world = np.diag([scale, scale, scale, 1.0])
    assert faces.uneven(quad(0.1, to_world=to_world)).all()
    assert not faces.uneven(quad(0.0, to_world=to_world)).any()


def test_an_arrowhead_may_be_cut_outside_of_itself():
    dart = [(0, 0, 0), (2, -1, 0), (0.5, 0, 0), (2, 1, 0)]
    assert faces.uneven(mesh(dart, CUTS["first and third"], [0, 0])).all()


def test_a_quad_with_three_corners_in_line_is_flat():
    assert not faces.uneven(mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0)], CUTS["second and fourth"], [0, 0])).any()


@pytest.mark.parametrize("turn", range(4))
def test_a_sliver_leans_where_all_other_triangles_lie_flat(turn):
    points = [(0, 0, 0), (2, -1, 0), (1, 2, 0), (0.48, 1.01, 0.01)]
    assert faces.uneven(mesh(points[turn:] + points[:turn], CUTS["first and third"], [0, 0])).all()


@pytest.mark.parametrize(("height", "is_uneven"), [(0.0, False), (0.01, False), (0.2, True)])
def test_an_n_gon_with_a_lifted_corner(height, is_uneven):
    angles = 2 * np.pi * np.arange(6) / 6
    points = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    points[3, 2] = height
    fan = [(0, i, i + 1) for i in range(1, 5)]
    assert faces.uneven(mesh(points, fan, [0] * 4)).tolist() == [is_uneven]


def test_triangles_quads_and_n_gons_each_by_its_number():
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    points += [(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 0)]
    points += [(0, 0, 0), (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0)]
    triangles = [(0, 1, 2), (3, 4, 5), (3, 5, 6), (7, 8, 9), (7, 9, 10), (7, 10, 11)]
    mixed = mesh(points, triangles, [0, 1, 1, 2, 2, 2])
    assert faces.polygons(mixed).tolist() == [False, True, True]
    assert faces.uneven(mixed).tolist() == [False, True, False]


def grid(n):
    """The triangles of n x n quads and their (n + 1)^2 vertices' coordinates."""
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    first = (i + j * (n + 1)).ravel()
    triangles = np.concatenate(
        [np.stack([first, first + 1, first + n + 2], 1), np.stack([first, first + n + 2, first + n + 1], 1)]
    )
    u, v = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    return triangles, np.stack([u.ravel(), v.ravel()], axis=1) / n


def groups(corners, chosen):
    """How many groups triangles form that share a corner: by merging one after another."""
    parts = []
    for triangle in (set(row) for row, wanted in zip(corners, chosen, strict=True) if wanted):
        touching = [part for part in parts if part & triangle]
        parts = [part for part in parts if not part & triangle] + [triangle.union(*touching)]
    return len(parts)


@pytest.mark.parametrize("seed", range(4))
def test_islands_of_random_triangles_of_a_grid(seed):
    rng = np.random.default_rng(seed)
    triangles, uv = grid(12)
    triangles = rng.permutation(triangles)
    chosen = rng.random(len(triangles)) < 0.25
    # Corner by corner, as Blender has them.
    corners = np.arange(3 * len(triangles)).reshape(-1, 3)
    low = mesh(
        np.zeros((len(uv), 3)), corners, range(len(corners)), uv=uv[triangles.ravel()], vertices=triangles.ravel()
    )
    truth = groups(triangles.tolist(), chosen)
    assert 5 < truth < chosen.sum()
    assert faces.islands(low, chosen) == truth


def test_islands_end_at_seams_and_do_not_meet_where_they_lie_on_each_other():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    apart = [(2, 0), (3, 0), (3, 1), (2, 1)]
    two_quads, corners = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], np.arange(8)
    everything = np.ones(4, bool)
    on_one_surface = [0, 1, 2, 3, 1, 4, 5, 2]  # the second square is the first one's neighbour
    for uv, vertices, count in (
        (square + apart, on_one_surface, 2),  # a seam
        (square + square, corners, 2),  # two pieces on one place
        (square + [(1, 0), (2, 0), (2, 1), (1, 1)], on_one_surface, 1),
    ):
        low = mesh(np.zeros((8, 3)), two_quads, [0, 0, 1, 1], uv=uv, vertices=vertices)
        assert faces.islands(low, everything) == count
        assert faces.islands(low, ~everything) == 0
