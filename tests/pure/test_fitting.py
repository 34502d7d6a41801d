# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices that move to where a surface is nearest, samples of a surface, and welds: closed forms of a sphere."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.asset_limits import SIZES, Mending, Wanted, size_for
from addon.core.errors import BakeError
from addon.core.naming import Suffixes, low_name_of
from addon.mesh import fitting, welding
from addon.mesh.carried_normals import INNER
from addon.mesh.closest import Surface
from addon.mesh.fitting import FitOptions, Samples
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import closest_points, unit
from addon.mesh.welding import ClusterOptions, WeldOptions


def sphere(rings):
    """Points (V, 3) and triangles (T, 3) of a sphere of radius 1, welded."""
    down, around = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij")
    points = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], axis=-1)
    row, column = np.mgrid[0:rings, 0 : 2 * rings].reshape(2, -1)
    a, b = row * 2 * rings + column, row * 2 * rings + (column + 1) % (2 * rings)
    below = 2 * rings
    triangles = np.concatenate([np.stack([a, a + below, b], 1), np.stack([b, a + below, b + below], 1)])
    return welding.weld(np.round(points.reshape(-1, 3), 6).astype(np.float32), triangles)


def distances(points, triangles, around):
    """From samples to a mesh."""
    return np.sqrt(Surface(points.astype(np.float32), triangles).closest(around.points.astype(np.float32))[2])


def outwards(points, triangles):
    """Which faces (T,) of a mesh around the origin point away from it."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0.0


def test_a_coarse_sphere_comes_three_times_as_close_and_no_face_turns():
    coarse, triangles = sphere(8)
    around = fitting.surface_samples(*sphere(40), 20_000)
    moved, _ = fitting.fit(coarse, triangles, around)
    before, after = (np.sqrt((distances(points, triangles, around) ** 2).mean()) for points in (coarse, moved))
    assert after < before / 3.0
    assert outwards(moved, triangles).all()
    # Chords of a circle in 16 parts lie within it and outside it then.
    assert 1.0 < np.linalg.norm(moved, axis=1).max() < 1.0 / np.cos(np.pi / 16.0) ** 2


def test_more_rounds_come_nearer_from_far_away_seed_7():
    coarse, triangles = sphere(8)
    far = coarse + np.random.default_rng(7).normal(0.0, 0.05, coarse.shape)
    around = fitting.surface_samples(*sphere(40), 20_000)
    moved = [fitting.fit(far, triangles, around, FitOptions(rounds=rounds))[0] for rounds in (1, 4)]
    once, often = (distances(points, triangles, around).mean() for points in moved)
    assert often < 0.95 * once


def test_a_mesh_on_its_surface_stays():
    points, triangles = sphere(12)
    moved, _ = fitting.fit(points, triangles, fitting.surface_samples(points, triangles, 20_000))
    assert np.abs(moved - points).max() < 1e-4


def test_the_triangles_of_samples_are_the_nearest_ones():
    coarse, triangles = sphere(8)
    around = fitting.surface_samples(*sphere(40), 5_000)
    moved, found = fitting.fit(coarse, triangles, around)
    far = ((closest_points(around.points, moved[triangles[found]]) - around.points) ** 2).sum(axis=1)
    # The last move comes after the last search.
    assert np.sqrt(far).mean() == pytest.approx(distances(moved, triangles, around).mean(), rel=0.01)


def test_the_nearest_triangle_beside_a_known_one_seed_5():
    dice = np.random.default_rng(5)
    points, triangles = sphere(8)
    points = (points + dice.normal(0.0, 0.02, points.shape)).astype(np.float32)
    places = fitting.surface_samples(*sphere(40), 500).points.astype(np.float32)
    known = Surface(points, triangles).closest(places)[0]
    known = triangles_beside(triangles, known, dice)
    found, where = fitting._Beside.of(triangles).closest(places, known, points)
    touches = (triangles[known][:, None, :, None] == triangles[None, :, None, :]).any(axis=(2, 3))
    every = closest_points(np.repeat(places, len(triangles), axis=0), np.tile(points[triangles], (500, 1, 1)))
    far = ((every.reshape(500, -1, 3) - places[:, None]) ** 2).sum(axis=2)
    best = np.where(touches, far, np.inf).min(axis=1)
    assert touches[np.arange(500), found].all()
    assert ((where - places) ** 2).sum(axis=1) == pytest.approx(best, rel=1e-4, abs=1e-10)


def triangles_beside(triangles, which, dice):
    """One that shares a vertex with each of these, by chance."""
    vertices = triangles[which, dice.integers(0, 3, len(which))]
    return np.array([dice.choice(np.flatnonzero((triangles == vertex).any(axis=1))) for vertex in vertices])


@pytest.mark.parametrize(("share", "is_open"), [(1.0, False), (0.1, False), (0.1, True)])
def test_moves_are_least_squares_seed_6(share, is_open):
    """Along the mesh, samples count by a share; at open borders they do fully, and springs are stiff."""
    dice = np.random.default_rng(6)
    _, triangles = sphere(3)
    triangles = triangles[1:] if is_open else triangles
    count, samples = int(triangles.max()) + 1, 200
    edges = np.sort(np.concatenate([triangles[:, [i, i - 1]] for i in range(3)]), axis=1)
    edges, of_edges = np.unique(edges, axis=0, return_counts=True)
    rim = np.unique(edges[of_edges == 1])
    found, weights = dice.integers(0, len(triangles), samples), dice.dirichlet(np.ones(3), samples)
    missing, across = dice.normal(size=(2, samples, 3))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    counts = dice.uniform(0.5, 2.0, samples)
    options = FitOptions(smooth=0.005, along=share)
    moves = fitting._System(found, weights, across, triangles, count, options=options, counts=counts)
    moves = moves.solved(missing, np.zeros((count, 3)))
    # Each sample is a row across the mesh and three rows along it, of the moves of all axes.
    at_rim = np.isin(triangles[found], rim).any(axis=1)
    along = np.sqrt(np.where(at_rim, 1.0, share))[:, None, None]
    ways = across[:, :, None] * across[:, None, :]
    metrics = np.sqrt(counts)[:, None, None] * (ways + along * (np.eye(3) - ways))
    rows = np.zeros((samples, 3, count, 3))
    for corner in range(3):
        rows[np.arange(samples), :, triangles[found, corner]] += weights[:, corner, None, None] * metrics
    steps = np.zeros((len(edges), count))
    steps[np.arange(len(edges)), edges[:, 0]], steps[np.arange(len(edges)), edges[:, 1]] = 1.0, -1.0
    steps *= np.sqrt(np.where(np.isin(edges, rim).any(axis=1), 0.02, 0.005) * counts.sum() / count)[:, None]
    pulls = np.sqrt(FitOptions.pull * counts.sum() / count) * np.eye(count)
    parts = rows.reshape(3 * samples, -1), np.kron(steps, np.eye(3)), np.kron(pulls, np.eye(3))
    wanted = np.concatenate([np.einsum("nij,nj->ni", metrics, missing).reshape(-1), np.zeros(3 * (len(edges) + count))])
    exact = np.linalg.lstsq(np.concatenate(parts), wanted)[0].reshape(-1, 3)
    assert moves == pytest.approx(exact, abs=1e-3)


def test_vertices_slide_to_the_ridge_of_a_roof():
    """Five of its vertices lie beside it, in one of the slopes: only moves along the slope bring them back."""
    across, along = np.meshgrid(np.arange(-3.0, 4.0), np.arange(7.0))
    roof = np.stack([across, along, -np.abs(across)], axis=-1).reshape(-1, 3)
    row, column = np.mgrid[:6, :6].reshape(2, -1)
    a = 7 * row + column
    triangles = np.concatenate([np.stack([a, a + 1, a + 8], axis=1), np.stack([a, a + 8, a + 7], axis=1)])
    around = fitting.surface_samples(roof, triangles, 5_000)
    ridge, start = 7 * np.arange(1, 6) + 3, roof.copy()
    start[ridge] += (0.4, 0.0, -0.4)

    def left(**options):
        moved, _ = fitting.fit(start, triangles, around, FitOptions(rounds=2, **options))
        return np.abs(moved[ridge][:, 2]).mean()

    assert left(smooth=0.005, along=0.1) < 0.75 * left(smooth=0.005)


def test_samples_on_the_mesh_hold_it_across():
    """As much as others pull it away: it comes to lie halfway between both."""
    points, triangles = sphere(8)
    around = fitting.surface_samples(points, triangles, 6_000)
    lifted = around.points + 0.01 * around.normals * (np.arange(len(around.points)) % 2)[:, None]
    options = FitOptions(rounds=1, smooth=0.005, along=0.1)
    moved, _ = fitting.fit(points, triangles, replace(around, points=lifted), options, around.triangles)
    out = np.linalg.norm(moved, axis=1) - np.linalg.norm(points, axis=1)
    assert out.mean() == pytest.approx(0.005, rel=0.1)


def test_samples_beyond_a_corner_pull_it_towards_them():
    """Not across one of its faces. Each corner of an octahedron has one 0.1 away, in line with the middle, and each face one
    on it: 6 (m - 0.1) ** 2 + 8 m ** 2 / 3 is least at m = 0.0692."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])
    middles, first = (
        corners[faces].mean(axis=1),
        np.array([(faces == corner).any(axis=1).argmax() for corner in range(6)]),
    )
    around = Samples(
        np.concatenate([1.1 * corners, middles]),
        np.concatenate([corners, unit(middles)]),
        np.concatenate([first, np.arange(8)]),
        np.ones(14),
    )
    options = FitOptions(rounds=1, smooth=1e-6, pull=1e-6, along=0.1)
    moved, _ = fitting.fit(corners, faces, around, options, around.triangles)
    assert (moved * corners).sum(axis=1) - 1.0 == pytest.approx(0.3 / (3.0 + 4.0 / 3.0), rel=0.02)


def test_faces_that_would_turn_over_keep_their_vertices():
    """A strip of a plane, whose samples pull one vertex over the opposite edge."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    triangles = np.array([[0, 1, 2], [1, 3, 2]])
    moved = points.copy()
    moved[3] = [-1, -1, 0]
    kept = fitting._without_turns(points, moved, triangles, np.ones(4, bool))
    assert np.array_equal(kept, points)


def test_samples_of_the_other_side_do_not_pull():
    """A sheet that points down stays where it is under one that points up, and is pulled to one that points down."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    down = np.array([[0, 2, 1], [1, 2, 3]])
    above = points + [0.0, 0.0, 0.1]
    for surface, height in ((down[:, ::-1], 0.0), (down, 0.1)):
        moved, _ = fitting.fit(points, down, fitting.surface_samples(above, surface, 2000))
        assert moved[:, 2] == pytest.approx(np.full(4, height), abs=0.01)


def test_samples_spread_by_area():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [8, 0, 0], [5, 1, 0], [9, 9, 9]], np.float32)
    found = fitting.surface_samples(points, np.array([[0, 1, 2], [6, 6, 6], [3, 4, 5]]), 4000)
    assert len(found.points) == 4000
    assert np.count_nonzero(found.points[:, 0] >= 5.0) == pytest.approx(3000, abs=1)
    assert found.normals == pytest.approx(np.tile([0.0, 0.0, 1.0], (4000, 1)))
    left = found.points[found.points[:, 0] < 5.0]
    assert left[:, :2].mean(axis=0) == pytest.approx([1 / 3, 1 / 3], abs=0.02)
    assert not len(fitting.surface_samples(points, np.array([[6, 6, 6], [0, 0, 1]]), 10).points)


def test_a_sphere_of_single_triangles_is_welded_and_closed():
    points, triangles = sphere(6)
    alone = points[triangles.reshape(-1)]
    welded, joined = welding.weld(alone, np.arange(len(alone)).reshape(-1, 3))
    assert (len(welded), len(joined)) == (len(points), len(triangles))
    assert EdgeTable.of(joined).counts.tolist() == [2] * (3 * len(triangles) // 2)


def test_vertices_within_a_distance_become_one():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1.0001, 0, 0], [1, 1, 0], [0, 1.0001, 0]], np.float32)
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    for within, count in ((0.0, 6), (0.001, 4)):
        welded, joined = welding.weld(points, triangles, WeldOptions(within))
        assert len(welded) == count and len(joined) == 2


def test_lines_and_copies_are_left_out():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -0.0], [7, 7, 7]], np.float32)
    welded, triangles = welding.weld(points, np.array([[0, 1, 2], [2, 3, 1], [0, 3, 1]]))
    assert len(welded) == 3 and len(triangles) == 1


@pytest.mark.parametrize(
    ("texts", "limits"),
    [
        (("", "", ""), (np.inf, 5000, False)),
        (("2", "", "auto"), (2.0, 0, True)),
        (("2", "900", "1024"), (2.0, 900, False)),
        (("", "900", "AUTO"), (np.inf, 900, True)),
    ],
)
def test_limits_in_texts(texts, limits):
    found = Wanted.of_texts(*texts)
    assert (found.degrees, found.triangles, found.fits_size) == limits


def test_only_a_number_of_triangles_that_was_given_is_a_promise():
    given, default, within = (Wanted.of_texts(*texts) for texts in (("", "5000", ""), ("", "", ""), ("2", "5000", "")))
    assert [given.has_missed(count) for count in (48, 4_900, 5_100, 5_101)] == [True, False, False, True]
    assert [default.has_missed(count) for count in (48, 4_900, 5_100, 5_101)] == [False, False, False, True]
    assert default.of_level(1, 48).triangles == 24 and not default.of_level(1, 48).has_missed(20)
    odd = given.of_level(1, 62)  # closed meshes of 31 triangles are none
    assert [odd.has_missed(count) for count in (29, 30, 32, 33)] == [True, False, False, True]
    assert not within.has_missed(9_000)  # the degrees decide
    assert 1.0 < within.search_limit.excess(2.0, 0.0) < 1.1  # the finished UV map costs some of them


def test_crumbs_and_holes_are_percents():
    assert Mending.of_texts("", "3 %") == Mending(0.0, 0.03)
    for texts, reason in (
        (("x", ""), "not a size in percent"),
        (("26", ""), "Crumbs of 26 %"),
        (("", "-1"), "Holes of -1 %"),
    ):
        with pytest.raises(BakeError, match=reason):
            Wanted.of_texts("", "", "", mending=Mending.of_texts(*texts))


def test_a_size_is_texels_a_meter():
    found, plain = Wanted.of_texts("", "", "512.5/M"), Wanted.of_texts("", "", "512")
    assert (found.density, found.finds_size, found.fits_size) == (512.5, True, False)
    assert (plain.density, plain.finds_size) == (0.0, False)


@pytest.mark.parametrize(
    ("texts", "reason"),
    [
        (("two", "", ""), "is not degrees"),
        (("nan", "", ""), "is not degrees"),
        (("0", "", ""), "cannot be a limit"),
        (("-2", "", ""), "cannot be a limit"),
        (("", "many", ""), "is not a number of triangles"),
        (("", "3", ""), "enclose nothing"),
        (("", "0", ""), "enclose nothing"),
        (("2", "-5", ""), "enclose nothing"),
        (("", "", "many/m"), "is not a number of texels a meter"),
        (("", "", "0/m"), "show nothing"),
    ],
)
def test_wrong_limits_are_named(texts, reason):
    with pytest.raises(BakeError, match=reason):
        Wanted.of_texts(*texts)


def test_texels_are_as_small_as_asked_for():
    assert size_for(0.01, 4.0, 1.0) == 256  # 200 a side
    assert size_for(0.01, 4.0, 0.25) == 512  # 400 of them
    assert size_for(1e-6, 4.0, 1.0) == SIZES[1]
    assert size_for(0.0, 4.0, 1.0) == size_for(1.0, 0.0, 1.0) == SIZES[0]


@pytest.mark.parametrize(
    ("high", "low"),
    [("crate_high", "crate_low"), ("crate", "crate_low"), ("crate_HP_2", "crate_low_2"), ("hi", "hi_low")],
)
def test_names_of_low_objects(high, low):
    assert low_name_of(high, Suffixes()) == low


def cluster(points, triangles, cell=1.0):
    return welding.cluster(points, triangles, ClusterOptions(cell))


def test_thin_parts_pressed_flat_are_gone():
    """Layers of a triangle in the same cells, which edges connect: of one that points up over one that points down, nothing is
    left, however their corners are turned; of a third, the one that has no other."""
    corners = np.array([(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.0, 5.0, 0.0)])
    points = np.concatenate([corners + (0.0, 0.0, height) for height in (0.0, 0.1, 0.2)])
    across = [(0, 3, 6), (1, 4, 7), (2, 5, 8)]
    for turn in range(3):
        up, down, over = (0, 1, 2), np.roll((3, 5, 4), turn), (6, 7, 8)
        left = [cluster(points, np.array([*across, *some]))[1] for some in ([up, down], [up, down, over])]
        assert [found.tolist() for found in left] == [[], [[0, 1, 2]] * 2]


def test_parts_in_a_cell_that_no_edge_connects_stay_apart():
    corners = np.array([(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.0, 5.0, 0.0)])
    points = np.concatenate([corners, corners + (0.0, 0.0, 0.1)])
    found, left = cluster(points, np.array([(0, 1, 2), (3, 5, 4)]))
    assert len(found) == 6 and len(left) == 2
    points = np.concatenate(
        [points, points + (0.2, 0.0, 0.0)]
    )  # and those that only the last edge of a triangle connects
    found, left = cluster(points, np.array([(0, 1, 2), (3, 5, 4), (0, 1, 6), (6, 1, 2), (3, 4, 9)]))
    assert len(np.unique(left)) == 6


def test_vertices_in_a_cell_become_one_in_their_middle():
    """A square of 40 x 40 quads, in cells of a tenth of its side: each has the middle of its 4 x 4 vertices."""
    u, v = np.meshgrid(np.arange(40) / 40.0, np.arange(40) / 40.0)
    points = np.stack([u.ravel(), v.ravel(), 5.0 + 0.0 * u.ravel()], axis=1)
    i, j = np.meshgrid(np.arange(39), np.arange(39))
    first = (i + 40 * j).ravel()
    triangles = np.concatenate(
        [np.stack(each, axis=1) for each in ((first, first + 1, first + 41), (first, first + 41, first + 40))]
    )
    found, left = cluster(points, triangles, 0.1 - 1e-9)
    expected = (4.0 * np.arange(10) + 1.5) / 40.0
    assert np.allclose(np.unique(found[:, 0].round(6)), expected, atol=1e-6)
    assert np.allclose(np.unique(found[:, 1].round(6)), expected, atol=1e-6)
    assert (found[:, 2] == 5.0).all() and len(found) == 100
    assert len(np.unique(np.sort(left, axis=1), axis=0)) == len(left) == 2 * 9 * 9
    a, b, c = (found[left[:, k]] for k in range(3))
    assert np.isclose(np.cross(b - a, c - a)[:, 2].sum() / 2.0, 0.9**2)


def test_vertices_slide_to_where_their_places_are():
    """The vertices of a turned sphere turn back, and those of one that is too large come nearer."""
    points, triangles = sphere(16)
    turn = np.array([[np.cos(0.05), -np.sin(0.05), 0.0], [np.sin(0.05), np.cos(0.05), 0.0], [0.0, 0.0, 1.0]])
    which = np.repeat(np.arange(len(triangles)), 4)
    found = which, np.tile(INNER, (len(triangles), 1))
    there = np.einsum("nc,ncx->nx", found[1], points[triangles[which]])
    places = fitting.Samples(there, unit(there), which, np.ones(len(which)))
    moved = fitting.slid(points @ turn.T, triangles, found, places)
    before = np.linalg.norm(points @ turn.T - points, axis=1)
    assert np.linalg.norm(moved - points, axis=1).max() < 0.1 * before.max()
    lifted = fitting.slid(1.1 * points, triangles, found, places)
    assert lifted == pytest.approx(points, abs=1e-3)
