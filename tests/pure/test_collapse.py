# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests collapsing edges: the count is met, spheres stay near the sphere, surfaces stay closed, and borders stay in place."""

import numpy as np
import pytest

from addon.mesh import collapse, mirrors
from addon.mesh.collapse import CollapseOptions
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import face_normals
from tests.pure.test_fitting import sphere


def grid(n, *, hole=False):
    """The square -1..1 of n x n quads in the plane z = 0, in triangles, with or without a square hole in the middle."""
    places = np.linspace(-1.0, 1.0, n + 1)
    x, y = np.meshgrid(places, places, indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    i, j = (each.reshape(-1) for each in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    if hole:
        is_kept = (np.abs(i - (n - 1) / 2) > n / 4) | (np.abs(j - (n - 1) / 2) > n / 4)
        i, j = i[is_kept], j[is_kept]
    a, b, c, d = ((i + across) * (n + 1) + j + along for across, along in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def test_a_sphere_stays_closed_and_near():
    """A chord of a sphere's mesh of 400 triangles, with edges e = 0.27, lies up to e^2 / 3 deep; a part of it is outside."""
    points, triangles = collapse.collapse(*sphere(24), CollapseOptions(400))
    assert len(triangles) == 400 and (EdgeTable.of(triangles).counts == 2).all()
    assert len(points) == 400 // 2 + 2  # Euler
    found = face_normals(points, triangles)
    middles = points[triangles].mean(axis=1)
    assert ((found * middles).sum(axis=1) > 0.0).all()
    far = np.abs(np.linalg.norm(np.concatenate([points, middles]), axis=1) - 1.0)
    assert far.max() < 0.27**2 / 3.0


@pytest.mark.parametrize(("hole", "area"), [(False, 4.0), (True, 3.0)])
def test_a_plane_keeps_its_borders(hole, area):
    points, triangles = collapse.collapse(*grid(16, hole=hole), CollapseOptions(40))
    found = face_normals(points, triangles)
    assert len(triangles) <= 40 and (found[:, 2] > 0.0).all()
    assert 0.5 * found[:, 2].sum() == pytest.approx(area, rel=1e-3)
    assert points.min(axis=0) == pytest.approx([-1, -1, 0], abs=1e-3)
    assert points.max(axis=0) == pytest.approx([1, 1, 0], abs=1e-3)


def test_it_ends_where_no_edge_can_collapse():
    """A tetrahedron would become two triangles in one place."""
    points, triangles = np.eye(4)[:, :3], np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    kept, same = collapse.collapse(points, triangles, CollapseOptions(2))
    assert len(same) == 4 and np.abs(kept - points).max() < 1e-12


def test_triangles_of_three_on_an_edge_stay():
    """Where three half-planes meet, no edge of that line moves."""
    points, triangles = grid(8)
    on_line = np.flatnonzero(points[:, 0] == 0.0)
    fin = len(points) + np.arange(len(on_line))
    strips = np.stack([on_line[:-1], on_line[1:], fin[1:]], axis=1), np.stack([on_line[:-1], fin[1:], fin[:-1]], axis=1)
    whole = np.concatenate([points, points[on_line] + [0.0, 0.0, 1.0]])
    kept, coarse = collapse.collapse(whole, np.concatenate([triangles, *strips]), CollapseOptions(20))
    assert len(coarse) < len(triangles)
    assert {tuple(each) for each in points[on_line]} <= {tuple(np.round(each, 9)) for each in kept}


def test_what_is_known_of_edges_stays_true():
    state = collapse.State.of(*sphere(24), np.ones(len(sphere(24)[1])))
    state.run(500)
    keys, *known = state._known
    assert len(keys) > 300
    edges = EdgeTable.of(state.triangles, len(state.points))
    which = np.flatnonzero(np.isin(edges.keys, keys))
    known = [each[np.isin(keys, edges.keys)] for each in known]
    for before, now in zip(known, state._new_placements(edges, which), strict=True):
        assert before == pytest.approx(now, abs=1e-12)


def test_a_mesh_on_its_way_stands_for_all_faces():
    points, triangles = sphere(24)
    weights = 1.0 + (points[triangles].mean(axis=1)[:, 2] > 0.0)
    whole, again = (collapse.State.of(points, triangles, weights) for _ in range(2))
    whole.run(900)
    again.resume(collapse.partial_collapse(points, triangles, CollapseOptions(900, weights)))
    used = np.unique(whole.triangles)
    for name in ("points", "_planes", "_offsets", "_constants"):
        assert getattr(again, name)[used] == pytest.approx(getattr(whole, name)[used], abs=1e-12)
    for found in (again.triangles, again.of_vertex[triangles[:, 0]]):
        assert set(found.reshape(-1)) <= set(used)


def test_other_weights_go_on_from_a_mesh_on_its_way():
    points, triangles = sphere(24)
    start = collapse.partial_collapse(points, triangles, CollapseOptions(1200))
    of_top = np.where(points[triangles].mean(axis=1)[:, 2] > 0.0, 30.0, 1.0)
    shares = []
    for weights in (np.ones(len(triangles)), of_top):
        places, coarse = collapse.collapse(points, triangles, CollapseOptions(300, weights, start))
        assert len(coarse) == 300 and (EdgeTable.of(coarse).counts == 2).all()
        assert np.abs(np.linalg.norm(places, axis=1) - 1.0).max() < 0.1
        shares.append((places[coarse].mean(axis=1)[:, 2] > 0.0).mean())
    assert shares[0] == pytest.approx(0.5, abs=0.05) and shares[1] > 0.6


def test_a_mesh_goes_on_from_where_another_ended():
    points, triangles = sphere(24)
    start = collapse.partial_collapse(points, triangles, CollapseOptions(300))
    _, left = collapse.collapse(points, triangles, CollapseOptions(900, start=start))
    assert len(left) == len(start.triangles) == 300


def test_a_thin_tube_is_not_pinched():
    """Across a ring of three edges, an edge's ends have a third neighbor in common: without it, edges have four triangles."""
    count = 40
    turn, angle = 2.0 * np.pi * np.arange(count) / count, 2.0 * np.pi * np.arange(3) / 3
    wide = 1.0 + 0.05 * np.cos(angle)
    points = np.stack(
        [np.outer(np.cos(turn), wide), np.outer(np.sin(turn), wide), np.tile(0.05 * np.sin(angle), (count, 1))], axis=-1
    ).reshape(-1, 3)
    i, k = (each.reshape(-1) for each in np.mgrid[:count, :3])
    a, b = 3 * i + k, 3 * i + (k + 1) % 3
    c, d = 3 * ((i + 1) % count) + k, 3 * ((i + 1) % count) + (k + 1) % 3
    triangles = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    _, left = collapse.collapse(points, triangles, CollapseOptions(20))
    assert 20 <= len(left) < len(triangles)
    assert (EdgeTable.of(left).counts == 2).all()


@pytest.mark.parametrize("axis", range(3))
def test_borders_are_as_fine_as_what_is_inside(axis):
    """The border of half a sphere, with edges as long as those of the rest: at one, a single triangle goes."""
    half = mirrors.half(*sphere(48), mirrors.Plane(axis, 0.0))
    points, triangles = collapse.collapse(*half, CollapseOptions(triangles=400))
    edges = EdgeTable.of(triangles)
    lengths = np.linalg.norm(points[edges.ends[:, 0]] - points[edges.ends[:, 1]], axis=1)
    assert lengths[edges.is_open].mean() == pytest.approx(lengths[~edges.is_open].mean(), rel=0.15)
