# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts are disks with short borders, and packed islands keep their distance: measured by closed forms and by counting."""

import numpy as np
import pytest

from addon.mesh import uv_crossings
from addon.mesh.uv_charts import FULL, ChartOptions, Charts, _Growth, best_parts
from tests.support import random_cases

MARGIN = 1.0 / 256.0


def grid(rows, columns, wraps=(False, False)):
    """The triangles of rows x columns quads, (2 * rows * columns, 3), and the place of each vertex, (V, 2) from 0 to 1."""
    high, wide = rows + (not wraps[0]), columns + (not wraps[1])
    row, column = (x.reshape(-1) for x in np.mgrid[:rows, :columns])
    a, b = row * wide + column, row * wide + (column + 1) % wide
    c, d = (row + 1) % high * wide + (column + 1) % wide, (row + 1) % high * wide + column
    places = np.stack([x.reshape(-1) for x in np.mgrid[:high, :wide]], axis=1) / (rows, columns)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), places


def flat(rows, columns):
    triangles, places = grid(rows, columns)
    return np.insert(places, 2, 0.0, axis=1), triangles


def cylinder(rows=8, columns=24):
    triangles, places = grid(rows, columns, (False, True))
    angle = 2.0 * np.pi * places[:, 1]
    return np.stack([np.cos(angle), np.sin(angle), 2.0 * places[:, 0]], axis=1), triangles


def torus(rows=16, columns=32):
    triangles, places = grid(rows, columns, (True, True))
    along, around = 2.0 * np.pi * places.T
    wide = 1.0 + 0.4 * np.cos(along)
    return np.stack([wide * np.cos(around), wide * np.sin(around), 0.4 * np.sin(along)], axis=1), triangles


def sphere(rows=16, columns=32):
    triangles, places = grid(rows, columns, (False, True))
    down, around = np.pi * (places[:, 0] * 0.98 + 0.01), 2.0 * np.pi * places[:, 1]
    return np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], axis=1), triangles


def cube(n=4):
    points, triangles = [], []
    for axis in range(3):
        for side in (0.0, 1.0):
            found, corners = flat(n, n)
            corners = corners if side else corners[:, ::-1]
            triangles.append(corners + sum(map(len, points)))
            points.append(np.roll(found + (0.0, 0.0, side), axis, axis=1))
    points, places = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return points, places.reshape(-1)[np.concatenate(triangles)]


def spoiled(seed):
    """A bent sheet with faces that are missing, turned around, doubled, and without area."""
    random = np.random.default_rng(seed)
    points, triangles = torus(10, 20)
    points = points + 0.05 * random.standard_normal(points.shape)
    triangles = triangles[random.random(len(triangles)) > 0.05]
    turned = random.random(len(triangles)) < 0.05
    triangles[turned] = triangles[turned, ::-1]
    double = triangles[random.random(len(triangles)) < 0.03]
    return points, np.concatenate([triangles, double, [[3, 3, 4]]])


def charts_of(points, triangles, **options):
    return Charts(points, triangles, ChartOptions(MARGIN, **options))


def grown(points, triangles, *stretches):
    """The charts, and their labels after these steps."""
    charts = charts_of(points, triangles)
    labels = charts.flat()
    for stretch in stretches:
        labels = charts.grown(labels, stretch)
    return charts, labels


def mesh_at_random(seed, rows=12, columns=24):
    """A bent strip with noise, and half of its faces' diagonals the other way."""
    random = np.random.default_rng(seed)
    points, triangles = sphere(rows, columns)
    return points + 0.02 * random.standard_normal(points.shape), triangles


def pieces(triangles, seams):
    """The number of each triangle's piece (T,) if the surface is cut along `seams`, and the Euler characteristic of each piece,
    in which a vertex counts once for each of its fans.

    By a walk from corner to corner, which shares no code with charts.
    """
    cut = {tuple(sorted(edge)) for edge in seams.tolist()}
    sides = {}
    for triangle, corners in enumerate(triangles.tolist()):
        for k in range(3):
            sides.setdefault(tuple(sorted((corners[k], corners[(k + 1) % 3]))), []).append(triangle)
    parent = {}

    def root(node):
        while parent.setdefault(node, node) != node:
            node = parent[node]
        return node

    edges = []
    for edge, found in sides.items():
        if edge in cut:
            edges += found
            continue
        first, second = found
        edges.append(first)
        parent[root(first)] = root(second)
        for vertex in edge:
            parent[root((first, vertex))] = root((second, vertex))
    of = np.array([root(triangle) for triangle in range(len(triangles))])
    fans = {root((triangle, v)): triangle for triangle, corners in enumerate(triangles.tolist()) for v in corners}
    count = len(triangles)
    euler = np.bincount(of, minlength=count) - np.bincount(of[edges], minlength=count)
    euler += np.bincount(of[list(fans.values())], minlength=count)
    names, numbers = np.unique(of, return_inverse=True)
    return numbers, euler[names]


def test_a_flat_grid_is_one_chart_whose_seams_are_its_border():
    points, triangles = flat(6, 9)
    charts, labels = grown(points, triangles)
    assert not labels.any() and charts.is_flat(labels).all()
    assert len(charts.seams(labels)) == 2 * (6 + 9)


def plate(holes):
    """A flat plate with holes x holes of them, one square in four."""
    side = 2 * holes + 1
    points, triangles = flat(side, side)
    middle = np.floor(points[triangles].mean(axis=1)[:, :2] * side).astype(int)
    return points, triangles[~(middle % 2 == 1).all(axis=1)]


def test_a_plate_with_holes_is_one_flat_chart_without_slits():
    points, triangles = plate(4)
    charts, labels = grown(points, triangles)
    assert not labels.any()
    assert len(charts.seams(labels)) == 4 * 9 + 16 * 4
    assert (charts.nodes(labels, triangles)[triangles] == triangles).all()


def test_a_plate_with_holes_is_not_joined_with_others():
    """Its edge is bent by a right angle, which costs nothing without holes."""
    joined = []
    for keep in (slice(None), slice(0)):
        points, triangles = plate(1) if keep == slice(None) else flat(3, 3)
        wall, corners = flat(1, 3)
        wall = wall[:, [2, 1, 0]] - (0.0, 0.0, 1.0)
        points, places = np.unique(np.round(np.concatenate([points, wall]), 9), axis=0, return_inverse=True)
        places = places.reshape(-1)
        count = len(places) - len(wall)
        triangles = np.concatenate([places[triangles], places[corners + count]])
        charts, labels = grown(points, triangles, 1.0)
        joined.append(labels.max() + 1)
        assert charts.is_plate(labels).tolist() == ([True, False] if keep == slice(None) else [False])
    assert joined == [2, 1]


def test_charts_are_round_where_all_bends_count():
    """A long tube is one chart by its curvature, and pieces that are nearly flat by its normals."""
    points, triangles = cylinder(24, 24)
    charts = charts_of(points, triangles)
    labels = charts.grown(charts.flat(), 3.0, is_stiff=True)
    assert 3 <= labels.max() + 1 <= 12
    along = np.einsum("ij,ij->i", charts.normals, charts.mean_normals(labels)[labels]) / charts.areas
    assert along.min() > 0.7
    assert not charts.grown(labels, 3.0).any()


def test_curvature_inside_costs_as_that_of_a_round_cap():
    """Of a cap with the angle t: pi * t ** 2 of curvature, and t ** 4 / 48 of its area, though its normals differ nowhere."""
    charts = charts_of(*flat(4, 4))
    growth, angle = _Growth(charts, charts.flat()), 0.3
    cost = growth._cost(growth._sums, np.full(len(growth._sums), np.pi * angle**2))
    assert cost == pytest.approx(growth._sums[:, 0] * angle**4 / 48.0, rel=1e-9)
    assert growth._cost(growth._sums, np.zeros(len(growth._sums))) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("height", "spikes"), [(1.0, 1), (0.2, 0)])
def test_a_border_that_leads_to_a_spike_gains_half(height, spikes):
    """Two halves of a pyramid, whose tip would need a cut again: 120 degrees are missing around it, or 9."""
    points = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, height)], float)
    charts = charts_of(points, np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]))
    growth = _Growth(charts, np.array([0, 0, 1, 1]))
    sums, inner = growth._sums, growth._inner
    cost = growth._cost(sums.sum(axis=0)[None], inner.sum() + growth._between) - growth._cost(sums, inner).sum()
    (most,) = growth._prices / cost
    for share in (0.45, 0.55, 0.95, 1.05):
        joins = _Growth(charts, np.array([0, 0, 1, 1])).join(share * most)
        assert joins == (share < 1.0 / (1.0 + spikes)), share


def test_many_small_bends_are_not_flat():
    """A cylinder of 8,000 sides, each of which differs from the next by less than a flat chart has room for."""
    _, labels = grown(*cylinder(1, 8000))
    assert labels.max() + 1 == 16000


def test_the_sides_of_a_cube_are_joined_without_a_corner_inside():
    points, triangles = cube()
    charts, labels = grown(points, triangles)
    assert labels.max() + 1 == 6 and np.bincount(labels).tolist() == [32] * 6
    charts, labels = grown(points, triangles, 1.0)
    assert labels.max() + 1 < 6
    numbers, euler = pieces(triangles, charts.seams(labels))
    assert (euler == 1).all() and numbers.max() == labels.max()
    is_corner = np.isin(points, [0.0, 1.0]).all(axis=1)
    ends, times = np.unique(charts.seams(labels), return_counts=True)
    assert set(np.flatnonzero(is_corner)) <= set(ends)


def test_hard_edges_are_borders():
    points, triangles = cube()
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    on_sides = ((points[ends] == points[ends][:, :1]).all(axis=1)) & np.isin(points[ends][:, 0], [0.0, 1.0])
    hard = ends[on_sides.sum(axis=1) == 2]  # along the edges of the cube
    assert len(np.unique(np.sort(hard, axis=1), axis=0)) == 12 * 4
    charts = charts_of(points, triangles, hard=hard)
    assert charts.grown(charts.flat(), 0.0).max() + 1 == 6


@pytest.mark.parametrize("narrows", [0.0, 0.3])
def test_tubes_and_funnels_are_one_chart_however_much_stretch_counts(narrows):
    points, triangles = cylinder()
    points[:, :2] *= 1.0 - narrows * points[:, 2:]
    charts, labels = grown(points, triangles, 1000.0)
    assert labels.max() == 0
    numbers, euler = pieces(triangles, charts.seams(labels))
    assert euler.tolist() == [1]  # by one slit


def test_seams_in_a_chart_are_cut():
    """One edge from the border inward has two UV vertices at its outer end, and one at its inner end."""
    points, triangles = flat(2, 2)
    charts, labels = grown(points, triangles)
    seam = np.array([(1, 4)])
    assert len(np.unique(charts.nodes(labels, np.arange(24).reshape(8, 3)))) == 9
    nodes = charts.nodes(labels, np.arange(24).reshape(8, 3), seam)
    assert len(np.unique(nodes)) == 10
    assert not charts.between(seam).any()
    assert charts.between(np.array([(1, 4), (4, 7)])).max() == 1


def test_the_slit_of_a_tube_is_the_shortest():
    points, triangles = cylinder(8, 24)
    charts, labels = grown(points, triangles, 1.0)
    seams = charts.seams(labels)
    open_ends = 2 * 24
    assert len(seams) == open_ends + 8
    slit = points[seams[open_ends:]]
    assert np.linalg.norm(slit[:, 1] - slit[:, 0], axis=1).sum() == pytest.approx(2.0)


def test_the_slit_of_a_cone_ends_at_its_tip():
    angle = 2.0 * np.pi * np.arange(24) / 24
    rim = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    points = np.concatenate([rim, [[0.0, 0.0, 2.0]]])
    triangles = np.stack([np.arange(24), (np.arange(24) + 1) % 24, np.full(24, 24)], axis=1)
    charts, labels = grown(points, triangles, 100.0)
    assert labels.max() == 0
    seams = charts.seams(labels)
    assert len(seams) == 24 + 1 and 24 in seams[-1]


@pytest.mark.parametrize("shape", [flat, cylinder, torus, sphere, cube], ids=lambda shape: shape.__name__)
@pytest.mark.parametrize("stretch", [30.0, 1.0, 0.01])
def test_charts_are_disks(shape, stretch):
    points, triangles = shape(8, 8) if shape is flat else shape()
    charts, labels = grown(points, triangles, 30.0, stretch)
    numbers, euler = pieces(triangles, charts.seams(labels))
    assert numbers.max() == labels.max()
    assert (euler == 1).all()


def test_a_whole_torus_and_a_whole_sphere_are_cut_to_disks():
    """Also if nothing but the shape asks for it: no border, handles."""
    for points, triangles in (torus(), sphere()):
        charts = charts_of(points, triangles)
        closed = np.zeros(len(triangles), int)
        _, euler = pieces(triangles, charts.seams(closed))
        assert euler.tolist() == [1]


def test_charts_are_fewer_where_stretch_counts_less():
    points, triangles = sphere()
    counts = [grown(points, triangles, stretch)[1].max() + 1 for stretch in (100.0, 10.0, 1.0, 0.1, 0.0)]
    assert counts == sorted(counts, reverse=True) and counts[0] > 3 * counts[-1]


@pytest.mark.parametrize("most", [8, 40, 100])
def test_charts_grow_to_the_most_faces(most):
    """Those of a flat grid, whose stretch limits none."""
    points, triangles = flat(10, 10)
    charts = Charts(points, triangles, ChartOptions(MARGIN))
    labels = charts.grown(np.arange(charts.count), 1.0, most=most)
    sizes = np.bincount(labels)
    assert most / 2 < sizes.max() <= most
    one, other = labels[charts._sides].T
    apart = one != other
    assert (sizes[one[apart]] + sizes[other[apart]] > most).all()


def most_stretch(bend, wanted=None):
    """How much stretch may count so that two panels are joined that meet at an angle, in degrees: a ridge if positive."""
    angle = np.radians(bend)
    profile = np.array([(0.0, 0.0), (1.0, 0.0), (1.0 + np.cos(angle), -np.sin(angle))])
    points = np.array([(x, y, z) for y in (0.0, 1.0) for x, z in profile])
    triangles = np.array([each for k in range(2) for each in ((k, k + 1, k + 4), (k, k + 4, k + 3))])
    charts = charts_of(points, triangles, faces=np.repeat(np.arange(2), 2), wanted=wanted)
    low, high = 1e-3, 1e3
    for _ in range(30):
        middle = np.sqrt(low * high)
        is_joined = charts.grown(charts.flat(), middle, is_stiff=True).max() == 0
        low, high = (middle, high) if is_joined else (low, middle)
    return low


def test_borders_cost_less_in_folds_in_hollows_and_where_they_are_wanted():
    """The price of an edge is its margins, and that of a split vertex, a tenth of the area by vertex."""
    margins, split = 2.0 * MARGIN * np.sqrt(2.0 / FULL), 0.1 * 2.0 / 6.0
    ridge, hollow, wanted = most_stretch(60.0), most_stretch(-60.0), most_stretch(60.0, np.array([(4, 1)]))
    expected = [share * margins + split for share in (Charts.CHEAP[kind] for kind in ("fold", "concave", "wanted"))]
    assert np.array([ridge, hollow, wanted]) / ridge == pytest.approx(np.array(expected) / expected[0], rel=1e-3)
    bend = 2.0 / 3.0 * 2.0 * (1.0 / np.cos(np.radians(30.0)) - 1.0) ** 2
    assert ridge == pytest.approx(expected[0] / bend, rel=1e-3)


@pytest.mark.parametrize("shape", [torus, cube])
def test_a_closed_surface_has_two_charts_at_least(shape):
    """A chart without a border cannot be flattened."""
    assert grown(*shape(), 0.0)[1].max() == 1


@random_cases.seeds(6, fast=2)
def test_charts_of_spoiled_meshes_are_disks(seed):
    points, triangles = spoiled(seed)
    charts, labels = grown(points, triangles, 10.0, 1.0, 0.1)
    numbers, euler = pieces(triangles, charts.seams(labels))
    assert (
        euler[(np.bincount(numbers) > 1) & ~charts.is_flat(labels)[labels[np.unique(numbers, return_index=True)[1]]]]
        == 1
    ).all()


@random_cases.seeds(3, fast=2)
def test_borders_that_zigzag_become_straight(seed):
    points, triangles = mesh_at_random(seed)
    charts, labels = grown(points, triangles, 3.0)

    def length(labels):
        ends = points[charts.seams(labels)]
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()

    straight = charts.straightened(labels, 3.0)
    assert length(straight) < 0.99 * length(labels)
    assert charts.whole(straight).max() == straight.max() == labels.max()


def test_charts_are_joined_with_one_beside_them_by_the_price_of_the_border():
    """A strip of 1 x 3 at a corner of a plate of 4 x 6, with a square at its end, and a square at another corner."""
    points, triangles = flat(4, 6)
    points = points * (4.0, 6.0, 0.0)
    charts = charts_of(points, triangles)
    x, y, _ = charts.centers.T
    labels = np.select([(y < 1.0) & (x < 3.0), y < 1.0, (y > 5.0) & (x < 1.0)], [1, 2, 3], 0)
    strip, square, far = np.arange(4) == np.array([[1], [2], [3]])

    def joined(chosen, rank=0):
        found = charts.absorbed(labels, chosen, rank)
        return sorted(tuple(sorted(set(labels[found == each].tolist()))) for each in range(found.max() + 1))

    assert joined(strip) == [(0, 1), (2,), (3,)]  # 3 along the plate, 1 along the square
    assert joined(strip, 1) == [(0,), (1, 2), (3,)]
    assert joined(strip, 2) == joined(np.zeros(4, bool)) == [(0,), (1,), (2,), (3,)]
    assert joined(far) == [(0, 3), (1,), (2,)]
    assert joined(square | far) == [
        (0, 3),
        (1,),
        (2,),
    ]  # not the square with the strip, which is as good for it as the plate
    assert joined(strip | square | far) == [(0, 1), (2,), (3,)]  # one alone is joined with the plate


def test_charts_are_halved_where_they_are_longest():
    points, triangles = flat(4, 12)
    points = points * (4.0, 12.0, 0.0)
    charts = charts_of(points, triangles)
    labels = charts.halved(charts.flat(), np.array([True]))
    middle = points[triangles].mean(axis=1)
    assert sorted(np.bincount(labels).tolist()) == [48, 48]
    assert (np.ptp(middle[labels == 0], axis=0)[:2] < (4.0, 6.0)).all()


def test_the_cheapest_parts_are_found():
    """Two charts of four, which cost less in parts than whole, and the other way around."""
    levels = [np.array([0, 0, 1, 2, 3, 3]), np.array([0, 0, 0, 1, 1, 1]), np.zeros(6, int)]
    used, labels = best_parts(levels, [np.array([1.0, 1.0, 2.0, 2.0]), np.array([3.0, 3.0]), np.array([6.0])])
    assert used.tolist() == [0, 0, 0, 1, 1, 1] and labels.tolist() == [0, 0, 1, 2, 2, 2]
    used, labels = best_parts(levels, [np.array([1.0, 1.0, 2.0, 2.0]), np.array([3.0, 3.0]), np.array([5.0])])
    assert used.tolist() == [2] * 6 and not labels.any()


def crossing(uv, triangles, islands):
    return uv_crossings.crossing(uv[triangles], triangles, islands)


def test_borders_that_cross_are_found():
    triangles, places = grid(1, 40)
    angle = places[:, 1] * 2.0 * np.pi * 0.95
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (1.0 + 0.3 * places[:, :1])
    islands = np.zeros(len(triangles), int)
    assert not crossing(ring, triangles, islands).any()
    angle *= 1.2  # the ends overlap
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (1.0 + 0.3 * places[:, :1] + 0.1 * places[:, 1:])
    found = crossing(ring, triangles, islands)
    assert found.any() and not found[np.isclose(places[triangles].mean(axis=1)[:, 1], 0.5, atol=0.2)].any()
    assert not crossing(ring, triangles, np.arange(len(triangles))).any()


def test_borders_whose_lines_alone_cross_are_apart():
    """The line of a side of the small triangle parts the ends of the long side of the other one, but does not reach it."""
    uv = np.array([(0.0, 0.0), (4.0, 0.0), (0.0, 4.0), (3.0, 3.0), (3.0, 2.5), (2.8, 3.0)])
    triangles = np.array([(0, 1, 2), (3, 4, 5)])
    assert not crossing(uv, triangles, np.zeros(2, int)).any()


@pytest.mark.parametrize(("gap", "is_inside_out"), [(0.3, False), (0.0, False), (-0.3, True)])
def test_holes_that_lie_inside_out_are_found(gap, is_inside_out):
    """A ring of triangles around a hole of four corners, the upper and the lower of which lie beyond each other."""
    uv = np.array([(-1, 0), (0, -gap), (1, 0), (0, gap), (0, 3), (-3, 0), (0, -3), (3, 0)], float)
    triangles = np.array([(0, 3, 4), (3, 2, 4), (0, 6, 1), (1, 6, 2), (0, 4, 5), (0, 5, 6), (2, 6, 7), (2, 7, 4)])
    found = crossing(uv, triangles, np.zeros(8, int))
    assert (np.linalg.det(uv[triangles[:, 1:]] - uv[triangles[:, :1]]) > 0.0).all()
    assert found.all() if is_inside_out else not found.any()
    assert np.array_equal(crossing(uv * (-1.0, 1.0), triangles, np.zeros(8, int)), found)


@random_cases.seeds(12, fast=4)
def test_all_pairs_of_sides_find_the_same_crossings(seed):
    """Long and short triangles that share no corner, in two islands: by looking at each pair."""
    random = np.random.default_rng(seed)
    corners = random.standard_normal((60, 1, 2)) + random.standard_normal((60, 3, 2)) * 10.0 ** random.uniform(
        -3, 1, (60, 1, 1)
    )
    islands = random.integers(0, 2, 60)
    first, last = corners, np.roll(corners, -1, axis=1)
    expected = np.zeros(60, bool)

    def side(a, b, c):
        return np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    for i in range(60):
        for j in range(60):
            if i != j and islands[i] == islands[j]:
                pairs = [(first[i, k], last[i, k], first[j, n], last[j, n]) for k in range(3) for n in range(3)]
                expected[i] |= any(
                    side(a, b, c) != side(a, b, d) and side(c, d, a) != side(c, d, b) for a, b, c, d in pairs
                )
    found = uv_crossings.crossing(corners, np.arange(180).reshape(60, 3), islands)
    assert found.tolist() == expected.tolist() and 10 < found.sum() < 60


def test_charts_end_below_a_plane_where_they_do_above_it():
    """A grid of 4 x 6 quads whose rows above the middle are in two charts, and one of those crosses it."""
    triangles, places = grid(4, 6)
    points = np.insert(places - 0.5, 2, 0.0, axis=1)
    faces = np.tile(np.arange(24), 2)
    charts = Charts(points, triangles, ChartOptions(MARGIN, faces=faces))
    row, column = np.divmod(np.arange(24), 6)
    labels = np.where(row >= 2, column >= 2, 2 + row)  # above: two; below: a row each
    labels = np.where((row == 1) & (column < 2), 0, labels)  # the left one crosses the plane
    high, wide = 5, 7
    vertices = (np.arange(high)[::-1, None] * wide + np.arange(wide)).reshape(-1)
    sides = np.where(row >= 2, 1, -1)
    found = charts.mirrored(labels, vertices, sides)
    wanted = np.where(column < 2, 0, np.where(row >= 2, 2, 1))
    assert len(set(zip(found.tolist(), wanted.tolist(), strict=True))) == 3 == found.max() + 1
    other = charts.mirrored(labels, vertices, -sides)
    image = other.reshape(4, 6)[::-1].reshape(-1)
    pairs = set(zip(other.tolist(), image.tolist(), strict=True))
    assert len(pairs) == other.max() + 1 and other[0] == other[5] != other[6] == other[12] == other[18 - 6]
    cut = charts.mirrored(labels, vertices, sides, is_cut=True)
    assert len(set(zip(cut.tolist(), (wanted * 2 + (row >= 2)).tolist(), strict=True))) == 4 == cut.max() + 1
    unknown = charts.mirrored(labels, np.full(high * wide, -1), sides)
    assert len(set(zip(unknown.tolist(), labels.tolist(), strict=True))) == 4 == unknown.max() + 1
