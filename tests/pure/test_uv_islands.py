# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests UV islands, stacked faces and hard edges on layouts where they are known."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from addon.core import udim
from addon.mesh import uv_islands, uv_layout, uv_seams
from addon.mesh.triangle_mesh import Mesh
from tests.support import random_cases


def mesh(points, triangles, numbers, *, uv, vertices=None, normals=None):
    """A mesh in which each corner has its own point, unless `vertices` gives other indices."""
    vertices = np.arange(len(points)) if vertices is None else vertices
    return Mesh(
        name="low",
        positions=np.asarray(points, np.float32),
        vertices=np.asarray(vertices, np.int32),
        normals=np.asarray(np.zeros((len(vertices), 3)) if normals is None else normals, np.float32),
        triangles=np.asarray(triangles, np.int32),
        to_world=np.eye(4),
        uv=np.asarray(uv, np.float32),
        faces=np.asarray(numbers, np.int32),
    )


def grid(n):
    """The triangles of n x n quads, and the coordinates of their (n + 1)^2 vertices."""
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    first = (i + j * (n + 1)).ravel()
    triangles = np.concatenate(
        [np.stack([first, first + 1, first + n + 2], 1), np.stack([first, first + n + 2, first + n + 1], 1)]
    )
    u, v = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    return triangles, np.stack([u.ravel(), v.ravel()], axis=1) / n


def groups(corners, chosen):
    """The number of groups of triangles that share corners, found by merging them one after another."""
    parts = []
    for triangle in (set(row) for row, wanted in zip(corners, chosen, strict=True) if wanted):
        touching = [part for part in parts if part & triangle]
        parts = [part for part in parts if not part & triangle] + [triangle.union(*touching)]
    return len(parts)


@random_cases.seeds(4, fast=2)
def test_islands_of_random_triangles_of_a_grid(seed):
    rng = np.random.default_rng(seed)
    triangles, uv = grid(12)
    triangles = rng.permutation(triangles)
    chosen = rng.random(len(triangles)) < 0.25
    # Blender stores corners one by one as well.
    corners = np.arange(3 * len(triangles)).reshape(-1, 3)
    low = mesh(
        np.zeros((len(uv), 3)), corners, range(len(corners)), uv=uv[triangles.ravel()], vertices=triangles.ravel()
    )
    truth = groups(triangles.tolist(), chosen)
    assert 5 < truth < chosen.sum()
    assert uv_islands.count_islands(low, chosen) == truth


def test_parts_are_islands_and_the_halves_of_folded_ones_in_the_order_of_their_triangles():
    """Two quads beside a middle line with the same UVs are one island in two parts; a copy beside them is one more."""
    points = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0), (-1, 0, 0), (-1, 1, 0)]
    uv = np.abs(points)[:, :2]
    triangles = [(4, 0, 1), (8, 9, 7), (0, 2, 3), (4, 1, 5), (6, 8, 7), (0, 3, 1)]
    points, uv = np.concatenate([points, np.add(points[:4], 5)]), np.concatenate([uv, uv[:4]])
    low = mesh(points, triangles, [0, 1, 2, 0, 1, 2], uv=uv)
    assert uv_islands.islands(low)[[0, 2, 1]].tolist() in ([0, 0, 1], [1, 1, 0])
    assert uv_islands.parts(low).tolist() == [0, 1, 2, 0, 1, 2]


def test_islands_end_at_seams_and_stay_apart_where_they_overlap():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    separate = [(2, 0), (3, 0), (3, 1), (2, 1)]
    two_quads, corners = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], np.arange(8)
    everything = np.ones(4, bool)
    on_one_surface = [0, 1, 2, 3, 1, 4, 5, 2]  # the second square is the first one's neighbor
    for uv, vertices, count in (
        (square + separate, on_one_surface, 2),  # a seam
        (square + square, corners, 2),  # two islands on the same place
        (square + [(1, 0), (2, 0), (2, 1), (1, 1)], on_one_surface, 1),
    ):
        low = mesh(np.zeros((8, 3)), two_quads, [0, 0, 1, 1], uv=uv, vertices=vertices)
        assert uv_islands.count_islands(low, everything) == count
        assert uv_islands.count_islands(low, ~everything) == 0


def test_split_vertices_give_one_island_when_welded():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    beside = [(1, 0), (2, 0), (2, 1), (1, 1)]
    points = [(x, y, -0.0 if n else 0.0) for n, part in enumerate((square, beside)) for x, y in part]
    low = mesh(points, [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], [0, 0, 1, 1], uv=square + beside)
    assert uv_islands.islands(low).tolist() == [0, 0, 1, 1]
    assert uv_islands.islands(uv_islands.welded(low)).tolist() == [0, 0, 0, 0]


# Faces on the same place


SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * 0.25


def quads(*corners, cut=(0, 1, 2, 0, 2, 3)):
    """Quads with these UVs."""
    uv = np.concatenate(corners)
    triangles = (np.arange(0, len(uv), 4)[:, None] + cut).reshape(-1, 3)
    return mesh(np.zeros((len(uv), 3)), triangles, np.repeat(np.arange(len(corners)), 2), uv=uv)


def groups_of(numbers):
    """The sets of indices with equal numbers."""
    return {tuple(np.flatnonzero(numbers == number).tolist()) for number in numbers}


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("cut", [(0, 1, 2, 0, 2, 3), (0, 1, 3, 1, 2, 3)], ids=["first and third", "second and fourth"])
def test_rotated_and_mirrored_faces_on_the_same_place_are_stacked(turn, way, cut):
    other = np.roll(SQUARE, turn, axis=0)[::way] + np.float32(1e-7)
    low = quads(SQUARE, SQUARE + (0.125, 0), other, SQUARE + (0, 0.25), SQUARE * (1, 0.5), cut=cut)
    assert groups_of(uv_islands.stacks(low)) == {(0, 2), (1,), (3,), (4,)}
    assert uv_islands.without_copies(low).tolist() == np.repeat([True, True, False, True, True], 2).tolist()


@random_cases.seeds(3, fast=2)
def test_stacks_of_a_random_dense_layout(seed):
    """Each quad twice, a fraction of a single-precision step apart, among thousands of others that are close."""
    rng = np.random.default_rng(seed)
    corners = rng.random((5000, 4, 2))
    both = np.concatenate([corners, corners[:, ::-1] + rng.normal(0.0, 3e-8, corners.shape)])
    order = rng.permutation(len(both))
    found = uv_islands.stacks(quads(*both[order]))
    first, second = np.argsort(order).reshape(2, -1)
    np.testing.assert_array_equal(found[first], found[second])
    assert len(np.unique(found)) == len(corners)


@pytest.mark.parametrize("tile", [(1, 0), (-1, 0), (0, 1), (3, -2)])
def test_moved_copies_finds_halves_moved_by_whole_tiles(tile):
    low = quads(SQUARE, SQUARE[::-1] + tile, SQUARE + (0.25, 0) + tile, SQUARE + (0.9, 0.25))
    assert uv_islands.moved_copies(low).tolist() == np.repeat([False, True, False, False], 2).tolist()
    assert not uv_islands.moved_copies(replace(low, triangles=low.triangles[:2], faces=low.faces[:2])).any()


def test_moved_copies_finds_halves_that_touch_the_tile_border():
    rim = SQUARE * 4.0
    low = quads(rim, rim[::-1] + (1, 0), SQUARE + (0.75, 0.75), SQUARE[::-1] + (1.75, -0.25))
    assert uv_islands.moved_copies(low).tolist() == np.repeat([False, True, False, True], 2).tolist()


def test_crossing_finds_triangles_across_tile_borders():
    low = quads(SQUARE, SQUARE * 4.0, SQUARE + (1.5, 0), SQUARE + (0.9, 0), SQUARE + (-0.1, 3), SQUARE * 4.0 + (0, -1))
    assert uv_islands.crossing(low).reshape(-1, 2).any(axis=1).tolist() == [False, False, False, True, True, False]


# Hard edges


def strip(*, degrees=(0.0, 0.0), shift=0.0, parted=False, mirrored=False, turned=False):
    """Two quads side by side. degrees: the angles between their normals at the two ends of the common edge. shift: moves
    the UVs of the second quad. parted: the quads share no vertices. mirrored: the second quad's UVs are folded onto the
    first. turned: the second quad has the opposite winding."""
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
    vertices = [0, 1, 2, 3, 1, 4, 5, 2]
    uv = np.array([points[vertex][:2] for vertex in vertices], float)
    if mirrored:
        uv[5:7, 0] = 0.0
    uv[4:, 0] += shift
    normals = np.tile((0.0, 0.0, 1.0), (8, 1))
    for corner, angle in zip((4, 7), degrees, strict=True):
        normals[corner] = np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))
    if parted:
        points, vertices = [points[vertex] for vertex in vertices], None
    second = [(4, 6, 5), (4, 7, 6)] if turned else [(4, 5, 6), (4, 6, 7)]
    return mesh(points, [(0, 1, 2), (0, 2, 3), *second], [0, 0, 1, 1], uv=uv, vertices=vertices, normals=normals)


@pytest.mark.parametrize(
    ("degrees", "is_hard"), [((0, 0), False), ((0.9, 0.9), False), ((1.1, 0), True), ((0, 90), True)]
)
def test_edge_is_hard_if_normals_differ_at_either_end(degrees, is_hard):
    assert uv_seams.hard_edges(strip(degrees=degrees)).tolist() == ([[1, 2]] if is_hard else [])


def test_hard_seams_are_not_listed():
    hard = {"degrees": (45.0, 45.0)}
    assert uv_seams.hard_edges(strip(shift=0.5, **hard)).tolist() == []
    assert uv_seams.hard_edges(strip(shift=1e-6, **hard)).tolist() == [[1, 2]]
    assert uv_seams.hard_edges(strip(mirrored=True, **hard)).tolist() == []


def test_hard_edges_between_split_vertices_are_listed_from_both_sides():
    assert uv_seams.hard_edges(strip(degrees=(45.0, 45.0), parted=True)).tolist() == [[1, 2], [4, 7]]
    assert uv_seams.hard_edges(strip(parted=True)).tolist() == []


def test_opposite_winding_is_not_mistaken_for_mirroring():
    assert uv_seams.hard_edges(strip(degrees=(45.0, 45.0), turned=True)).tolist() == [[1, 2]]


def test_points_at_a_place():
    triangles, uv = grid(6)
    copies = np.concatenate([triangles, triangles + len(uv)])
    for rows, coordinates, expected in ((triangles, uv, 1.0), (copies, np.tile(uv, (2, 1)), 2.0)):
        low = mesh(np.zeros((len(coordinates), 3)), rows, range(len(rows)), uv=coordinates)
        assert uv_islands.points_at_a_place(low) == expected
    beside = mesh(np.zeros((2 * len(uv), 3)), copies, range(len(copies)), uv=np.concatenate([uv, uv + (2, 0)]))
    assert uv_islands.points_at_a_place(beside) == 1.0


# Uv seams


SIZE = 200, 100


def seam_mesh(positions, triangles, uv):
    """A mesh of triangles (T, 3), indices into positions, with UVs (T, 3, 2) by corner."""
    triangles = np.asarray(triangles)
    corners = np.arange(triangles.size, dtype=np.int32)
    return Mesh(
        name="mesh",
        positions=np.asarray(positions, np.float32),
        vertices=triangles.reshape(-1).astype(np.int32),
        normals=np.zeros((triangles.size, 3), np.float32),
        triangles=corners.reshape(-1, 3),
        to_world=np.eye(4),
        uv=np.asarray(uv, np.float32).reshape(-1, 2),
    )


UNIT_SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
HALVES = np.array([(0, 1, 2), (0, 2, 3)])
FLAT = np.array(UNIT_SQUARE)[:, :2] * 0.25


def listed(borders):
    """Borders, four complex numbers each, rounded and sorted, with None where the surface ends."""
    numbers = ([None if np.isnan(z.real) else (round(z.real, 4), round(z.imag, 4)) for z in row] for row in borders)
    return sorted(numbers, key=str)


def ends(found):
    """The ends of each border, here and across."""
    return listed(np.concatenate([found.here, found.there], axis=1) + 0.0)


def test_border_of_a_sheet_has_nothing_across():
    found = uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, FLAT[HALVES])])
    assert len(found.side) == 4
    assert np.isnan(found.there).all()
    assert (found.side == 1.0).all()
    assert not found.is_mirrored.any()


def test_both_sides_of_a_seam_point_to_each_other():
    uv = FLAT[HALVES].copy()
    uv[1] += (0.5, 0.25)
    found = uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, uv)])
    is_known = np.isfinite(found.there[:, 0].real)
    assert np.count_nonzero(is_known) == 2
    assert len(found.side) == 6
    assert np.allclose(np.abs(found.there[is_known] - found.here[is_known]), abs(0.5 + 0.25j))
    assert not found.is_mirrored[is_known].any()


@pytest.mark.parametrize("nudge", [0.0, uv_seams.CONNECTED / 4])
def test_nearly_equal_uvs_join_an_island(nudge):
    uv = FLAT[HALVES] + np.float32(nudge) * np.array([0, 1])[:, None, None]
    assert len(uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, uv)]).side) == 4


def test_split_vertices_in_the_same_place_are_connected():
    parted = seam_mesh(np.array(UNIT_SQUARE)[HALVES].reshape(-1, 3), np.arange(6).reshape(2, 3), FLAT[HALVES])
    parted.positions[:3][parted.positions[:3] == 0.0] *= np.float32(-1.0)  # -0 is 0
    assert ends(uv_seams.find([parted])) == ends(uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, FLAT[HALVES])]))


def test_edge_of_three_triangles_is_a_border_of_each():
    positions = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)]
    triangles = np.array([(0, 1, 2), (1, 0, 3), (0, 1, 4)])
    found = uv_seams.find([seam_mesh(positions, triangles, np.array([[(0, 0), (1, 0), (0, 1)]] * 3) * 0.2)])
    assert len(found.side) == 9
    assert np.isnan(found.there).all()


def test_fold_is_a_mirrored_border():
    """Two halves overlap in the map."""
    uv = FLAT[HALVES].copy()
    uv[1, 2] = FLAT[1]
    found = uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, uv)])
    is_known = np.isfinite(found.there[:, 0].real)
    assert np.count_nonzero(is_known) == 2
    assert found.is_mirrored[is_known].all()
    assert np.array_equal(found.here[is_known], found.there[is_known])


def test_triangles_without_uv_area_have_no_borders():
    uv = FLAT[HALVES].copy()
    uv[1, 2] = (uv[1, 0] + uv[1, 1]) / 2
    found = uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, uv)])
    assert len(found.side) == 2  # the diagonal to the triangle without area does not count


def test_pole_edge_has_nothing_across():
    """The upper edge of a sphere's quads is one point: it has a length in the map and none on the surface."""
    positions = [(0, 0, 1), (1, 0, 0), (0, 1, 0), (-1, 0, 0)]
    triangles = np.array([(1, 2, 0), (0, 0, 1), (2, 3, 0), (0, 0, 2)])
    uv = (
        np.array(
            [[(0, 0), (1, 0), (1, 1)], [(1, 1), (0, 1), (0, 0)], [(1, 0), (2, 0), (2, 1)], [(2, 1), (1, 1), (1, 0)]]
        )
        * 0.2
    )
    found = uv_seams.find([seam_mesh(positions, triangles, uv)])
    is_pole = (found.here.imag > 0.19).all(axis=1)
    assert np.count_nonzero(is_pole) == 2
    assert np.isnan(found.there[is_pole]).all()


def borders_by_brute_force(seam_mesh):
    """The borders in the form of `ends`, found edge by edge."""
    result = []
    corners = [
        [(tuple(seam_mesh.positions[seam_mesh.vertices[c]]), complex(*seam_mesh.uv[c])) for c in t]
        for t in seam_mesh.triangles.tolist()
    ]
    edges = [(t[i], t[(i + 1) % 3], t[(i + 2) % 3]) for t in corners for i in range(3)]

    def left(a, b, c):
        return np.sign(((b - a).conjugate() * (c - a)).imag)

    for number, (a, b, c) in enumerate(edges):
        others = [e for n, e in enumerate(edges) if n != number and {e[0][0], e[1][0]} == {a[0], b[0]}]
        there = complex("nan"), complex("nan")
        goes_on = False
        if len(others) == 1:
            d, e, f = others[0] if others[0][0][0] == a[0] else (others[0][1], others[0][0], others[0][2])
            if left(d[1], e[1], f[1]):
                there = d[1], e[1]
            goes_on = max(abs(d[1] - a[1]), abs(e[1] - b[1])) <= uv_seams.CONNECTED and left(a[1], b[1], c[1]) != left(
                d[1], e[1], f[1]
            )
        if left(a[1], b[1], c[1]) and not goes_on:
            result.append((a[1], b[1], *there))
    return listed(result)


@random_cases.seeds(4, fast=2)
def test_borders_equal_brute_force_seed(seed):
    rng = np.random.default_rng(seed)
    side = 6
    x, y = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    triangles = np.concatenate(
        [
            np.stack([first, first + 1, first + side + 2], axis=1),
            np.stack([first, first + side + 2, first + side + 1], axis=1),
        ]
    )
    flipped = rng.random(len(triangles)) < 0.2
    triangles[flipped] = triangles[flipped][:, ::-1]
    uv = positions[triangles][..., :2] / 20.0
    uv += 0.5 * rng.integers(0, 2, (len(triangles), 1, 2))  # to one of four places
    mirrored = rng.random(len(triangles)) < 0.3
    uv[mirrored, :, 0] = 0.9 - uv[mirrored, :, 0]
    sheet = seam_mesh(positions, triangles, uv)
    assert ends(uv_seams.find([sheet])) == borders_by_brute_force(sheet)


@pytest.mark.parametrize("tile", [1001, 1012])
@pytest.mark.parametrize("seed", [1, 2])
def test_similarities_map_each_border_to_the_other_side_seed(seed, tile):
    rng = np.random.default_rng(seed)
    uv = rng.random((2, 3, 2)) * 0.9 + ((tile - 1001) % 10, (tile - 1001) // 10)
    found = uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, uv)])
    rows = found.similarities(SIZE, tile).reshape(-1, 8).astype(np.float64)
    here, there, turn = (rows[:, i] + 1j * rows[:, i + 1] for i in (0, 2, 4))
    known = rows[:, 7] == 1.0
    assert np.array_equal(known, np.isfinite(found.there[:, 0].real))
    assert np.array_equal(rows[known, 6] < 0.0, found.is_mirrored[known])
    origin = (tile - 1001) % 10 + 1j * ((tile - 1001) // 10)

    def texels(uv):
        return (uv - origin).real * SIZE[0] + 1j * (uv - origin).imag * SIZE[1]

    def moved(place):
        offset = place - here
        return there + turn * np.where(rows[:, 6] < 0.0, offset.conj(), offset)

    for end in (0, 1):
        assert np.allclose(moved(texels(found.here[:, end]))[known], texels(found.there[:, end])[known], atol=1e-3)
    # A point outside this border is inside the island across.
    along = texels(found.here[:, 1]) - texels(found.here[:, 0])
    outwards = -1j * found.side * along
    inside = moved(texels(found.here.mean(axis=1)) + 0.01 * outwards)[known]
    for place, number in zip(inside, np.flatnonzero(known), strict=True):
        other = next(
            t
            for t in texels(uv[..., 0] + 1j * uv[..., 1])
            if np.abs(t[:, None] - texels(found.there[number])).min(0).max() < 1e-2
        )
        a, b, c = other
        sides = [np.sign(((q - p).conjugate() * (place - p)).imag) for p, q in ((a, b), (b, c), (c, a))]
        assert len(set(sides)) == 1


def test_strip_depth_is_the_distance_from_the_border():
    """Interpolates as the rasterizer does, at random points of every triangle."""
    found = uv_seams.find([seam_mesh(UNIT_SQUARE, HALVES, FLAT[HALVES])])
    triangles, corners = found.strips(SIZE, 1001)
    assert triangles.shape == (4 * 6, 3)
    weights = np.random.default_rng(5).dirichlet((1, 1, 1), 40)
    samples = np.einsum("sk,tkc->tsc", weights, corners[triangles].astype(np.float64))
    place = samples[..., 0] * SIZE[0] + 1j * samples[..., 1] * SIZE[1]
    for border in range(4):
        own = np.all(np.round(samples[..., 3]) == border + 1, axis=1)
        start, stop = found.here[border].real * SIZE[0] + 1j * found.here[border].imag * SIZE[1]
        local = (place[own] - start) * np.conj(stop - start) / abs(stop - start)
        past = np.maximum(0.0, np.abs(local.real - abs(stop - start) / 2) - abs(stop - start) / 2)
        outwards = -local.imag  # the square lies to the left
        assert outwards.min() >= -uv_seams.INSIDE - 1e-3
        assert outwards.max() <= uv_seams.OUTSIDE + 1e-3
        depth = samples[own][..., 2] * 2.0 * uv_seams.OUTSIDE - uv_seams.INSIDE
        truth = np.where(past > 0.0, np.hypot(past, outwards), outwards)
        assert (depth >= truth - 2.0 * uv_seams.INSIDE).all()
        assert (depth <= 1.09 * truth + 2.0 * uv_seams.INSIDE).all()
        a, b, c = np.moveaxis(
            corners[triangles[own]][..., 0] * SIZE[0] + 1j * corners[triangles[own]][..., 1] * SIZE[1], 1, 0
        )
        area = np.abs(((b - a).conj() * (c - a)).imag).sum() / 2.0
        assert np.isclose(
            area, (abs(stop - start) + 2 * uv_seams.OUTSIDE) * (uv_seams.INSIDE + uv_seams.OUTSIDE), rtol=1e-3
        )
    assert corners[:, 2].min() >= 0.0
    assert corners[:, 2].max() < 1.0


# Uv layout


def layout_quads(u, width):
    """Squares whose left sides are at `u` (N,), from v = 0 to `width`, as a mesh of two triangles each."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)], np.float32) * np.float32(width)
    uv = (corners + np.stack([u, np.zeros_like(u)], axis=1)[:, None]).reshape(-1, 2).astype(np.float32)
    numbers = np.arange(len(uv), dtype=np.int32)
    positions = np.column_stack([uv, np.zeros(len(uv), np.float32)])
    return Mesh("mesh", positions, numbers, np.zeros_like(positions), numbers.reshape(-1, 3), np.eye(4), uv)


@pytest.mark.parametrize("is_along_v", [False, True])
@pytest.mark.parametrize(("tiles", "share"), [((1, 1), 0.625), ((2, 1), 0.0)])
def test_the_share_that_is_cut_off_is_that_of_the_area_outside(tiles, share, is_along_v):
    mesh = layout_quads(np.array([0.0, 0.75, 1.0, 1.75 if share else 1.5], np.float32), 0.5)
    if is_along_v:
        mesh, tiles = replace(mesh, uv=mesh.uv[:, ::-1].copy()), tiles[::-1]
    assert uv_layout.cut_off(mesh, uv_layout.outside(mesh, tiles), tiles) == pytest.approx(share, abs=0.01)


def test_a_square_that_fills_a_tile_is_on_no_other():
    assert uv_layout.tiles(layout_quads(np.zeros(1), 1.0)) == [1001]
    assert uv_layout.tiles(layout_quads(np.array([1.0, 0.5]), 1.0)) == [1001, 1002]


def test_the_area_outside_of_a_large_mesh_takes_little_memory():
    mesh = layout_quads(np.linspace(2.0, 3.0, 100_000, dtype=np.float32), 0.5)
    tracemalloc.start()
    try:
        assert uv_layout.cut_off(mesh, uv_layout.outside(mesh)) == 1.0
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()


# Over centers


CENTERS_SIZE = 24, 16


def centers_mesh(corners):
    """Triangles (T, 3, 2) in UV space."""
    uv = np.asarray(corners, np.float32).reshape(-1, 2)
    numbers = np.arange(len(uv), dtype=np.int32)
    flat = np.zeros((len(uv), 3), np.float32)
    return Mesh("m", flat, numbers, flat, numbers.reshape(-1, 3), np.eye(4), uv=uv)


def box(x, y, width, height, size=CENTERS_SIZE):
    """A triangle whose box begins at the texel coordinates x and y."""
    return np.array([(x, y), (x + width, y), (x, y + height)]) / size


def over(*corners, uv_to_clip=None, **options):
    return uv_layout.over_centers(
        centers_mesh(corners), uv_to_clip or udim.uv_to_clip(), CENTERS_SIZE, **options
    ).tolist()


@pytest.mark.parametrize("axis", [0, 1])
def test_only_a_triangle_beside_all_centers_is_left_out(axis):
    def at(start, extent):
        return box(*((start, 2.0) if axis == 0 else (2.0, start)), *((extent, 1.0) if axis == 0 else (1.0, extent)))

    beside, around, touching = at(3.6, 0.8), at(3.6, 1.0), at(3.6, 0.9)
    assert over(beside, around, beside, touching) == [1, 3]


@pytest.mark.parametrize("start", [3.5, 3.5 + 0.9 / 32, 4.5 - 0.5 - 0.9 / 32])
def test_what_rounding_may_move_onto_a_center_stays(start):
    assert over(box(start, 2.0, 0.5, 1.0)) == [0]


def test_triangles_outside_the_texels_are_left_out():
    inside, left, above = box(0.2, 0.2, 1, 1), box(-5, 2, 4, 1), box(2, 17, 1, 4)
    assert over(left, inside, above) == [1]
    shifted = udim.uv_to_clip(1001, CENTERS_SIZE, (0, 8), (CENTERS_SIZE[0], CENTERS_SIZE[1]))
    assert over(inside, box(0.2, 9.2, 1, 1), uv_to_clip=shifted) == [1]
    assert over(inside + (1.0, 0.0), uv_to_clip=udim.uv_to_clip(1002)) == [0]


def test_a_part_has_the_numbers_of_the_whole():
    small, large = box(3.6, 2, 0.5, 1), box(3, 2, 2, 2)
    assert over(large, small, large, large, part=slice(1, 3)) == [2]


def test_values_that_are_not_finite_are_left_out():
    assert over(box(2, 2, 3, 3), box(2, np.nan, 3, 3), box(np.inf, 2, 3, 3)) == [0]


@random_cases.seeds(4, fast=2)
def test_random_triangles_over_a_center_stay(seed):
    random = np.random.default_rng(seed)
    corners = random.uniform(-0.1, 1.1, (4000, 1, 2)) + random.normal(0, 0.03, (4000, 3, 2))
    offset = random.uniform(-0.5, 0.5, 2)
    uv_to_clip = udim.uv_to_clip(1001, CENTERS_SIZE, offset, CENTERS_SIZE)
    kept = uv_layout.over_centers(centers_mesh(corners), uv_to_clip, CENTERS_SIZE)
    x, y = np.meshgrid(*(np.arange(size) + 0.5 for size in CENTERS_SIZE))
    centers = np.stack([x.ravel(), y.ravel()], axis=1) + offset
    a, b, c = (np.asarray(corners, np.float32).astype(np.float64) * CENTERS_SIZE).transpose(1, 0, 2)[:, :, None]
    sides = [_cross(end - start, centers - start) for start, end in ((a, b), (b, c), (c, a))]
    covers = (np.all([side >= 0 for side in sides], axis=0) | np.all([side <= 0 for side in sides], axis=0)).any(axis=1)
    assert 0.1 < covers.mean() < 0.8
    assert np.isin(np.flatnonzero(covers), kept).all()
    assert len(kept) < 0.9 * len(corners)


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


# Uv blocks


SIDE = 8
ROOM = 0.05
"""Texels: rasterizers move corners by less."""


def mesh_of(uv):
    """Triangles (T, 3, 2) of corners in UV space."""
    count = len(uv) * 3
    return Mesh(
        "some",
        np.zeros((count, 3), np.float32),
        np.arange(count, dtype=np.int32),
        np.zeros((count, 3), np.float32),
        np.arange(count, dtype=np.int32).reshape(-1, 3),
        np.eye(4),
        uv=uv.reshape(-1, 2).astype(np.float32),
    )


@random_cases.seeds(4, fast=2)
@pytest.mark.parametrize(("size", "tile"), [((64, 64), 1001), ((40, 21), 1001), ((32, 64), 1012)])
def test_random_triangles_are_found_in_the_squares_that_their_boxes_touch(seed, size, tile):
    random = np.random.default_rng(seed)
    uv = random.random((300, 1, 2)) * 1.4 - 0.2 + random.normal(0.0, 0.03, (300, 3, 2)) + udim.place(tile)
    uv[:5] = np.nan
    blocks = random.random((-(-size[1] // SIDE), -(-size[0] // SIDE))) < 0.2
    found = uv_layout.touching(mesh_of(uv), udim.uv_to_clip(tile, size), size, blocks, SIDE)
    texels = (uv - udim.place(tile)) * size
    for chosen, corners in zip(found, texels, strict=True):
        if np.isnan(corners).any():
            assert not chosen
            continue
        touches = []
        for room in (0.0, ROOM):
            low, high = (corners.min(axis=0) - room) // SIDE, (corners.max(axis=0) + room) // SIDE
            x, y = (slice(max(0, int(first)), max(0, int(last) + 1)) for first, last in zip(low, high, strict=True))
            touches.append(blocks[y, x].any())
        assert touches[0] <= chosen <= touches[1]


@pytest.mark.parametrize("step", [-1.0, 1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_triangle_that_a_rasterizer_may_move_into_a_square_is_found(step, axis):
    blocks = np.zeros((3, 3), bool)
    blocks[1, 1] = True
    for distance, expected in ((0.01, True), (0.5, False)):
        corners = np.full((1, 3, 2), 12.0)
        corners[0, :, axis] += step * (4.0 + distance)
        corners[0, 1, axis] += step
        found = uv_layout.touching(mesh_of(corners / 24), udim.uv_to_clip(1001, (24, 24)), (24, 24), blocks, SIDE)
        assert found.tolist() == [expected]


@random_cases.seeds(4, fast=2)
@pytest.mark.parametrize("most", [1, 3, 1000])
def test_random_choices_are_held_by_ranges_with_the_smallest_gaps(seed, most):
    chosen = np.random.default_rng(seed).random(200) < 0.1
    found = uv_layout.runs(chosen, most)
    held = np.zeros(200, bool)
    for first, count in found:
        assert not held[first : first + count].any()
        held[first : first + count] = True
    assert len(found) <= most
    assert (held >= chosen).all()
    if most == 1000:
        assert np.array_equal(held, chosen)
    if most == 3:
        gaps = np.sort(np.diff(np.flatnonzero(chosen)) - 1)[::-1]
        assert np.count_nonzero(~held[np.flatnonzero(chosen)[0] : np.flatnonzero(chosen)[-1]]) == gaps[:2].sum()


def test_nothing_chosen_has_no_ranges():
    assert uv_layout.runs(np.zeros(5, bool), 4) == []


@random_cases.seeds(4, fast=2)
@pytest.mark.parametrize(("size", "tile"), [((64, 64), 1001), ((40, 21), 1001), ((128, 64), 1012)])
def test_squares_of_random_triangles_hold_them_and_lie_close(seed, size, tile):
    random = np.random.default_rng(seed)
    uv = random.random((6, 1, 2)) * 1.4 - 0.2 + random.normal(0.0, 0.3, (6, 3, 2)) + udim.place(tile)
    uv[0] = np.nan
    side = 4
    squares = uv_layout.covered_squares([mesh_of(uv[:3]), mesh_of(uv[3:])], udim.uv_to_clip(tile, size), size, side)
    weights = random.dirichlet((0.5, 0.5, 0.5), 4000)
    points = ((weights @ (uv[1:] - udim.place(tile))) * size).reshape(-1, 2)
    hit = np.zeros_like(squares)
    x, y = (points[((points >= 0.0) & (points < size)).all(axis=1)] // side).astype(int).T
    hit[y, x] = True
    assert squares[hit].all()
    for row, column in np.argwhere(squares):
        corner = np.array((column, row)) * side
        near = ((points > corner - 2.1 * side) & (points < corner + 3.1 * side)).all(axis=1)
        assert near.any()


def test_squares_of_a_long_diagonal_sliver_are_few():
    corners = np.array([[[0.0, 0.0], [1.0, 1.0], [0.999, 1.0]]])
    squares = uv_layout.covered_squares([mesh_of(corners)], udim.uv_to_clip(1001, (256, 256)), (256, 256), 4)
    assert 64 <= np.count_nonzero(squares) < 4 * 64


def test_all_squares_count_where_a_triangle_is_too_large_to_split():
    corners = np.array([[[-9.0, -9.0], [9.0, -9.0], [-9.0, 9.0]]])
    assert uv_layout.covered_squares([mesh_of(corners)], udim.uv_to_clip(1001, (16, 16)), (16, 16), 4).all()
    assert not uv_layout.covered_squares([mesh_of(corners + 20.0)], udim.uv_to_clip(1001, (16, 16)), (16, 16), 4).any()


def test_all_squares_count_where_triangles_have_too_many_pieces(monkeypatch):
    corners = np.array([[[0.0, 0.0], [1.0, 1.0], [0.999, 1.0]]])
    monkeypatch.setattr(uv_layout, "MOST_PIECES", 16)
    assert uv_layout.covered_squares([mesh_of(corners)], udim.uv_to_clip(1001, (256, 256)), (256, 256), 4).all()


def test_uvs_that_lie_too_far_outside_for_numbers_give_no_warning():
    corners = np.array([[[-3e38, 3e38], [0.2, 3e38], [np.nan, np.inf]]])
    with np.errstate(over="raise", invalid="raise"):
        found = uv_layout.touching(
            mesh_of(corners), udim.uv_to_clip(1001, (16, 16)), (16, 16), np.ones((4, 4), bool), 4
        )
    assert found.shape == (1,)
