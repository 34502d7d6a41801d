# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights of triangles: by how much a surface bends, and by the errors that were seen."""

import numpy as np
import pytest

from addon.mesh import collapse, face_weights, fitting
from addon.mesh.collapse import CollapseOptions
from tests.pure.test_collapse import grid
from tests.pure.test_fitting import distances, sphere


def folded(n):
    """The grid of n x n quads, folded along x = 0 by 90 degrees."""
    points, triangles = grid(n)
    points[:, 2] = np.abs(points[:, 0])
    return points.astype(np.float32), triangles


def test_only_triangles_near_a_fold_bend():
    points, triangles = folded(16)
    weights = face_weights.by_bending(points, triangles)
    far = np.abs(points[triangles][..., 0]).min(axis=1)
    assert weights[far > 0.2] == pytest.approx(face_weights.UNBENT_WEIGHT)
    assert weights[far == 0.0].min() > 1.0


def test_weights_are_those_of_a_loop_over_edges_seed_3():
    """The angle across each edge, times the edge's length, over the areas of the triangles around a vertex."""
    rng = np.random.default_rng(3)
    points, triangles = grid(4)
    points = (points + rng.normal(0.0, 0.1, points.shape)).astype(np.float32)
    exact = points.astype(float)
    normals = [np.cross(exact[b] - exact[a], exact[c] - exact[a]) for a, b, c in triangles]
    bends, at_edge = np.zeros(len(triangles)), {}
    for number, triangle in enumerate(triangles.tolist()):
        for k in range(3):
            at_edge.setdefault(frozenset((triangle[k], triangle[(k + 1) % 3])), []).append(number)
    for edge, (one, *others) in at_edge.items():
        a, b = edge
        for other in others:
            cosine = normals[one] @ normals[other] / np.linalg.norm(normals[one]) / np.linalg.norm(normals[other])
            bends[[one, other]] += np.arccos(cosine) * np.linalg.norm(exact[a] - exact[b])
    areas = np.linalg.norm(normals, axis=1)
    around = [bends[has].sum() / areas[has].sum() for has in [(triangles == v).any(axis=1) for v in range(len(points))]]
    expected = (
        face_weights.UNBENT_WEIGHT + (np.array(around)[triangles].mean(axis=1) / (bends.sum() / areas.sum())) ** 0.5
    )
    assert face_weights.by_bending(points, triangles) == pytest.approx(expected)


def test_spheres_of_any_size_weigh_the_same_everywhere():
    points, triangles = sphere(32)
    middle = np.abs(points[triangles][..., 2]).max(axis=1) < 0.5
    for size in (1.0, 1e-3):
        weights = face_weights.by_bending((size * points).astype(np.float32), triangles)
        assert weights[middle] == pytest.approx(1.0 + face_weights.UNBENT_WEIGHT, abs=0.1)


def test_equal_errors_leave_the_weights():
    _, triangles = grid(8)
    weights = np.linspace(1.0, 2.0, len(triangles))
    found = face_weights.by_error(weights, triangles, np.arange(len(triangles)), np.ones(len(triangles)))
    assert found == pytest.approx(weights)


def test_weights_rise_where_errors_are_larger_than_the_mean():
    points, triangles = grid(16)
    x = points[triangles][..., 0].mean(axis=1)
    places = np.flatnonzero((np.abs(x) > 0.2) & (np.arange(len(x)) % 2 == 0))  # others learn from their neighbors
    excess = np.where(x[places] > 0.0, 2.0, 0.5)
    found = face_weights.by_error(np.ones(len(triangles)), triangles, places, excess)
    factor = 2.0**face_weights.ERROR_POWER
    assert found[x > 0.7] == pytest.approx(factor)
    assert found[x < -0.7] == pytest.approx(1.0 / factor)


def test_a_coarse_mesh_is_nearer_where_weights_are_higher():
    points, triangles = sphere(40)
    is_upper = points[triangles][..., 2].mean(axis=1) > 0.0
    coarse = collapse.collapse(points, triangles, CollapseOptions(400, np.where(is_upper, 100.0, 1.0)))
    around = fitting.surface_samples(points, triangles, 20_000)
    far = distances(*coarse, around)
    above = around.points[:, 2]
    assert far[above > 0.2].mean() < 0.5 * far[above < -0.2].mean()


def test_samples_by_weight_say_what_area_they_stand_for():
    points, triangles = grid(8)
    is_right = points[triangles][..., 0].mean(axis=1) > 0.0
    found = fitting.surface_samples(points, triangles, 4000, np.where(is_right, 3.0, 1.0))
    right = found.points[:, 0] > 0.0
    assert np.count_nonzero(right) == pytest.approx(3000, abs=1)
    assert found.shares[right].sum() == pytest.approx(found.shares[~right].sum(), rel=0.01)
    assert found.shares.mean() == pytest.approx(1.0, rel=0.01)
