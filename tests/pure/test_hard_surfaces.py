# SPDX-License-Identifier: GPL-3.0-or-later
"""Planes, and coarse meshes that keep them: closed forms of plates with holes, and each step against a plain oracle."""

import numpy as np
import pytest

from addon.mesh import flips, flush, hard_edges, polygons
from addon.mesh.fitting import FitOptions, fit, surface_samples
from addon.mesh.flush import Flush
from addon.mesh.plane_collapse import Costs, collapse_on_planes, without_needless
from addon.mesh.planes import planes
from addon.mesh.topology import EdgeTable, components
from addon.mesh.triangles import enclosed_volumes, face_areas, face_normals, transformed, unit_normals
from addon.mesh.welding import WeldOptions, parted, weld, with_backs

SEGMENTS = 32


def quads(rows):
    """The triangles of quads (N, 4)."""
    rows = np.asarray(rows)
    return np.concatenate([rows[:, :3], rows[:, [0, 2, 3]]])


def band(lower, upper):
    """The points and quads between two closed loops (N, 3), facing outwards where they run to the left and `upper` is above."""
    here = np.arange(len(lower))
    ahead = np.roll(here, -1)
    return np.concatenate([lower, upper]), quads(np.stack([here, ahead, ahead + len(lower), here + len(lower)], axis=1))


def soup(*parts):
    """One welded mesh of several (points, triangles)."""
    points, triangles, count = [], [], 0
    for some, faces in parts:
        points.append(some)
        triangles.append(faces + count)
        count += len(some)
    return weld(np.concatenate(points).astype(np.float32), np.concatenate(triangles))


def ring(radius, z, segments=SEGMENTS):
    angles = 2.0 * np.pi * (np.arange(segments) + 0.5) / segments
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(segments, z)], axis=1)


def square(side, z, segments=SEGMENTS):
    """A square whose outline has as many points as a ring, among them its corners."""
    steps = np.arange(segments // 4) / (segments // 4)
    edge = np.stack([np.ones_like(steps), 2.0 * steps - 1.0], axis=1)
    turns = [edge @ np.linalg.matrix_power(np.array([[0.0, 1.0], [-1.0, 0.0]]), turn) for turn in range(4)]
    return np.column_stack([0.5 * side * np.concatenate(turns), np.full(segments, z)])


def fan(loop):
    """A flat part of a mesh, from the middle of a loop."""
    here = np.arange(len(loop))
    return np.concatenate([loop, loop.mean(axis=0, keepdims=True)]), np.stack(
        [here, np.roll(here, -1), np.full(len(loop), len(loop))], axis=1
    )


def turned(part):
    points, triangles = part
    return points, triangles[:, ::-1]


def plate_with_hole(radius=0.1, height=0.2):
    """A square plate of side 2, with a round hole through its middle."""
    low, high = square(2.0, 0.0), square(2.0, height)
    inner_low, inner_high = ring(radius, 0.0), ring(radius, height)
    return soup(
        band(low, high), turned(band(inner_low, inner_high)), band(high, inner_high), turned(band(low, inner_low))
    )


def plate_with_round(radius=0.1, depth=0.05, height=0.2):
    """A square plate of side 2, with a round pocket, or a boss for a depth below 0."""
    low, high = square(2.0, 0.0), square(2.0, height)
    rim, floor = ring(radius, height), ring(radius, height - depth)
    return soup(band(low, high), band(high, rim), band(rim, floor), fan(floor), turned(fan(low)))


def volume(points, triangles):
    return enclosed_volumes(points.astype(np.float64), triangles).sum() / 6.0


def is_closed(triangles):
    table = EdgeTable.of(triangles)
    return bool((table.counts == 2).all()) and not table.is_against.any()


def coarse(mesh, wanted):
    return collapse_on_planes(*mesh, planes(*mesh), wanted)


def test_planes_of_a_plate_with_a_hole():
    points, triangles = plate_with_hole()
    found = planes(points, triangles)
    assert len(found.areas) == 6 + SEGMENTS
    sides = np.sort(found.areas)[-6:]
    hole = 0.5 * SEGMENTS * 0.1**2 * np.sin(2.0 * np.pi / SEGMENTS)
    assert sides == pytest.approx([0.4] * 4 + [4.0 - hole] * 2, rel=1e-5)
    away = (points[triangles] * found.normals[found.of][:, None]).sum(axis=2) - found.offsets[found.of][:, None]
    assert np.abs(away).max() < 1e-6
    own, _ = unit_normals(points, triangles, np.float64)
    assert (own * found.normals[found.of]).sum(axis=1).min() > 0.9999
    assert found.large_share == pytest.approx((1.6 + 2 * (4.0 - hole)) / found.areas.sum(), rel=1e-5)


def test_a_fine_cylinder_is_no_plane():
    low, high = ring(1.0, 0.0, 1000), ring(1.0, 1.0, 1000)
    found = planes(*soup(band(low, high)))
    assert len(found.areas) >= 1000 and found.large_share == 0.0


def test_a_plane_that_ends_in_a_fine_round_stays_one():
    angles = np.radians(np.arange(0.0, 90.1, 0.5))
    profile = np.concatenate([[(-1.0, 0.0)], np.stack([0.3 * np.sin(angles), 0.3 * np.cos(angles) - 0.3], axis=1)])
    low, high = (np.column_stack([profile, np.full(len(profile), z)]) for z in (0.0, 1.0))
    points, triangles = band(low, high)
    triangles = triangles[(triangles % len(low)).max(axis=1) - (triangles % len(low)).min(axis=1) == 1]
    found = planes(*weld(points.astype(np.float32), triangles))
    assert found.areas.max() == pytest.approx(1.0, abs=0.02)
    assert len(found.areas) > 100


def test_thin_triangles_lie_in_the_plane_of_a_neighbor():
    """Of a square, one side has points that are off by what single precision rounds."""
    x = np.linspace(0.0, 1.0, 50)
    side = np.column_stack([x, 1e-7 * np.cos(40.0 * x), 1e-7 * np.sin(50.0 * x)])
    points = np.concatenate([side, [(0.0, 1.0, 0.0), (1.0, 1.0, 0.0)]])
    here = np.arange(1, 49)
    strips = np.stack([np.zeros(48, int), here, here + 1], axis=1)
    found = planes(points, np.concatenate([strips, [(0, 49, 51), (0, 51, 50)]]))
    assert len(found.areas) == 1
    assert found.normals[0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-5)


@pytest.mark.parametrize("mesh", [plate_with_hole(), plate_with_round(), plate_with_round(depth=-0.05)])
def test_a_hole_a_pocket_and_a_boss_are_closed_in_their_planes(mesh):
    made = coarse(mesh, 12)
    assert len(made.triangles) == 12 and is_closed(made.triangles)
    assert volume(made.points, made.triangles) == pytest.approx(0.8, rel=1e-6)
    box = np.abs(made.points - (0.0, 0.0, 0.1)) - (1.0, 1.0, 0.1)
    assert np.abs(box).max() < 1e-6  # each vertex is a corner of the box
    own, _ = unit_normals(made.points, made.triangles)
    found = planes(*mesh)
    assert (own * found.normals[found.of[made.of]]).sum(axis=1).min() > 0.999999


def test_a_hole_stays_while_there_are_triangles_for_it():
    made = coarse(plate_with_hole(0.5), 60)
    assert len(made.triangles) <= 60 and is_closed(made.triangles)
    table = EdgeTable.of(made.triangles)
    vertices = len(np.unique(made.triangles))
    assert vertices - len(table.keys) + len(made.triangles) == 0  # one tunnel
    faces, _ = unit_normals(made.points, made.triangles)
    flat = np.abs(faces[:, 2]) > 0.5
    heights = made.points[made.triangles[flat]][..., 2]
    assert np.minimum(np.abs(heights), np.abs(heights - 0.2)).max() < 1e-7
    area = 4.0 - 0.5 * SEGMENTS * 0.5**2 * np.sin(2.0 * np.pi / SEGMENTS)
    assert face_areas(made.points, made.triangles[flat]).sum() == pytest.approx(2.0 * area, rel=0.05)


@pytest.mark.parametrize("wanted", [8, 26])
def test_no_triangle_shows_its_back(wanted):
    """Of a plate whose hole nearly reaches its sides, triangles turned over step by step."""
    mesh = plate_with_hole(0.97)
    made, found = coarse(mesh, wanted), planes(*mesh)
    facing = (face_normals(made.points, made.triangles) * found.normals[found.of[made.of]]).sum(axis=1)
    assert facing.min() > -1e-9


def test_the_smaller_of_two_holes_is_closed():
    small = plate_with_hole(0.05)
    large = plate_with_hole(0.6)
    made = coarse(soup(small, (large[0] + (3.0, 0.0, 0.0), large[1])), 70)
    hole = made.points[np.unique(made.triangles)]
    near = np.linalg.norm(hole[:, :2], axis=1) < 0.5
    far = np.linalg.norm(hole[:, :2] - (3.0, 0.0), axis=1) < 0.7
    assert not near.any() and far.sum() >= 12 and is_closed(made.triangles)


def test_an_open_sheet_keeps_its_outline():
    points, triangles = soup(band(square(2.0, 0.0), ring(0.5, 0.0)), fan(ring(0.5, 0.0)))
    made = coarse((points, triangles), 2)
    assert len(made.triangles) == 2
    assert face_areas(made.points, made.triangles).sum() == pytest.approx(4.0, rel=1e-6)


def test_a_mesh_of_fewer_triangles_stays_as_it_is():
    points, triangles = plate_with_hole()
    made = coarse((points, triangles), 10_000)
    assert np.array_equal(made.triangles, triangles) and made.points == pytest.approx(points, abs=1e-6)


def star(rng, count):
    """A simple polygon, mostly not convex."""
    angles = (np.arange(count) + (0.8 * rng.random(count) if count > 4 else 0.0)) / count * 2.0 * np.pi
    return (0.2 + rng.random(count))[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def area_of(polygon):
    x, y = polygon.T
    return 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()


def test_polygons_are_covered_once_by_their_triangles():
    rng = np.random.default_rng(5)
    outlines = [star(rng, count) for count in (3, 4, 5, 8, 13, 40, 90)]
    first, last, of, points, count = [], [], [], [], 0
    for number, outline in enumerate(outlines):
        here = count + np.arange(len(outline))
        first.append(here)
        last.append(np.roll(here, -1))
        of.append(np.full(len(outline), number))
        points.append(np.column_stack([outline, np.zeros(len(outline))]))
        count += len(outline)
    turn = np.linspace(0.0, 4.0 * np.pi, 60)
    spiral = np.stack([np.cos(turn), np.sin(turn)], axis=1) * (1.0 + 0.3 * turn)[:, None]
    outlines.append(np.concatenate([1.1 * spiral, spiral[::-1]]))
    here = count + np.arange(len(outlines[-1]))
    first.append(here)
    last.append(np.roll(here, -1))
    of.append(np.full(len(here), len(outlines) - 1))
    points.append(np.column_stack([outlines[-1], np.zeros(len(here))]))
    points, first, last, of = (np.concatenate(each) for each in (points, first, last, of))
    mixed = rng.permutation(len(first))
    normals = np.tile((0.0, 0.0, 1.0), (len(outlines), 1))
    triangles, owner = polygons.triangulated(points, first[mixed], last[mixed], of[mixed], normals)
    a, b, c = (points[triangles[:, corner], :2] for corner in range(3))
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert areas.min() >= -1e-12
    for number, outline in enumerate(outlines):
        assert (owner == number).sum() == len(outline) - 2
        assert areas[owner == number].sum() == pytest.approx(area_of(outline), rel=1e-9)
        assert (of[triangles[owner == number]] == number).all()


def grid(count):
    x, y = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).reshape(-1)
    cells = np.stack([corner, corner + 1, corner + count + 2, corner + count + 1], axis=1)
    return np.stack([x, y], axis=-1).reshape(-1, 2).astype(float), cells


def in_circle(points, triangles, others):
    """How far `others` (N,) lie within the circles around triangles (N, 3), above 0 inside: the determinant of the textbook."""
    rows = points[triangles] - points[others][:, None]
    return np.linalg.det(np.concatenate([rows, (rows**2).sum(axis=2, keepdims=True)], axis=2))


def test_edges_are_turned_until_no_corner_is_in_a_circle():
    rng = np.random.default_rng(8)
    flat, cells = grid(9)
    flat = flat + rng.uniform(-0.33, 0.33, flat.shape)
    points = np.column_stack([flat, np.zeros(len(flat))])
    triangles = flips.delaunay(points, quads(cells), np.zeros(2 * len(cells), int))
    assert face_areas(points, triangles).sum() == pytest.approx(face_areas(points, quads(cells)).sum(), rel=1e-12)
    assert (unit_normals(points, triangles)[0][:, 2] > 0.99).all()
    one, other = EdgeTable.of(triangles).pairs
    opposite = triangles[other // 3, (other % 3 + 2) % 3]
    assert in_circle(flat, triangles[one // 3], opposite).max() < 1e-6
    assert in_circle(flat, quads(cells)[one // 3], opposite).max() > 1e-3


def test_a_plane_cut_in_two_by_thin_triangles_is_one():
    """Two squares with a strip between them that is thinner than what files keep."""
    y, gap = np.linspace(0.0, 1.0, 9), 2e-6
    rows = [np.column_stack([np.full(9, x), y, np.zeros(9)]) for x in (-1.0, 0.0, gap, 1.0)]
    lift = 1e-7 * np.random.default_rng(2).standard_normal(9)
    rows[1][:, 2] = lift
    here = np.arange(8)
    cells = [
        np.stack([here + 9 * row, here + 9 * row + 9, here + 9 * row + 10, here + 9 * row + 1], axis=1)
        for row in range(3)
    ]
    found = planes(np.concatenate(rows), quads(np.concatenate(cells)))
    assert len(found.areas) == 1


def test_strips_of_a_cylinder_are_round_and_sides_of_a_box_are_not():
    points, triangles = plate_with_hole()
    found = planes(points, triangles)
    assert np.array_equal(found.is_round, found.areas < 0.1)


def test_vertices_move_within_planes_alone():
    points, triangles = plate_with_hole(0.5)
    found = planes(points, triangles)
    free = found.free_directions(triangles, found.of, len(points), 5e-4)
    kinds = np.round(np.trace(free, axis1=1, axis2=2)).astype(int)
    outer = np.abs(points[:, :2]).max(axis=1) > 0.99
    is_corner = np.abs(points[:, :2]).min(axis=1) > 0.99
    assert (kinds[is_corner] == 0).all() and (kinds[outer & ~is_corner] == 1).all() and (kinds[~outer] == 2).all()
    assert np.abs(free[~outer] @ (0.0, 0.0, 1.0)).max() < 1e-6
    wide = surface_samples(*plate_with_hole(0.52), 20_000)
    moved, _ = fit(points, triangles, wide, FitOptions(free=free))
    assert (
        np.abs(moved[outer, 2] - points[outer, 2]).max() < 1e-6
        and np.abs(moved[~outer, 2] - points[~outer, 2]).max() < 1e-6
    )
    assert moved[is_corner] == pytest.approx(points[is_corner], abs=1e-6)
    assert np.linalg.norm(moved[~outer, :2], axis=1) == pytest.approx(0.515, abs=0.006)


def test_solids_that_touch_are_apart():
    """Two boxes that share an edge, and two that share a vertex."""
    box = soup(
        *(band(square(2.0, 0.0, 4), square(2.0, 1.0, 4)), fan(square(2.0, 1.0, 4)), turned(fan(square(2.0, 0.0, 4))))
    )
    for shift in ((2.0, 2.0, 0.0), (2.0, 2.0, 1.0)):
        points, triangles = soup(box, (box[0] + shift, box[1]))
        assert len(points) < 2 * len(box[0])
        apart, same = parted(points, triangles)
        assert len(apart) == 2 * len(box[0]) and is_closed(same)
        assert np.array_equal(apart[same], points[triangles])


TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
"""To no axis, so that what is in one plane is so but for rounding."""


def boxes_of(*corners_and_sizes):
    """Boxes, from their corners and sizes (6,): points (8 N, 3) and triangles (12 N, 3), of which none are joined."""
    corners = np.stack(np.meshgrid((0, 1), (0, 1), (0, 1), indexing="ij"), axis=-1).reshape(-1, 3)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    points = [corners * each[3:] + each[:3] for each in np.array(corners_and_sizes, float)]
    return np.concatenate(points), np.concatenate([quads(sides) + 8 * number for number in range(len(points))])


def solids_in(points, triangles):
    """The volumes of the solids, in order, all of which are closed."""
    points, triangles = parted(points, triangles)
    assert is_closed(triangles)
    labels, count = components(tuple(triangles.T), len(points))
    return sorted(np.bincount(labels, enclosed_volumes(points.astype(float), triangles), count) / 6.0)


@pytest.mark.parametrize("shift", [(0, 0, 1), (1, 0, 0)])
def test_solids_keep_triangles_in_the_same_place(shift):
    """Two cubes: of the sides between them, joining vertices leaves one."""
    source = boxes_of((0, 0, 0, 1, 1, 1), (*shift, 1, 1, 1))
    points, triangles = weld(*source)
    assert len(triangles) == 22
    with_both = with_backs((points.astype(np.float32), triangles), (source[0].astype(np.float32), source[1]))
    assert np.array_equal(with_both[:22], triangles)
    assert solids_in(points, with_both) == [1.0, 1.0]
    assert solids_in(*weld(*source, WeldOptions(keeps_backs=True))) == [1.0, 1.0]
    twice = source[0].astype(np.float32), np.concatenate([source[1], source[1]])
    assert len(with_backs((points.astype(np.float32), triangles), twice)) == 24
    assert np.array_equal(
        with_backs((points.astype(np.float32), with_both[22:]), (source[0][:8], source[1][:12])), with_both[22:]
    )


CRATE = (
    [(0, 0, z, 9, 8, 1) for z in (0, 6)] + [(x, 0, 1, 1, 8, 5) for x in (0, 8)] + [(1, y, 1, 7, 1, 5) for y in (0, 7)]
)
"""Six boards around an empty space, with four heights along each axis."""


def turned_boards(rng, boards=CRATE):
    """Boards, as corners and sizes, that are objects of their own below a parent that is turned, scaled and moved, with
    matrices of single precision: points (V, 3) float64, and the parent's matrix (4, 4)."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.linalg.det(turn) * rng.uniform(0.2, 5.0, 3)
    matrix[:3, 3] = rng.normal(size=3) * rng.choice([0.0, 10.0, 1000.0])
    points = []
    for board in np.array(boards, float):
        own = np.diag([*board[3:], 1.0])
        own[:3, 3] = board[:3] + 0.5 * board[3:]
        unit_cube = boxes_of((-0.5, -0.5, -0.5, 1, 1, 1))[0]
        points.append(transformed(unit_cube, (matrix @ own).astype(np.float32).astype(float)))
    return np.concatenate(points), matrix


@pytest.mark.parametrize("seed", range(20))
def test_boards_of_their_own_touch_as_those_of_one_object(seed):
    points, matrix = turned_boards(np.random.default_rng(seed))
    within, triangles = flush.rounding(points), boxes_of(*CRATE)[1]
    points = points.astype(np.float32)
    plain, crowded = (EdgeTable.of(weld(*each)[1]).is_crowded.sum() for each in ((points, triangles), boxes_of(*CRATE)))
    made = Flush.of(points, triangles, within)
    assert [len(np.unique(axis)) for axis in made.points[made.triangles].reshape(-1, 3).T] == [4, 4, 4]
    welded = weld(made.points.astype(np.float32), made.triangles, WeldOptions(keeps_backs=True))
    assert EdgeTable.of(welded[1]).is_crowded.sum() == crowded > plain
    volumes = np.sort(np.prod(np.array(CRATE, float)[:, 3:], axis=1)) * np.linalg.det(matrix[:3, :3])
    assert solids_in(made.placed(welded[0]), welded[1]) == pytest.approx(volumes, rel=1e-3)
    moved = np.linalg.norm(made.placed(made.points)[made.triangles] - points[triangles], axis=2)
    assert moved.max() <= 3.0 * within and len(made.triangles) == len(triangles)


def test_a_row_of_many_bricks_is_one_plane():
    """Each of them turns its planes by rounding: far from it, these lie elsewhere."""
    row = [(2 * number, 0, 0, 2, 1, 0.7) for number in range(60)]
    for seed in range(5):
        points, _ = turned_boards(np.random.default_rng(seed), row)
        made = Flush.of(points.astype(np.float32), boxes_of(*row)[1], flush.rounding(points))
        assert sorted(len(np.unique(axis)) for axis in made.points[made.triangles].reshape(-1, 3).T) == [2, 2, 61]


def test_slanted_sides_touch():
    """Of two prisms, each of which is rounded for itself: what is between them lies across no axis."""
    rng, triangle = np.random.default_rng(4), np.array([(0, 0), (5, 0), (2, 3)], float)
    prisms = []
    for corners in (triangle, np.array([(7, 3), (2, 3), (5, 0)], float)):
        low, high = (np.column_stack([corners, np.full(3, z)]) for z in (0.0, 9.0))
        prisms.append(soup(band(low, high), (high, np.array([(0, 1, 2)])), (low, np.array([(0, 2, 1)]))))
    points = np.concatenate([some @ TURN + rng.uniform(-1e-6, 1e-6, some.shape) for some, _ in prisms])
    triangles = np.concatenate([prisms[0][1], prisms[1][1] + len(prisms[0][0])])
    made = Flush.of(points.astype(np.float32), triangles, flush.rounding(points))
    welded = weld(made.points.astype(np.float32), made.triangles, WeldOptions(keeps_backs=True))
    assert len(welded[0]) == 8 and len(solids_in(*welded)) == 2


@pytest.mark.parametrize("sizes", [(1, 2, 3), (3, 2, 1), (2, 3, 1)])
def test_along_axes_the_outside_stays_outside(sizes):
    rng, (points, triangles) = np.random.default_rng(6), boxes_of((0, 0, 0, *sizes))
    for _ in range(30):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        made = Flush.of(points @ turn, triangles, flush.rounding(points))
        assert volume(made.points, made.triangles) == pytest.approx(6.0)


def test_what_is_exact_stays_to_the_bit():
    """Beside a box that is larger, and off by rounding."""
    points, triangles = boxes_of((0.1, 0.2, 0.3, 1, 2, 3), (5, 5, 5, 9, 9, 9))
    points[8:] += np.random.default_rng(7).uniform(-1e-7, 1e-7, (8, 3))
    made = Flush.of(points, triangles, flush.rounding(points))
    assert np.array_equal(made.axes, np.eye(3)) and np.array_equal(made.triangles, triangles)
    assert np.array_equal(made.points[:8], points[:8]) and np.array_equal(made.placed(points), points)


def test_details_as_small_as_rounding_stay():
    """Stairs, each step hardly lower than what is taken for rounding, and a box that is smaller than that."""
    count, within = 50, 1e-3
    x, z = np.repeat(np.arange(count + 1.0), 2)[1:-1], 0.9 * within * np.repeat(np.arange(count), 2)
    points = np.concatenate([np.column_stack([x, np.full(len(x), y), z]) for y in (0.0, 1.0)])
    here = np.arange(len(x) - 1)
    strips = quads(np.stack([here, here + 1, here + 1 + len(x), here + len(x)], axis=1))
    made = Flush.of(points, strips, within)
    assert np.array_equal(made.triangles, strips) and np.array_equal(made.points, points)
    cube = 0.5 * within
    points, triangles = boxes_of((0, 0, 0, 1, 1, 1), (2, 2, 2, cube, cube, cube))
    assert np.array_equal(Flush.of(points, triangles, within).triangles, triangles)


def test_what_is_in_no_plane_stays():
    """A box that is tilted by little, beside one along the axes, and a spike that is nearly as high as that."""
    within = 1e-5
    points, triangles = boxes_of((0, 0, 0, 2, 2, 1), (3, 0, 0, 1, 1, 1))
    points[8:, 2] += 1e-4 * points[8:, 0]
    spike = np.array([(6, 0, -1), (7, 0, -1), (6, 1, -1), (6, 0, 1.0 - 0.5 * within)])
    points = np.concatenate([points, spike])
    triangles = np.concatenate([triangles, np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]) + 16])
    made = Flush.of(points, triangles, within)
    assert np.array_equal(made.axes, np.eye(3)) and np.array_equal(made.points, points)


def with_a_line(points, triangles):
    """With two triangles for one at the edge from 0 to 1 along z, and a third that is a line between them and the edge."""
    ends = [int(np.flatnonzero((points == (0.0, 0.0, z)).all(axis=1))[0]) for z in (0.0, 1.0)]
    row, k = np.argwhere((triangles == ends[0]) & (np.roll(triangles, -1, axis=1) == ends[1]))[0]
    low, high, third = np.roll(triangles[row], -k)
    middle = len(points)
    parts = [(low, middle, third), (middle, high, third), (low, high, middle)]
    return np.concatenate([points, [(0.0, 0.0, 0.5)]]), np.concatenate([np.delete(triangles, row, axis=0), parts])


@pytest.mark.parametrize("lined", [None, 0, 1, 2, 3])
def test_solids_around_an_edge_are_apart(lined):
    """Four wedges: at the axis in their middle all of them meet, at other edges two. lined: which has a line at the axis."""
    corners, wedges = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)], float), []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        low, high = (np.array([(0, 0, z), (*start, z), (*end, z)]) for z in (0.0, 1.0))
        wedges.append(soup(band(low, high), (high, np.array([(0, 1, 2)])), (low, np.array([(0, 2, 1)]))))
    if lined is not None:
        wedges[lined] = with_a_line(*wedges[lined])
    points, triangles = soup(*((points @ TURN, triangles) for points, triangles in wedges))
    apart, same = parted(points, triangles)
    assert is_closed(same) and len(apart) == sum(len(wedge) for wedge, _ in wedges)
    assert np.array_equal(apart[same], points[triangles])


@pytest.mark.parametrize("edge", [(0, 1), (1, 0)])
def test_sheets_around_an_edge_are_no_solids(edge):
    """Three that point the same way around."""
    points = np.array([(0, 0, 0), (0, 0, 1), (1, 0, 0), (-1, 1, 0), (-1, -1, 0)], float)
    apart, _ = parted(points, np.array([(*edge, 2), (*edge, 3), (*edge, 4)]))
    assert len(apart) == 9


def test_needless_triangles_go_and_nothing_else_changes():
    mesh = plate_with_hole(0.5)
    made = without_needless(*mesh, planes(*mesh))
    assert len(made.triangles) == 4 * (4 + SEGMENTS) and is_closed(made.triangles)
    assert volume(made.points, made.triangles) == pytest.approx(volume(*mesh), rel=1e-6)
    own, _ = unit_normals(made.points, made.triangles)
    found = planes(*mesh)
    assert (own * found.normals[found.of[made.of]]).sum(axis=1).min() > 0.999999


def test_a_notch_in_an_edge_is_filled():
    """It lies in three planes, so that its walls collapse onto their edge."""
    outline = np.array([(-1, 0), (1, 0), (1, 1), (0.05, 1), (0.05, 0.9), (-0.05, 0.9), (-0.05, 1), (-1, 1)], float)
    low, high = (np.column_stack([outline, np.full(8, z)]) for z in (0.0, 2.0))
    lid = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 5), (0, 5, 7), (5, 6, 7)])
    mesh = soup(band(low, high), (high, lid), (low, lid[:, ::-1]))
    assert is_closed(mesh[1]) and volume(*mesh) == pytest.approx(4.0 - 0.02, rel=1e-5)
    made = coarse(mesh, 12)
    assert len(made.triangles) == 12 and is_closed(made.triangles)
    assert volume(made.points, made.triangles) == pytest.approx(4.0, rel=1e-5)


def test_a_pocket_in_a_round_side_is_closed():
    """Three strips of a cylinder wide, so that its rim lies in several planes."""
    levels = np.stack([ring(1.0, z) for z in (0.0, 0.4, 0.6, 1.0)])
    wall = band(levels[1], levels[2])[1]
    wall = wall[~(np.sort(wall % SEGMENTS, axis=1)[:, [0, 2]] <= 3).all(axis=1)]
    rim = np.concatenate([levels[1, :4], levels[2, 3::-1]])
    floor = rim * (0.9, 0.9, 1.0)
    flat = quads([(0, 1, 6, 7), (1, 2, 5, 6), (2, 3, 4, 5)])
    outside = (band(levels[0], levels[1]), (levels[1:3].reshape(-1, 3), wall), band(levels[2], levels[3]))
    lids = fan(levels[3]), turned(fan(levels[0]))
    mesh = soup(*outside, *lids, band(rim, floor), (floor, flat))
    assert is_closed(mesh[1]) and volume(*mesh) < 0.999 * volume(*soup(band(levels[0], levels[3]), *lids))
    made = coarse(mesh, 4 * SEGMENTS - 4)
    assert len(made.triangles) == 4 * SEGMENTS - 4 and is_closed(made.triangles)
    round_side = 0.5 * SEGMENTS * np.sin(2.0 * np.pi / SEGMENTS)
    assert volume(made.points, made.triangles) == pytest.approx(round_side, rel=1e-3)
    assert np.linalg.norm(made.points[:, :2], axis=1) == pytest.approx(1.0, abs=1e-6)
    own, _ = unit_normals(made.points, made.triangles)
    found = planes(*mesh)
    turn = 2.0 * np.pi / SEGMENTS
    assert (own * found.normals[found.of[made.of]]).sum(axis=1).min() > np.cos(turn)


def test_no_more_is_closed_than_the_number_of_triangles_asks():
    plates = [plate_with_hole(0.3) for _ in range(6)]
    mesh = soup(*((points + (3.0 * number, 0.0, 0.0), faces) for number, (points, faces) in enumerate(plates)))
    made = coarse(mesh, 130)
    assert 126 <= len(made.triangles) <= 130


def test_what_is_dear_to_close_stays():
    open_still = collapse_on_planes(*plate_with_hole(0.3), planes(*plate_with_hole(0.3)), 30, Costs(closing=1e4))
    closed = collapse_on_planes(*plate_with_hole(0.3), planes(*plate_with_hole(0.3)), 30, Costs(closing=1e-4))
    assert len(open_still.triangles) > 12 and len(closed.triangles) <= 30
    assert volume(closed.points, closed.triangles) == pytest.approx(0.8, rel=1e-6)
    assert volume(open_still.points, open_still.triangles) < 0.79


def test_edges_between_planes_stay():
    rng = np.random.default_rng(8)
    flat, cells = grid(9)
    points = np.column_stack([flat + rng.uniform(-0.33, 0.33, flat.shape), np.zeros(len(flat))])
    triangles = quads(cells)
    assert np.array_equal(flips.delaunay(points, triangles, np.arange(len(triangles))), triangles)


def test_an_edge_of_fifty_degrees_between_planes_is_hard():
    slope = np.array([np.cos(np.radians(50.0)), 0.0, -np.sin(np.radians(50.0))])
    points = np.array([(-1, 0, 0), (0, 0, 0), (0, 1, 0), (-1, 1, 0), slope, slope + (0, 1, 0)], float)
    triangles = quads([(0, 1, 2, 3), (1, 4, 5, 2)])
    found = planes(points, triangles)
    shown = hard_edges.shading(
        points, triangles, hard_edges.smooth_groups(triangles, found.normals[found.of]), found.of
    )
    assert np.sort(shown.hard).tolist() == [[1, 2]]


def test_a_cylinder_has_hard_rims_and_round_sides():
    low, high = ring(1.0, 0.0), ring(1.0, 1.0)
    points, triangles = soup(band(low, high), fan(high), turned(fan(low)))
    found = planes(points, triangles)
    groups = hard_edges.smooth_groups(triangles, found.normals[found.of])
    assert len(np.unique(groups)) == 3
    shown = hard_edges.shading(points, triangles, groups, found.of)
    assert len(shown.hard) == 2 * SEGMENTS
    assert np.abs(np.diff(points[shown.hard][..., 2], axis=1)).max() == 0.0
    corners = points[triangles].astype(float)
    own, _ = unit_normals(points, triangles, np.float64)
    is_side = np.abs(own[:, 2]) < 0.5
    around = corners * (1.0, 1.0, 0.0)
    assert shown.normals[is_side] == pytest.approx(around[is_side], abs=1e-5)
    assert shown.normals[~is_side] == pytest.approx(np.repeat(own[~is_side][:, None], 3, axis=1), abs=1e-6)


def strip(angle):
    """A large square, a narrow band that turns by half an angle, and a small square that turns by all of it."""
    half = 0.5 * angle
    profile = np.cumsum(
        [
            (0.0, 0.0),
            (1.0, 0.0),
            0.1 * np.array([np.cos(half), -np.sin(half)]),
            0.5 * np.array([np.cos(angle), -np.sin(angle)]),
        ],
        axis=0,
    )
    points = np.concatenate([np.column_stack([profile[:, 0], np.full(4, y), profile[:, 1]]) for y in (0.0, 1.0)])
    return points, quads([(row, row + 1, row + 5, row + 4) for row in range(3)])


def test_normals_between_soft_edges_follow_the_larger_plane():
    points, triangles = strip(np.radians(60.0))
    found = planes(points, triangles)
    shown = hard_edges.shading(
        points, triangles, hard_edges.smooth_groups(triangles, found.normals[found.of]), found.of
    )
    assert not len(shown.hard)
    angles = np.degrees(np.arccos(np.clip(shown.normals[triangles == 1][:, 2], -1.0, 1.0)))
    assert angles.max() < 1e-3 + np.degrees(
        np.arctan2(0.1 * np.sin(np.radians(30.0)), 1.0 + 0.1 * np.cos(np.radians(30.0)))
    )
    assert np.ptp(shown.normals[triangles == 1], axis=0).max() < 1e-12


def test_an_edge_whose_round_is_gone_is_hard():
    points, triangles = strip(np.radians(130.0))
    groups, own = np.zeros(len(triangles), int), np.arange(len(triangles)) % 3
    shown = hard_edges.shading(points, triangles, groups, own)
    assert {tuple(sorted(edge)) for edge in shown.hard.tolist()} == {(1, 5), (2, 6)}
