# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the borders of UV islands against plain loops over triangles and known answers."""

import numpy as np
import pytest

from addon.mesh import uv_seams
from addon.mesh.triangle_mesh import Mesh

SIZE = 200, 100


def mesh(positions, triangles, uv):
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


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
HALVES = np.array([(0, 1, 2), (0, 2, 3)])
FLAT = np.array(SQUARE)[:, :2] * 0.25


def listed(borders):
    """Borders, four complex numbers each, rounded and sorted, with None where the surface ends."""
    numbers = ([None if np.isnan(z.real) else (round(z.real, 4), round(z.imag, 4)) for z in row] for row in borders)
    return sorted(numbers, key=str)


def ends(found):
    """The ends of each border, here and across."""
    return listed(np.concatenate([found.here, found.there], axis=1) + 0.0)


def test_border_of_a_sheet_has_nothing_across():
    found = uv_seams.find([mesh(SQUARE, HALVES, FLAT[HALVES])])
    assert len(found.side) == 4
    assert np.isnan(found.there).all()
    assert (found.side == 1.0).all()
    assert not found.is_mirrored.any()


def test_both_sides_of_a_seam_point_to_each_other():
    uv = FLAT[HALVES].copy()
    uv[1] += (0.5, 0.25)
    found = uv_seams.find([mesh(SQUARE, HALVES, uv)])
    is_known = np.isfinite(found.there[:, 0].real)
    assert np.count_nonzero(is_known) == 2
    assert len(found.side) == 6
    assert np.allclose(np.abs(found.there[is_known] - found.here[is_known]), abs(0.5 + 0.25j))
    assert not found.is_mirrored[is_known].any()


@pytest.mark.parametrize("nudge", [0.0, uv_seams.CONNECTED / 4])
def test_nearly_equal_uvs_join_an_island(nudge):
    uv = FLAT[HALVES] + np.float32(nudge) * np.array([0, 1])[:, None, None]
    assert len(uv_seams.find([mesh(SQUARE, HALVES, uv)]).side) == 4


def test_split_vertices_in_the_same_place_are_connected():
    parted = mesh(np.array(SQUARE)[HALVES].reshape(-1, 3), np.arange(6).reshape(2, 3), FLAT[HALVES])
    parted.positions[:3][parted.positions[:3] == 0.0] *= np.float32(-1.0)  # -0 is 0
    assert ends(uv_seams.find([parted])) == ends(uv_seams.find([mesh(SQUARE, HALVES, FLAT[HALVES])]))


def test_edge_of_three_triangles_is_a_border_of_each():
    positions = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)]
    triangles = np.array([(0, 1, 2), (1, 0, 3), (0, 1, 4)])
    found = uv_seams.find([mesh(positions, triangles, np.array([[(0, 0), (1, 0), (0, 1)]] * 3) * 0.2)])
    assert len(found.side) == 9
    assert np.isnan(found.there).all()


def test_fold_is_a_mirrored_border():
    """Two halves overlap in the map."""
    uv = FLAT[HALVES].copy()
    uv[1, 2] = FLAT[1]
    found = uv_seams.find([mesh(SQUARE, HALVES, uv)])
    is_known = np.isfinite(found.there[:, 0].real)
    assert np.count_nonzero(is_known) == 2
    assert found.is_mirrored[is_known].all()
    assert np.array_equal(found.here[is_known], found.there[is_known])


def test_triangles_without_uv_area_have_no_borders():
    uv = FLAT[HALVES].copy()
    uv[1, 2] = (uv[1, 0] + uv[1, 1]) / 2
    found = uv_seams.find([mesh(SQUARE, HALVES, uv)])
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
    found = uv_seams.find([mesh(positions, triangles, uv)])
    is_pole = (found.here.imag > 0.19).all(axis=1)
    assert np.count_nonzero(is_pole) == 2
    assert np.isnan(found.there[is_pole]).all()


def borders_by_brute_force(mesh):
    """The borders in the form of `ends`, found edge by edge."""
    result = []
    corners = [
        [(tuple(mesh.positions[mesh.vertices[c]]), complex(*mesh.uv[c])) for c in t] for t in mesh.triangles.tolist()
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


@pytest.mark.parametrize("seed", range(4))
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
    sheet = mesh(positions, triangles, uv)
    assert ends(uv_seams.find([sheet])) == borders_by_brute_force(sheet)


@pytest.mark.parametrize("tile", [1001, 1012])
@pytest.mark.parametrize("seed", [1, 2])
def test_similarities_map_each_border_to_the_other_side_seed(seed, tile):
    rng = np.random.default_rng(seed)
    uv = rng.random((2, 3, 2)) * 0.9 + ((tile - 1001) % 10, (tile - 1001) // 10)
    found = uv_seams.find([mesh(SQUARE, HALVES, uv)])
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
    found = uv_seams.find([mesh(SQUARE, HALVES, FLAT[HALVES])])
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
