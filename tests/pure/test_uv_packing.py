# SPDX-License-Identifier: GPL-3.0-or-later
"""Packed islands keep their shape and their distance, and fill the map."""

import dataclasses

import numpy as np
import pytest

from addon.mesh import topology, uv_cells, uv_packing

MARGIN = 1.0 / 256.0


def random_islands(seed, count=8):
    """Triangles (T, 3, 2) of stars that are not convex, some with a hole, and their islands (T,)."""
    random = np.random.default_rng(seed)
    corners, islands = [], []
    for island in range(count):
        sides = random.integers(3, 12)
        angle = 2.0 * np.pi * np.arange(sides + 1) / sides
        radius = np.append(found := random.uniform(0.3, 1.0, sides), found[0])
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None] * random.uniform(0.05, 1.0)
        hole = rim * random.choice([0.0, 0.5])
        here = [(hole[:-1], rim[:-1], rim[1:]), (hole[:-1], rim[1:], hole[1:])]
        found = np.concatenate([np.stack(each, axis=1) for each in here[: 1 + bool(hole.any())]])
        corners.append(found + random.uniform(-3.0, 3.0, 2))
        islands += [island] * len(found)
    return np.concatenate(corners), np.array(islands)


def pack(corners, islands, margin, *, is_quick=False):
    """The UVs (T, 3, 2) of packed triangles (T, 3, 2); None if they do not fit."""
    options = uv_packing.PackOptions(margin, islands, is_quick)
    found = uv_packing.pack(corners.reshape(-1, 2), np.arange(3 * len(corners)).reshape(-1, 3), options)
    return None if found is None else found.reshape(-1, 3, 2)


def area(corners):
    """The area of all triangles (T, 3, 2) together."""
    return 0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum()


def least_distances(corners, islands, steps=8):
    """The least distance along u or v, whichever is larger, of points on the sides of two islands, and to the map's border."""
    share = np.arange(steps) / steps
    points = corners[:, :, None] * (1.0 - share)[:, None] + np.roll(corners, -1, axis=1)[:, :, None] * share[:, None]
    points = points.reshape(len(corners), -1, 2)
    found = [points[islands == island].reshape(-1, 2) for island in range(islands.max() + 1)]
    between = min(np.abs(a[:, None] - b[None]).max(axis=2).min() for k, a in enumerate(found) for b in found[:k])
    return between, min(points.min(), (1.0 - points).min())


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("margin", [1.0 / 256.0, 3.0 / 512.0, 0.02])
def test_packed_islands_keep_their_distance_and_their_shape(seed, margin):
    corners, islands = random_islands(seed)
    moved = pack(corners, islands, margin, is_quick=True)
    between, border = least_distances(moved, islands)
    assert between > 2.0 * margin and border >= margin * (1.0 - 1e-6)
    before, after = (np.linalg.norm(x - np.roll(x, -1, axis=1), axis=2) for x in (corners, moved))
    assert after / before == pytest.approx(np.full(before.shape, (after / before)[0, 0]))
    areas = [np.linalg.det(x[:, 1:] - x[:, :1]) for x in (corners, moved)]
    assert (np.sign(areas[0]) == np.sign(areas[1])).all()  # not mirrored


def test_squares_fill_most_of_the_map():
    """64 squares, with 4 texels of 1024 around each, in a map that would have place for them if they had 0.117."""
    square = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)
    corners, islands = np.tile(square, (64, 1, 1)), np.repeat(np.arange(64), 2)
    side = np.sqrt(area(pack(corners, islands, MARGIN)) / 64.0)
    assert 0.1 < side <= 0.125 - 2.0 * MARGIN


@pytest.mark.slow
def test_more_orders_pack_larger():
    corners, islands = random_islands(7, 16)
    quick, slow = (pack(corners, islands, MARGIN, is_quick=is_quick) for is_quick in (True, False))
    assert area(slow) > area(quick)


def test_what_does_not_fit_is_not_packed():
    corners, islands = random_islands(1)
    for margin in (0.3, 0.5, 0.7):
        assert pack(corners, islands, margin) is None
    assert pack(0.0 * corners, islands, MARGIN) is None
    assert pack(np.nan * corners, islands, MARGIN) is None
    corners, islands = boxes([(100.0, 100.0)])
    assert beside(corners, islands, between([0.4], [0.6])) is None


def test_an_island_lies_in_the_hole_of_another():
    """A ring of 0.8 with a hole of 0.6, and a square of 0.4: together they need no more than the ring."""
    places = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float) - 0.5
    nodes = np.concatenate([places, 0.75 * places])
    ring = [triangle for k in range(4) for triangle in ((k, (k + 1) % 4, k + 4), ((k + 1) % 4, (k + 1) % 4 + 4, k + 4))]
    corners = np.concatenate([nodes[np.array(ring)], 0.5 * places[np.array([[0, 1, 2], [0, 2, 3]])]])
    packed = pack(corners, np.array([0] * 8 + [1] * 2), MARGIN)
    assert area(packed) > 0.94 * area(corners)


def test_a_quick_search_tries_few_sizes(monkeypatch):
    """Of strips of 20 that do not fit at first, 5: what was found tells how large it can be, until it fills the map."""
    sizes, tries = [], uv_packing._Search._try
    monkeypatch.setattr(uv_packing._Search, "_try", lambda search, size: sizes.append(size) or tries(search, size))
    strip = np.array([[0, 0], [1, 0], [1, 20], [0, 20]], float)[np.array([[0, 1, 2], [0, 2, 3]])]
    packed = pack(np.concatenate([strip, strip + (5.0, 0.0)]), np.array([0, 0, 1, 1]), MARGIN, is_quick=True)
    assert len(sizes) <= 6
    assert packed.max() == pytest.approx(1.0 - MARGIN, abs=1e-6)


def test_a_search_ends_where_an_island_is_as_long_as_the_map(monkeypatch):
    """With room for the other island beside it, one size is tried, at which it just fits."""
    tried, tries = [], uv_packing._Search._try
    monkeypatch.setattr(
        uv_packing._Search, "_try", lambda search, size: tried.append(20.0 * size / search.side) or tries(search, size)
    )
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)[np.array([[0, 1, 2], [0, 2, 3]])]
    packed = pack(np.concatenate([square * (1.0, 20.0), square + 5.0]), np.array([0, 0, 1, 1]), MARGIN)
    assert tried == pytest.approx([1.0])
    assert packed.max() == pytest.approx(1.0 - MARGIN, abs=1e-6)


def test_an_island_much_longer_than_the_map_does_not_stop_the_search():
    """Nothing is packed, as the other island would have no cell."""
    corners = np.array([[(0.0, 0.0), (1e6, 0.0), (1e6, 1.0)], [(0.0, 2.0), (500.0, 2.0), (0.0, 502.0)]])
    assert pack(corners, np.array([0, 1]), 0.01) is None


def boxes(sizes, angles=None):
    """Triangles (2 N, 3, 2) of rectangles, each turned by an angle, and their islands."""
    unit = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)
    corners = unit * np.asarray(sizes, float)[:, None, None]
    angles = np.zeros(len(sizes)) if angles is None else angles
    turns = np.moveaxis(np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]), 2, 0)
    return np.einsum("nij,ntcj->ntci", turns, corners).reshape(-1, 3, 2), np.repeat(np.arange(len(sizes)), 2)


def test_many_small_islands_keep_their_distance():
    """300 strips are packed by their boxes, in rows."""
    random = np.random.default_rng(3)
    corners, islands = boxes(
        np.stack([random.uniform(0.5, 1.0, 300), np.full(300, 0.01)], 1), random.uniform(0, 3, 300)
    )
    packed = pack(corners, islands, MARGIN)
    middle = 0.5 * (packed.reshape(300, 6, 2).min(axis=1) + packed.reshape(300, 6, 2).max(axis=1))
    half = 0.5 * np.ptp(packed.reshape(300, 6, 2), axis=1)
    apart = (np.abs(middle[:, None] - middle) - half[:, None] - half).max(axis=2)
    assert apart[~np.eye(300, dtype=bool)].min() >= 2.0 * MARGIN * (1.0 - 1e-6)
    assert packed.min() >= MARGIN * (1.0 - 1e-6) and packed.max() <= 1.0 - MARGIN * (1.0 - 1e-6)
    # The strips with their margin take most of the map.
    factor, length = np.sqrt(area(packed) / area(corners)), np.linalg.norm(corners[::2, 1] - corners[::2, 0], axis=1)
    assert ((factor * 0.01 + 2.0 * MARGIN) * (factor * length + 2.0 * MARGIN)).sum() > 0.85


@pytest.mark.parametrize("seed", range(3))
def test_the_lowest_free_place_is_found(seed):
    """Beside a search of all places, one after the other. In a strip where shapes were, and that is clear again."""
    random = np.random.default_rng(seed)
    sizes = random.integers(1, 14, (30, 2))
    masks = [random.random(size[::-1]) < 0.6 for size in sizes.tolist()]
    for mask in masks:
        mask[0, 0] = mask[-1, -1] = True
    rows = [
        (k, r, *run)
        for k, m in enumerate(masks)
        for r, line in enumerate(m)
        for run in zip(*topology.runs(line), strict=True)
    ]
    runs = uv_cells.Runs(*np.array(rows).T)
    side, height, gap = 37 + seed, 60, 2
    shapes = uv_cells.Shapes(sizes, runs, (side, height))
    strip, taken = uv_cells.Strip((side, height), gap), np.zeros((height, side), bool)
    for k in range(len(masks)):
        strip.add(shapes, k, k % (side - 13), k)
    strip.clear(shapes.powers)
    assert shapes.cells.tolist() == [mask.sum() for mask in masks]
    for k, mask in enumerate(masks):
        high, wide = mask.shape
        places = ((x, y) for y in range(height - high + 1) for x in range(side - wide + 1))
        found = next((at for at in places if not (taken[at[1] :, at[0] :][:high, :wide] & mask).any()), None)
        assert strip.first_free(shapes, k, height) == found
        if found is not None:
            assert found[1] == 0 or strip.first_free(shapes, k, found[1]) is None
            strip.add(shapes, k, *found)
            for y, x in np.argwhere(mask) + found[::-1]:
                taken[max(y - gap, 0) : y + gap + 1, max(x - gap, 0) : x + gap + 1] = True


def touched(corners, side):
    """The cells (side, side) bool, rows first, that a triangle (3, 2) touches: no line along a side of either parts them."""
    sides = np.roll(corners, -1, axis=0) - corners
    across = np.concatenate([np.eye(2), np.stack([-sides[:, 1], sides[:, 0]], axis=1)])
    rows, columns = np.mgrid[:side, :side]
    cells = np.stack([np.stack([columns + x, rows + y], axis=2) for x in (0, 1) for y in (0, 1)]) @ across.T
    low, high = (corners @ across.T).min(axis=0), (corners @ across.T).max(axis=0)
    return ((cells.min(axis=0) < high) & (cells.max(axis=0) > low)).all(axis=2)


@pytest.mark.parametrize("seed", range(4))
def test_outlines_cover_what_triangles_touch(seed):
    """Strips that fold over, triangles that lie on each other, stars with holes: beside each triangle by itself."""
    random, side = np.random.default_rng(seed), 24
    strip = random.uniform(0.0, side, (9, 2))
    loose = random.uniform(0.0, side, (5, 3, 2))
    stars, of = random_islands(seed, 3)
    stars = (stars - stars.min(axis=(0, 1))) * side / np.ptp(stars, axis=(0, 1)).max()
    corners = np.concatenate([np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1), loose, loose[:2, ::-1], stars])
    owner = np.concatenate([np.zeros(7, int), np.ones(7, int), of + 2])
    sizes = np.full((5, 2), side)
    outlines = uv_cells.Outlines.around(corners, owner)
    expected = np.zeros((5, side, side), bool)
    for triangle, island in zip(corners, owner, strict=True):
        expected[island] |= touched(triangle, side)
    for points, cells in ((outlines.points, expected), (outlines.points[:, ::-1], expected.transpose(0, 2, 1))):
        runs, found = (
            uv_cells.rasterize(dataclasses.replace(outlines, points=points), sizes),
            np.zeros(cells.shape, bool),
        )
        at = topology.ranges((runs.owner * side + runs.row) * side + runs.column, runs.length)
        found.reshape(-1)[at] = True
        assert len(np.unique(at)) == len(at)
        assert (found == cells).all()
    # A grid of triangles has no more sides than its border.
    u, v = np.mgrid[:20, :20].reshape(2, -1)
    squares = np.stack([u, v], axis=1)[:, None] + np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    grid = np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]]).astype(float)
    assert (uv_cells.Outlines.around(grid, np.zeros(800, int)).layers > 0).sum() == 80


def test_straight_borders_run_along_the_axes():
    corners, islands = boxes([(3.0, 1.0), (1.0, 1.0), (2.0, 1.9)], np.radians([20.0, 0.0, 100.0]))
    angles, is_straight = uv_packing.upright(uv_cells.Outlines.around(corners, islands))
    assert np.degrees(angles) % 90.0 == pytest.approx([70.0, 0.0, 80.0], abs=1e-9) and is_straight.all()
    packed = pack(corners, islands, MARGIN)
    steps = np.abs(np.diff(packed, axis=1)[::2, 0])  # along the first side of each
    assert steps.min(axis=1) == pytest.approx([0.0] * 3, abs=1e-9)


@pytest.mark.parametrize("degrees", [0.0, 1.5, 20.0, 88.5])
def test_borders_that_are_nearly_parallel_turn_no_rectangle(degrees):
    """A trapezoid, whose ends slant by 1.5 and 1.2 degrees: its parallel sides lie along an axis."""
    slant = np.tan(np.radians([1.5, 1.2])) * 2.0
    around = np.array([(0.0, 0.0), (3.0, 0.0), (3.0 - slant[0], 2.0), (slant[1], 2.0)])
    turn = np.radians(degrees)
    around = around @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    corners = around[[[0, 1, 2], [0, 2, 3]]]
    (angle,), (is_straight,) = uv_packing.upright(uv_cells.Outlines.around(corners, np.zeros(2, int)))
    off = (np.degrees(angle) + degrees + 45.0) % 90.0 - 45.0
    assert off == pytest.approx(0.0, abs=1e-9) and is_straight


def test_without_straight_borders_the_box_is_the_smallest():
    """An ellipse, turned by 30 degrees: its box along its own axes is the smallest."""
    angles = 2.0 * np.pi * np.arange(91) / 90
    rim = np.stack([1.5 * np.cos(angles), np.sin(angles)], axis=1) @ np.array([[0.75**0.5, 0.5], [-0.5, 0.75**0.5]])
    rim[-1] = rim[0]
    corners = np.stack([0.0 * rim[:-1], rim[:-1], rim[1:]], axis=1)
    (angle,), (is_straight,) = uv_packing.upright(uv_cells.Outlines.around(corners, np.zeros(90, int)))
    assert np.degrees(angle) % 90.0 == pytest.approx(60.0, abs=1.0) and not is_straight


def test_an_island_alone_fills_the_smallest_square():
    """A square fills the map. A strip lies along the diagonal: with the sides 8 and 1, in a square of 9 / sqrt(2)."""
    corners, islands = boxes([(1.0, 1.0)], [0.5])
    assert area(pack(corners, islands, MARGIN)) == pytest.approx((1.0 - 2.0 * MARGIN) ** 2)
    corners, islands = boxes([(8.0, 1.0)], [0.3])
    packed = pack(corners, islands, MARGIN)
    assert area(packed) == pytest.approx(16.0 / 81.0 * (1.0 - 2.0 * MARGIN) ** 2, rel=1e-3)
    assert packed.min() == pytest.approx(MARGIN) and packed.max() == pytest.approx(1.0 - MARGIN)


@pytest.mark.parametrize("seed", range(3))
def test_packed_islands_reach_the_margin(seed):
    packed = pack(*random_islands(seed), MARGIN, is_quick=True).reshape(-1, 2)
    assert packed.min(axis=0) == pytest.approx([MARGIN] * 2)
    assert packed.max() == pytest.approx(1.0 - MARGIN)


def beside(corners, islands, staying, margin=MARGIN):
    """The UVs (T, 3, 2) of triangles packed beside those that stay; None if they do not fit."""
    options = uv_packing.PackOptions(margin, islands, staying=staying)
    found = uv_packing.pack(corners.reshape(-1, 2), np.arange(3 * len(corners)).reshape(-1, 3), options)
    return None if found is None else found.reshape(-1, 3, 2)


def between(lows, highs):
    """Triangles (2 N, 3, 2) of rectangles between corners (N, 2)."""
    lows, highs = np.array(lows, float), np.array(highs, float)
    corners = boxes(np.ones((len(lows), 2)))[0].reshape(-1, 2, 3, 2)
    return (lows[:, None, None] + corners * (highs - lows)[:, None, None]).reshape(-1, 3, 2)


@pytest.mark.parametrize("margin", [1.0 / 256.0, 0.013])
def test_a_square_goes_into_the_only_hole(margin):
    """If it leaves two margins on each side, and keeps its size."""
    low, side = np.array([0.31, 0.52]), 0.3
    frame = between(
        [(0, 0), (low[0] + side, 0), (low[0], 0), (low[0], low[1] + side)],
        [(low[0], 1), (1, 1), (low[0] + side, low[1]), (low[0] + side, 1)],
    )
    largest = side - 4.0 * margin
    corners, islands = boxes([(1.0, 1.0)])
    packed = beside(corners * (largest - 3.0 / 512.0), islands, frame, margin)
    assert np.ptp(packed, axis=(0, 1)) == pytest.approx([largest - 3.0 / 512.0] * 2)
    assert (packed >= low + 2.0 * margin - 1e-9).all() and (packed <= low + side - 2.0 * margin + 1e-9).all()
    assert beside(corners * (largest + 1e-4), islands, frame, margin) is None


@pytest.mark.parametrize("seed", range(2))
def test_islands_beside_others_keep_their_distance_and_their_size(seed):
    corners, islands = random_islands(seed, 12)
    first = pack(corners, islands, MARGIN, is_quick=True)
    staying, coming = 0.7 * first[islands < 6] + 0.2, 0.3 * first[islands >= 6]
    moved = beside(coming, islands[islands >= 6] - 6, staying)
    apart, border = least_distances(np.concatenate([staying, moved]), islands)
    assert apart > 2.0 * MARGIN * 0.7 and border >= MARGIN * (1.0 - 1e-6)
    apart, _ = least_distances(np.concatenate([staying, moved]), np.where(islands < 6, 0, islands - 5))
    assert apart > 2.0 * MARGIN
    sides = [np.linalg.norm(x - np.roll(x, -1, axis=1), axis=2) for x in (coming, moved)]
    assert sides[1] == pytest.approx(sides[0])


@pytest.mark.parametrize(
    ("low", "high", "is_free"),
    [
        ((-5.0, -7.0), (0.6, 9.0), (1.0, 0.0)),  # sticks out on three sides
        ((-0.1, 0.4), (1.2, 1.3), (0.0, -1.0)),
        ((0.0, -7.0), (1.0, 0.6), (0.0, 1.0)),
        ((0.4, -0.1), (70.0, 1.0), (-1.0, 0.0)),
        ((1.1, 0.0), (2.1, 1.0), None),  # in the next tile
        ((0.0, -1.0), (1.0, -0.5), None),
    ],
)
def test_what_stays_outside_of_the_map_takes_what_it_covers(low, high, is_free):
    """Of a map that is free otherwise, 0.4 is left, or all but the margins."""
    corners, islands = boxes([(1.0, 1.0)])
    largest = 1.0 - 2.0 * MARGIN if is_free is None else 0.4 - 3.0 * MARGIN
    packed = beside(corners * (largest - (3.0 / 512.0 if is_free else 0.0)), islands, between([low], [high]))
    assert packed.min() >= MARGIN * (1.0 - 1e-6) and packed.max() <= 1.0 - MARGIN * (1.0 - 1e-6)
    if is_free is not None:
        away = packed.mean(axis=(0, 1)) - 0.5
        assert away @ is_free > 0.2
        assert beside(corners * (largest + 1e-4), islands, between([low], [high])) is None


def test_many_small_islands_go_beside_what_stays():
    """Around a square in the middle, also where no row of them is as wide as the map."""
    random = np.random.default_rng(5)
    corners, islands = boxes(random.uniform(0.005, 0.02, (500, 2)), random.uniform(0.0, 3.0, 500))
    square = between([(0.1, 0.1)], [(0.9, 0.9)])
    packed = beside(corners, islands, square)
    low, high = packed.reshape(500, 6, 2).min(axis=1), packed.reshape(500, 6, 2).max(axis=1)
    assert (np.maximum(low - 0.9, 0.1 - high).max(axis=1) > 2.0 * MARGIN).all()
    apart = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=2)
    assert apart[~np.eye(500, dtype=bool)].min() >= 2.0 * MARGIN * (1.0 - 1e-6)
    options = uv_packing.PackOptions(MARGIN, islands, staying=square)
    tries = list(uv_packing.work(4.0 * corners.reshape(-1, 2), np.arange(3000).reshape(-1, 3), options))
    assert len(tries) < uv_packing.ORDERS  # as there are many
    assert beside(4.0 * corners, islands, square) is None
    assert beside(0.0 * corners, islands, square) is None


def test_a_quick_search_packs_many_strips_nearly_as_large():
    corners, islands = boxes([(1.0, 0.01)] * 300, [0.1] * 300)
    quick, slow = (area(pack(corners, islands, MARGIN, is_quick=is_quick)) for is_quick in (True, False))
    assert quick > 0.95 * slow
