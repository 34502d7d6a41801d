# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts are disks with short borders, and packed islands keep their distance: measured by closed forms and by counting."""

import numpy as np
import pytest

from addon.mesh import uv_crossings, uv_stretch
from addon.mesh.triangle_mesh import Mesh
from addon.mesh.uv_charts import Charts
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


def grown(points, triangles, *stretches):
    charts = Charts(points, triangles, np.arange(len(triangles)), MARGIN)
    for stretch in stretches:
        charts.grow(stretch)
    return charts


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


def cuts(charts, triangles, step=None):
    return charts.seams(np.full(len(triangles), charts.steps if step is None else step))


def test_a_flat_grid_is_one_chart_whose_seams_are_its_border():
    points, triangles = flat(6, 9)
    charts = grown(points, triangles, 1.0)
    assert charts.count == 1
    assert len(cuts(charts, triangles)) == 2 * (6 + 9)


def test_the_sides_of_a_cube_are_charts_if_stretch_counts_much():
    points, triangles = cube()
    charts = grown(points, triangles, 100.0)
    assert charts.count == 6
    assert len(cuts(charts, triangles)) == 12 * 4


def test_hard_edges_are_borders():
    points, triangles = cube()
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    on_sides = ((points[ends] == points[ends][:, :1]).all(axis=1)) & np.isin(points[ends][:, 0], [0.0, 1.0])
    hard = ends[on_sides.sum(axis=1) == 2]  # along the edges of the cube
    assert len(np.unique(np.sort(hard, axis=1), axis=0)) == 12 * 4
    charts = Charts(points, triangles, np.arange(len(triangles)), MARGIN, hard)
    charts.grow(0.001)
    assert grown(points, triangles, 0.001).count < charts.count == 6


@pytest.mark.parametrize("shape", [flat, cylinder, torus, sphere, cube], ids=lambda shape: shape.__name__)
@pytest.mark.parametrize("stretch", [30.0, 1.0, 0.01])
def test_charts_are_disks(shape, stretch):
    points, triangles = shape(8, 8) if shape is flat else shape()
    charts = grown(points, triangles, 30.0, stretch)
    numbers, euler = pieces(triangles, cuts(charts, triangles))
    assert numbers.max() + 1 == charts.count
    assert (euler == 1).all()


def test_charts_are_fewer_where_stretch_counts_less_and_no_more_than_half_a_sphere_bent():
    points, triangles = sphere()
    counts = [grown(points, triangles, stretch).count for stretch in (100.0, 10.0, 1.0, 0.1, 0.0)]
    assert counts == sorted(counts, reverse=True) and counts[0] > 3 * counts[-1]
    charts = grown(points, triangles, 0.0)
    numbers, _ = pieces(triangles, cuts(charts, triangles))
    normals = np.cross(
        points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    )
    for number in range(charts.count):
        mine = normals[numbers == number]
        assert np.linalg.norm(mine.sum(axis=0)) >= 0.38 * np.linalg.norm(mine, axis=1).sum()


@random_cases.seeds(6, fast=2)
def test_charts_of_spoiled_meshes_are_disks(seed):
    points, triangles = spoiled(seed)
    charts = grown(points, triangles, 10.0, 1.0, 0.1)
    _, euler = pieces(triangles, cuts(charts, triangles))
    assert (euler[np.bincount(pieces(triangles, cuts(charts, triangles))[0]) > 1] == 1).all()


@random_cases.seeds(3, fast=2)
def test_borders_that_zigzag_become_straight(seed, monkeypatch):
    points, triangles = sphere()
    points = points + 0.03 * np.random.default_rng(seed).standard_normal(points.shape)

    def length():
        ends = points[cuts(grown(points, triangles, 3.0), triangles)]
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()

    straight = length()
    monkeypatch.setattr(Charts, "_move", lambda *_: False)
    assert straight < 0.99 * length()


def test_faces_can_show_earlier_steps():
    points, triangles = cube()
    charts = grown(points, triangles, 100.0, 0.01)
    steps = np.full(len(triangles), 2)
    assert len(charts.seams(steps)) < 12 * 4
    steps[:5] = 0
    numbers, _ = pieces(triangles, charts.seams(steps))
    assert (np.bincount(numbers)[numbers[:5]] == 1).all()


def mesh_of(uv, triangles):
    return Mesh.of_arrays("", np.insert(uv, 2, 0.0, axis=1), triangles, uv)


def test_borders_that_cross_are_found():
    triangles, places = grid(1, 40)
    angle = places[:, 1] * 2.0 * np.pi * 0.95
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (1.0 + 0.3 * places[:, :1])
    islands = np.zeros(len(triangles), int)
    assert not uv_crossings.crossing(mesh_of(ring, triangles), islands).any()
    angle *= 1.2  # the ends overlap
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (1.0 + 0.3 * places[:, :1] + 0.1 * places[:, 1:])
    found = uv_crossings.crossing(mesh_of(ring, triangles), islands)
    assert found.any() and not found[np.isclose(places[triangles].mean(axis=1)[:, 1], 0.5, atol=0.2)].any()
    assert not uv_crossings.crossing(mesh_of(ring, triangles), np.arange(len(triangles))).any()


def test_borders_whose_lines_alone_cross_are_apart():
    """The line of a side of the small triangle parts the ends of the long side of the other one, but does not reach it."""
    uv = np.array([(0.0, 0.0), (4.0, 0.0), (0.0, 4.0), (3.0, 3.0), (3.0, 2.5), (2.8, 3.0)])
    triangles = np.array([(0, 1, 2), (3, 4, 5)])
    assert not uv_crossings.crossing(mesh_of(uv, triangles), np.zeros(2, int)).any()


def test_folds_and_stretch_are_found():
    points, triangles = flat(4, 4)
    islands = np.zeros(len(triangles), int)
    uv = points[triangles][..., 1::-1]
    assert not np.any(uv_stretch.bad(points[triangles], uv, islands))
    folded, _ = uv_stretch.bad(points[triangles], np.where(np.arange(32)[:, None, None] == 7, uv[:, ::-1], uv), islands)
    assert np.flatnonzero(folded).tolist() == [7]
    # Distances of 1 and k need (1 + k * k) / (2 * k) of the area: 4 / 3 for k = 2.215.
    for factor, is_bad in ((2.2, False), (2.23, True)):
        folded, stretched = uv_stretch.bad(points[triangles], uv * (factor, 1.0), islands)
        assert not folded.any() and (stretched == is_bad).all()
