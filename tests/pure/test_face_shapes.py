# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces that are not flat, and normals behind them, on meshes where both are known."""

import numpy as np
import pytest

from addon.mesh import face_shapes, threads
from addon.mesh.triangle_mesh import Mesh

CUTS = {"first and third": [(0, 1, 2), (0, 2, 3)], "second and fourth": [(0, 1, 3), (1, 2, 3)]}


def mesh(points, triangles, numbers, *, normals=None, to_world=None):
    """Corners are points of their own."""
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
@pytest.mark.parametrize(("degrees", "is_uneven"), [(0.0, False), (0.9, False), (1.1, True), (40.0, True)])
def test_a_lifted_corner_by_the_angle_between_both_ways_to_cut(cut, degrees, is_uneven):
    # Cut one way, a triangle stays in the plane, and both of the other way lean out of it along a side; these and the
    # lifted one lean less against each other.
    assert face_shapes.uneven(quad(np.tan(np.radians(degrees)), cut)).tolist() == [is_uneven]


def test_angles_are_those_of_the_object_as_it_is_scaled():
    tall = quad(0.001, to_world=np.diag([1.0, 1.0, 100.0, 1.0]))
    assert not face_shapes.uneven(quad(0.001)).any()
    assert face_shapes.uneven(tall).all()


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_size_does_not_matter(scale):
    to_world = np.diag([scale, scale, scale, 1.0])
    assert face_shapes.uneven(quad(0.1, to_world=to_world)).all()
    assert not face_shapes.uneven(quad(0.0, to_world=to_world)).any()


def test_an_arrowhead_may_be_cut_outside_of_itself():
    dart = [(0, 0, 0), (2, -1, 0), (0.5, 0, 0), (2, 1, 0)]
    assert face_shapes.uneven(mesh(dart, CUTS["first and third"], [0, 0])).all()


def test_a_quad_with_three_corners_in_line_is_flat():
    assert not face_shapes.uneven(
        mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0)], CUTS["second and fourth"], [0, 0])
    ).any()


@pytest.mark.parametrize("turn", range(4))
def test_a_sliver_leans_where_all_other_triangles_lie_flat(turn):
    points = [(0, 0, 0), (2, -1, 0), (1, 2, 0), (0.48, 1.01, 0.01)]
    assert face_shapes.uneven(mesh(points[turn:] + points[:turn], CUTS["first and third"], [0, 0])).all()


@pytest.mark.parametrize(("height", "is_uneven"), [(0.0, False), (0.01, False), (0.2, True)])
def test_an_n_gon_with_a_lifted_corner(height, is_uneven):
    angles = 2 * np.pi * np.arange(6) / 6
    points = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    points[3, 2] = height
    fan = [(0, i, i + 1) for i in range(1, 5)]
    assert face_shapes.uneven(mesh(points, fan, [0] * 4)).tolist() == [is_uneven]


def test_triangles_quads_and_n_gons_each_by_its_number():
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    points += [(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 0)]
    points += [(0, 0, 0), (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0)]
    triangles = [(0, 1, 2), (3, 4, 5), (3, 5, 6), (7, 8, 9), (7, 9, 10), (7, 10, 11)]
    mixed = mesh(points, triangles, [0, 1, 1, 2, 2, 2])
    assert face_shapes.polygons(mixed).tolist() == [False, True, True]
    assert face_shapes.uneven(mixed).tolist() == [False, True, False]


TRIANGLE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]


@pytest.mark.parametrize("corner", range(3))
@pytest.mark.parametrize(
    ("degrees", "is_behind"), [(0, False), (89, False), (91, True), (180, True), (269, True), (271, False)]
)
def test_one_normal_that_points_behind_its_triangle_is_enough(corner, degrees, is_behind):
    normals = np.tile((0.0, 0.0, 1.0), (3, 1))
    normals[corner] = np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))
    assert face_shapes.behind(mesh(TRIANGLE, [(0, 1, 2)], [0], normals=normals)).tolist() == [is_behind]
    assert face_shapes.behind(mesh(TRIANGLE, [(0, 2, 1)], [0], normals=-normals)).tolist() == [is_behind]


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_a_triangle_without_area_has_no_side(scale):
    behind = np.tile((0.0, 0.0, -1.0), (6, 1))
    points = np.array([*TRIANGLE, (0, 0, 0), (1, 0, 0), (2, 0, 0)]) * scale
    assert face_shapes.behind(mesh(points, [(0, 1, 2), (3, 4, 5)], [0, 1], normals=behind)).tolist() == [True, False]


def test_of_many_triangles_each_is_looked_at():
    """More than one thread takes at once, and no whole number of such parts."""
    count = threads.BLOCK + 3
    points, normals = np.tile(TRIANGLE, (count, 1)), np.tile((0.0, 0.0, 1.0), (3 * count, 1))
    truth = np.arange(count) % 7 == 0
    normals[::3][truth] *= -1.0
    found = face_shapes.behind(mesh(points, np.arange(3 * count).reshape(-1, 3), range(count), normals=normals))
    np.testing.assert_array_equal(found, truth)
