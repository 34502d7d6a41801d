# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the parts of a mesh between its hard edges, without Blender."""

import itertools

import numpy as np
import pytest

from addon.mesh.smooth_parts import smooth_parts
from addon.mesh.triangle_mesh import Mesh

UP, ASIDE = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)


def mesh_of(points, triangles, normals):
    """A mesh whose corners have these normals (T, 3, 3)."""
    triangles = np.asarray(triangles, np.int32)
    return Mesh(
        "mesh",
        np.array(points, np.float32),
        triangles.reshape(-1),
        np.array(normals, np.float32).reshape(-1, 3),
        np.arange(triangles.size, dtype=np.int32).reshape(-1, 3),
        np.eye(4),
    )


def box(*, is_split):
    """The cube from 0 to 1, in flat triangles. is_split: each triangle has vertices of its own, as exporters write them."""
    points = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    corners = points[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if is_split:
        points, triangles = corners.reshape(-1, 3), np.arange(triangles.size).reshape(-1, 3)
    return mesh_of(points, triangles, np.repeat(faces[:, None], 3, axis=1))


@pytest.mark.parametrize("is_split", [False, True])
def test_a_box_has_six_parts_and_twelve_edges(is_split):
    mesh = box(is_split=is_split)
    parts = smooth_parts(mesh)
    assert np.array_equal(parts.numbers, np.repeat(np.arange(6), 2))
    lengths = np.linalg.norm(np.diff(mesh.positions[parts.ends], axis=1), axis=2)
    assert len(parts.ends) == 12 and np.allclose(lengths, 1.0)  # no diagonal of a face
    assert (parts.beside[:, 0] != parts.beside[:, 1]).all()


FOLD = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (0, 0, -1)]
"""Two triangles at the edge from 0 to 1."""


@pytest.mark.parametrize("end", [0, 1])
def test_an_edge_is_hard_that_is_so_at_one_end(end):
    normals = np.array([[UP, UP, UP], [UP, UP, ASIDE]])
    normals[1, 1 - end] = ASIDE  # of the vertices 1, 0 and 3
    parts = smooth_parts(mesh_of(FOLD, [(0, 2, 1)[::-1], (1, 0, 3)], normals))
    assert set(parts.ends[0]) == {0, 1} and parts.numbers.tolist() == [0, 1]


def test_an_edge_that_ends_in_a_smooth_surface_has_one_part_on_both_sides():
    """The fan around vertex 0 is closed, and hard only between the first triangle and the last."""
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (-1, -1, 0)]
    triangles = [(0, 1, 2), (0, 2, 3), (0, 3, 1)]
    normals = np.array([UP, (0.6, 0.0, 0.8), (0.0, 0.6, 0.8), (-0.6, 0.0, 0.8)])[
        triangles
    ]  # they differ along the edges
    normals[2, 2] = ASIDE
    parts = smooth_parts(mesh_of(points, triangles, normals))
    assert parts.numbers.tolist() == [0, 0, 0]
    assert [set(ends) for ends in parts.ends.tolist()] == [{0, 1}] and parts.beside.tolist() == [[0, 0]]


def test_three_triangles_at_an_edge_are_told_apart():
    points = [*FOLD, (-1, 0, 0)]
    normals = [[UP] * 3, [ASIDE] * 3, [(-1.0, 0.0, 0.0)] * 3]
    parts = smooth_parts(mesh_of(points, [(0, 1, 2), (1, 0, 3), (0, 1, 4)], normals))
    assert parts.numbers.tolist() == [0, 1, 2] and len(parts.ends) == 2


def test_smooth_and_open_meshes_have_no_hard_edge():
    assert smooth_parts(mesh_of(FOLD, [(0, 1, 2), (1, 0, 3)], np.full((2, 3, 3), UP))) is None


def test_edges_on_opposite_sides_of_a_tile_are_one():
    """Its two triangles lie apart, with an edge each on a border that is one with the other's."""
    points = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (9, 0, 0), (9, 1, 0), (8, 0, -1)]
    mesh = mesh_of(points, [(1, 0, 2), (3, 4, 5)], [[UP] * 3, [ASIDE] * 3])
    assert smooth_parts(mesh) is None
    parts = smooth_parts(mesh, np.array([0, 1, 2, 0, 1, 5]))
    assert parts.beside.tolist() == [[0, 1]] and set(parts.ends[0]) == {0, 1}
