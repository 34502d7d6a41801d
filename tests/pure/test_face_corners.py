# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces, corners and triangles of a mesh find each other, compared with a search through all of them."""

import numpy as np
import pytest

from addon.mesh.triangle_mesh import CORNER_BLOCK, FaceCorners


@pytest.mark.parametrize("seed", range(6))
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
