# SPDX-License-Identifier: GPL-3.0-or-later
"""Folds of coarse meshes are removed, and what only looks like one stays."""

from dataclasses import replace

import numpy as np

from addon.mesh import fitting, folds
from addon.mesh.folds import UnfoldOptions


def grid(n, moved=None, place=None):
    """A grid over the square 0..1 in the plane z = 0, perhaps with one point in another place."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, n + 1), np.linspace(0.0, 1.0, n + 1))
    points = np.stack([u.ravel(), v.ravel(), 0.0 * u.ravel()], axis=1)
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    first = (i + j * (n + 1)).ravel()
    triangles = [(first, first + 1, first + n + 2), (first, first + n + 2, first + n + 1)]
    if moved is not None:
        points[moved] = place
    return points, np.concatenate([np.stack(each, axis=1) for each in triangles])


def up(points, triangles):
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)[:, 2]


def test_a_vertex_beyond_its_neighbor_is_collapsed():
    points, triangles = grid(6, 24, (0.72, 0.5, 0.0))  # from 0.5, beyond 0.67
    count = np.count_nonzero(up(points, triangles) < 0.0)
    assert 0 < count <= 4
    found, left = folds.unfold(points, triangles, fitting.surface_samples(*grid(6), 2000))
    assert (up(found, left) > 0.0).all()
    assert len(triangles) - 8 <= len(left) < len(triangles)
    assert abs(up(found, left).sum() / 2.0 - 1.0) < 1e-12  # of the area, nothing is lost
    for options in (UnfoldOptions(most=0.0), UnfoldOptions(rounds=0)):
        assert folds.unfold(points, triangles, fitting.surface_samples(*grid(6), 2000), options)[1] is triangles


def test_a_mesh_without_folds_stays_as_it_is():
    points, triangles = grid(6)
    found = folds.unfold(points, triangles, fitting.surface_samples(points, triangles, 2000))
    assert found[0] is points and found[1] is triangles


def test_the_back_of_a_thin_plate_is_no_fold():
    """The middles of its faces are nearer to the other side of a surface that lies a little higher."""
    points, triangles = grid(6)
    both = np.concatenate([points, points - (0.0, 0.0, 0.01)])
    plate = np.concatenate([triangles, triangles[:, ::-1] + len(points)])
    around = fitting.surface_samples(both, plate, 2000)
    shifted = replace(around, points=around.points + (0.0, 0.0, 0.008))
    assert folds.unfold(both, plate, shifted)[1] is plate


def test_a_mesh_that_opposes_the_surface_everywhere_keeps_its_triangles():
    points, triangles = grid(2)
    assert folds.unfold(points, triangles, fitting.surface_samples(points, triangles[:, ::-1], 500))[1] is triangles


def test_the_rim_of_a_thin_plate_is_no_fold():
    """Its sides share the vertices of the rim, and the middles of its faces are nearer to the other side of the surface."""
    points, triangles = grid(6)
    is_inside = ((points[:, :2] > 0.0) & (points[:, :2] < 1.0)).all(axis=1)
    lower = np.where(is_inside, len(points) + np.cumsum(is_inside) - 1, np.arange(len(points)))
    both = np.concatenate([points, points[is_inside] - (0.0, 0.0, 0.01)])
    plate = np.concatenate([triangles, lower[triangles[:, ::-1]]])
    around = fitting.surface_samples(both, plate, 4000)
    shifted = replace(around, points=around.points + (0.0, 0.0, 0.008))
    assert folds.unfold(both, plate, shifted)[1] is plate


def test_a_triangle_that_opposes_two_neighbors_is_a_fold_though_another_side_is_near():
    sheet, upper = grid(6)
    fan = np.array([(0.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 2.0, 0.0), (0.0, 2.0, 0.0), (0.5, 0.9, 0.0)])
    points = np.concatenate([sheet, fan])
    triangles = np.concatenate([upper, len(sheet) + np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])])
    assert np.flatnonzero(up(points, triangles) < 0.0).tolist() == [len(upper)]
    both = np.concatenate([sheet, sheet - (0.0, 0.0, 0.2)]) * (1.0, 2.0, 1.0)
    around = fitting.surface_samples(both, np.concatenate([upper, upper[:, ::-1] + len(sheet)]), 4000)
    found, left = folds.unfold(points, triangles, around)
    assert len(left) == len(triangles) - 2 and (up(found, left) > 0.0).all()
