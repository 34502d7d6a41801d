# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests face_shapes on meshes where the non-planar faces and the normals behind faces are known."""

import numpy as np
import pytest

from addon.core import threads
from addon.mesh import face_shapes
from addon.mesh.triangle_mesh import Mesh

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
    count = threads.BLOCK + 3
    points, normals = np.tile(TRIANGLE, (count, 1)), np.tile((0.0, 0.0, 1.0), (3 * count, 1))
    truth = np.arange(count) % 7 == 0
    normals[::3][truth] *= -1.0
    found = face_shapes.normals_behind(mesh(points, np.arange(3 * count).reshape(-1, 3), range(count), normals=normals))
    np.testing.assert_array_equal(found, truth)
