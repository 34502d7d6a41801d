# SPDX-License-Identifier: GPL-3.0-or-later
"""Crumbs and holes of surfaces, by counting."""

import numpy as np
import pytest

from addon.mesh import small_parts
from addon.mesh.small_parts import Small
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import enclosed_volumes, face_areas
from addon.mesh.welding import weld

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float), np.array([(0, 1, 2), (0, 2, 3)])


def grid(n, without=()):
    """The square 0..1 in n x n cells of two triangles, without some cells (column, row)."""
    x, y = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    points = np.stack([x.ravel() / n, y.ravel() / n, 0.0 * x.ravel()], axis=1)
    cells = [(i, j) for j in range(n) for i in range(n) if (i, j) not in without]
    first = np.array([i + j * (n + 1) for i, j in cells])
    halves = np.stack([first, first + 1, first + n + 2]), np.stack([first, first + n + 2, first + n + 1])
    return points, np.concatenate([half.T for half in halves])


def joined(*parts):
    points, triangles, count = [], [], 0
    for some, faces in parts:
        points.append(some)
        triangles.append(faces + count)
        count += len(some)
    return np.concatenate(points), np.concatenate(triangles)


def small(scale, place=(5.0, 0.0, 0.0), shape=SQUARE):
    return shape[0] * scale + place, shape[1]


def test_parts_below_a_share_of_the_largest_are_crumbs():
    surface = joined(small(0.099), grid(4), small(0.101), small((0.09, 0.2, 1.0)), small(0.05))
    chosen, count = small_parts.is_crumb(*surface, 0.1)
    assert count.mended == 2 and np.flatnonzero(chosen).tolist() == [0, 1, 38, 39]
    assert small_parts.is_crumb(*joined(grid(4), small(0.25)), 0.25)[1].mended == 0  # of that size itself


def test_a_far_crumb_does_not_make_the_rest_small():
    surface = joined(grid(4), small(0.05, (1000.0, 0.0, 0.0)), small(0.2))
    assert small_parts.is_crumb(*surface, 0.1)[1].mended == 1


@pytest.mark.parametrize(("count", "is_heap"), [(11, False), (12, True)])
def test_a_heap_of_crumbs_stays(count, is_heap):
    """Eleven of a hundredth of the area are 0.0991 of it, twelve 0.1071."""
    surface = joined(grid(3), *(small(0.1, (number, 2.0, 0.0)) for number in range(count)))
    chosen, found = small_parts.is_crumb(*surface, 0.11)
    assert (found.mended, chosen.sum()) == ((0, 0) if is_heap else (count, 2 * count))


@pytest.mark.parametrize(
    ("size", "gap", "share", "is_crumb"),
    [
        (0.05, 0.026, 0.01, True),
        (0.05, 0.024, 0.01, False),  # less than half its size away
        (0.0595, 0.1, 0.01, True),
        (0.0605, 0.1, 0.01, False),
        (0.0595, 0.1, 0.1, True),
        (0.0605, 0.1, 0.02, False),  # a larger share makes no larger parts float
        (0.0295, 0.1, 0.005, True),
        (0.0305, 0.1, 0.005, False),
        (0.01, 0.1, 0.0, False),
        (0.07, 0.1, 0.0701, True),
    ],
)
@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_parts_that_float_may_be_larger(size, gap, share, is_crumb, scale):
    points, triangles = joined(grid(2), small(size, (1.0 + gap, 0.0, 0.0)))
    chosen, found = small_parts.is_crumb(points * scale, triangles, share)
    assert found.mended == is_crumb and np.flatnonzero(chosen).tolist() == [8, 9] * is_crumb
    is_told = not is_crumb and share > 0.0 and size < 0.06 and size < 6.0 * share
    assert found.stay == is_told and found.largest == pytest.approx(size * is_told)


@pytest.mark.parametrize("size", [0.9, 1.0])
def test_other_large_parts_make_the_gap_no_larger(size):
    """Of which the largest one's own size tells, and not how far apart they are."""
    parts = grid(2), small(size, (20.0, 0.0, 0.0)), small(0.05, (1.026, 0.0, 0.0))
    assert small_parts.is_crumb(*joined(*parts), 0.01)[1].mended == 1


def test_a_part_at_one_that_does_not_float_does_not_either():
    """A chain of squares, each of 0.05 and 0.02 from the one before."""
    link = [small(0.05, (1.02 + 0.07 * number, 0.0, 0.0)) for number in range(4)]
    found = small_parts.is_crumb(*joined(grid(2), *link), 0.01)[1]
    assert (found.mended, found.stay) == (0, 4) and found.largest == pytest.approx(0.05)
    assert small_parts.is_crumb(*joined(grid(2), *link[1:]), 0.01)[1].mended == 3
    crumb = small(0.005, (1.005, 0.0, 0.0)), small(0.05, (1.03, 0.0, 0.0))
    assert small_parts.is_crumb(*joined(grid(2), *crumb), 0.01)[1].mended == 2  # what is left out holds nothing


def test_limits_themselves():
    """In numbers that are exact."""
    at_half = joined(grid(2), small(1.0 / 32.0, (1.0 + 1.0 / 64.0, 0.0, 0.0)))
    assert small_parts.is_crumb(*at_half, 0.01)[1].mended == 0
    tenth = joined(small(3.0, (0.0, 0.0, 0.0)), small(1.0))
    assert small_parts.is_crumb(*tenth, 0.34)[1].mended == 1
    holes = [(i, j) for i in (1, 3, 5, 7) for j in (1, 4, 7)]
    points, triangles = grid(11, set(holes[:11]))
    assert small_parts.filled(np.round(11.0 * points), triangles, 0.1)[2].mended == 11
    assert small_parts.filled(*grid(32, {(2, 2)}), 1.0 / 32.0)[2] == Small(0, 1, 1.0 / 32.0)


def test_a_heap_of_parts_that_float_stays_without_a_word():
    """30 of 0.0036 of the area each are 0.108 of it, 27 are 0.0972; one small one is no heap."""
    for count, is_heap in ((28, False), (32, True)):
        parts = [small(0.059, (number, 2.0, 0.0)) for number in range(count)]
        found = small_parts.is_crumb(*joined(grid(2), *parts, small(0.005, (0.0, 3.0, 0.0))), 0.01)[1]
        assert (found.mended, found.stay) == ((1, 0) if is_heap else (count + 1, 0)), count


@pytest.mark.parametrize(
    ("cells", "share", "found"),
    [
        ([(20, 20), (21, 20), (22, 20), (21, 21)], 0.02, (1, 0, 0.0)),  # a T turns around twice
        ([(20, 20), (21, 20), (22, 20)], 0.02, (0, 1, 0.06)),  # and a rectangle once
        ([(20, 20), (21, 20), (20, 21)], 0.02, (0, 1, 0.04)),  # and an L one and a half times
        ([(20, 20), (21, 20), (22, 20)], 0.061, (1, 0, 0.0)),
        ([(20, 20), (21, 20), (22, 20)], 0.009, (0, 0, 0.0)),
        ([(20 + i, 20) for i in range(5)] + [(21, 21)], 0.02, (1, 0, 0.0)),
        ([(20 + i, 20) for i in range(6)] + [(21, 21)], 0.03, (0, 0, 0.0)),  # of 0.12 itself
        ([(20, 20), (21, 20), (22, 20), (21, 21), (30, 30)], 0.0, (0, 0, 0.0)),
        ([(20, 20), (21, 20), (22, 20), (21, 21), (30, 30), (30, 31)], 0.03, (1, 1, 0.04)),
    ],
)
def test_ragged_holes_may_be_larger(cells, share, found):
    small_ones = small_parts.filled(*grid(50, set(cells)), share)[2]
    assert (small_ones.mended, small_ones.stay) == found[:2] and small_ones.largest == pytest.approx(found[2])


@pytest.mark.parametrize(("degrees", "found"), [(80.0, (1, 0)), (100.0, (0, 1))])
def test_a_border_is_ragged_from_one_and_a_half_turns_on(degrees, found):
    """An L in a grid of parallelograms with an angle a turns by 2 a + 4 (180 - a): 1.56 and 1.44 times around."""
    points, triangles = grid(50, {(20, 20), (21, 20), (20, 21)})
    points[:, 0] += points[:, 1] / np.tan(np.radians(degrees))
    holes = small_parts.filled(points, triangles, 0.02)[2]
    assert (holes.mended, holes.stay) == found


@pytest.mark.parametrize(("cells", "is_filled"), [(24, True), (25, False), (26, False)])
def test_a_hole_is_less_than_half_as_large_as_its_part(cells, is_filled):
    found = small_parts.filled(*grid(50, {(5 + number, 20) for number in range(cells)}), 0.6)[2]
    assert found == Small(int(is_filled))


def test_borders_at_which_edges_of_three_triangles_end_stay():
    """A fin at the edge between two cells, one of whose ends is a corner of a hole."""
    points, triangles = grid(10, {(2, 2), (7, 7)})
    fin = np.array([[3 * 11 + 3, 4 * 11 + 3, len(points)]])
    points, triangles = np.concatenate([points, [(0.3, 0.35, 0.01)]]), np.concatenate([fin, triangles])
    new, closed, holes = small_parts.filled(points, triangles, 0.11)
    assert holes == Small(1) and new[-1] == pytest.approx((0.75, 0.75, 0.0))
    assert face_areas(new, closed[-4:]).sum() == pytest.approx(0.01)
    beside = np.concatenate([[(3 * 11 + 3, 3 * 11 + 4, len(points) - 1)], triangles[1:]])
    assert small_parts.filled(points, beside, 0.25)[2] == Small(1)  # though all that is open there is as small as that


@pytest.mark.parametrize(
    ("more", "found"),
    [
        ([], (13, 0)),
        ([(0, -1), (2, -1)], (1, 0)),
        ([(0, 1), (2, 1), (0, 2), (1, 2), (2, 2)], (1, 0)),
    ],
)
def test_ragged_holes_of_more_than_a_tenth_of_a_part_stay_but_not_the_small_ones(more, found):
    """Twelve of 4, 6 or 9 of the 784 cells, and one of a cell: 0.067, 0.103 and 0.161 of the rest."""
    shape = [(0, 0), (1, 0), (2, 0), (1, 1), *more]
    cells = {(i + x, j + y) for i in (2, 8, 14, 20) for j in (2, 8, 14) for x, y in shape}
    holes = small_parts.filled(*grid(28, {*cells, (26, 26)}), 0.04)[2]
    assert (holes.mended, holes.stay) == found


def test_nothing_has_neither_crumbs_nor_holes():
    points, triangles = np.zeros((0, 3)), np.zeros((0, 3), int)
    assert small_parts.is_crumb(points, triangles, 0.1)[1] == Small(0, 0, 0.0)
    assert small_parts.filled(points, triangles, 0.1)[2] == Small(0, 0, 0.0)


def test_the_largest_parts_have_room_for_their_least_triangles():
    """The grid takes four triangles, a square two."""
    surface, part = joined(small(0.2), grid(4), small(0.4), small(0.3)), np.repeat([0, 1, 2, 3], [2, 32, 2, 2])
    for most, kept in ((3, [1]), (4, [1]), (5, [1]), (6, [1, 2]), (8, [1, 2, 3]), (9, [1, 2, 3]), (10, [0, 1, 2, 3])):
        chosen, left_out = small_parts.largest(*surface, 40, most / 40)
        assert np.array_equal(chosen, np.isin(part, kept)) and left_out == 4 - len(kept), most
    for wanted, kept in ((4, [1]), (16, [1, 2, 3]), (12, [1, 2]), (20, [0, 1, 2, 3])):
        assert np.array_equal(small_parts.largest(*surface, wanted, 0.5)[0], np.isin(part, kept)), wanted
    equal = joined(*(small(1.0, (2.0 * number, 0.0, 0.0)) for number in range(5)))  # 0.9 of two triangles are 9 / 5
    assert [small_parts.largest(*equal, wanted, 0.5)[1] for wanted in (7, 8, 9)] == [2, 1, 0]
    assert [small_parts.largest(*equal, wanted, 0.49)[1] for wanted in (7, 8, 9)] == [4, 4, 3]
    twins = joined(small(1.0), small(1.0, (0.0, 9.0, 0.0)))
    assert [small_parts.largest(*twins, 4, share)[1] for share in (0.5, 0.49)] == [0, 1]


@pytest.mark.parametrize(
    ("share", "area", "borders", "found"),
    [(0.099, 0.95, 58, 0), (0.11, 0.96, 54, 1), (0.21, 1.0, 40, 3)],
)
def test_holes_are_closed_and_borders_are_not(share, area, borders, found):
    """Holes of one cell, of 2 x 1, and two of one cell that touch in a corner, which count as one of two by two."""
    points, triangles = grid(10, {(2, 2), (5, 3), (6, 3), (7, 7), (6, 6)})
    new, faces, holes = small_parts.filled(points, triangles, share)
    assert holes.mended == len(new) - len(points) == found
    assert face_areas(new, faces).sum() == pytest.approx(area)
    new, faces = weld(new, faces)  # where holes touch, the middle of both can be a vertex
    assert len(EdgeTable.of(faces).alone) == borders
    assert not EdgeTable.of(faces).is_against.any()
    normals = np.cross(new[faces[:, 1]] - new[faces[:, 0]], new[faces[:, 2]] - new[faces[:, 0]])
    assert (normals[:, 2] > 0.0).all()


@pytest.mark.parametrize(("every", "found"), [(4, 9), (3, 0)])
def test_a_sieve_keeps_its_holes(every, found):
    """A few holes of a part are closed, and none if they have more than a tenth of its area."""
    holes = {(i, j) for i in range(1, 12, every) for j in range(1, 12, every)}
    points, triangles = grid(12, holes)
    assert len(holes) == found or len(holes) == 16
    assert small_parts.filled(points, triangles, 0.2)[2].mended == found
    other = joined((points, triangles), small(9.0, (20.0, 0.0, 0.0)))  # whose area does not count
    assert small_parts.filled(*other, 0.2)[2].mended == found


def test_the_ends_of_a_tube_are_no_holes():
    """As small as they are beside its length."""
    turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) * 0.02
    points = np.concatenate([np.insert(ring, 2, height, axis=1) for height in (0.0, 1.0)])
    one, two = np.arange(12), np.roll(np.arange(12), -1)
    triangles = np.concatenate([np.stack([one, two, two + 12], axis=1), np.stack([one, two + 12, one + 12], axis=1)])
    assert small_parts.filled(points, triangles, 0.2)[2].mended == 0


def test_a_hole_of_a_ball_is_closed_from_outside():
    points = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
    corners = [(i, j, k) for i in (0, 1) for j in (2, 3) for k in (4, 5)]
    triangles = np.array([(a, b, c) if np.linalg.det(points[[a, b, c]]) > 0 else (a, c, b) for a, b, c in corners])
    assert small_parts.filled(points, triangles[1:], 0.9)[2].mended == 0  # half of the part
    other = joined((points, triangles[1:]), small(100.0, (50.0, 0.0, 0.0)))
    assert small_parts.filled(*other, 0.9)[2].mended == 0  # beside a large part as well
    fine = joined((points * 0.2 + (0.5, 0.5, 0.5), triangles), grid(2))
    assert small_parts.filled(*fine, 0.9)[2].mended == 0  # nothing is open but the grid


def test_a_sphere_with_a_hole_encloses_its_volume_again():
    n = 12
    i, j = np.meshgrid(np.arange(2 * n), np.arange(1, n), indexing="xy")
    a, b = np.pi * i / n, np.pi * j / n
    belt = np.stack([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)], axis=-1).reshape(-1, 3)
    here, right = (np.arange(2 * n) + 2 * n * k for k in (0, 0))
    faces = []
    for k in range(n - 2):
        here, right = np.arange(2 * n) + 2 * n * k, (np.arange(2 * n) + 1) % (2 * n) + 2 * n * k
        faces += [np.stack([here, here + 2 * n, right], axis=1), np.stack([right, here + 2 * n, right + 2 * n], axis=1)]
    triangles = np.concatenate(faces)
    points, closed, holes = small_parts.filled(belt, triangles, 0.4)  # both caps are 0.52 / 2 wide
    assert holes.mended == 2 and EdgeTable.of(closed).counts.tolist() == [2] * len(EdgeTable.of(closed).counts)
    assert enclosed_volumes(points, closed).sum() / 6.0 > 3.9
    assert small_parts.filled(belt, triangles, 0.25)[2].mended == 0


def test_a_slit_without_an_area_gets_no_triangles():
    points = np.array([(0, 0, 0), (1, 0, 0), (0.4, 0, 0), (0.5, 1, 0), (0.5, -1, 0), (0, 9, 0), (9, 9, 0)], float)
    triangles = np.array([(0, 1, 3), (2, 0, 4), (1, 2, 4), (0, 3, 5), (3, 6, 5), (3, 1, 6)])
    new, closed, _ = small_parts.filled(points, triangles, 0.2)
    assert face_areas(new, closed).min() > 0.0 and len(closed) == len(triangles)


@pytest.mark.parametrize("seed", range(3))
def test_order_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    points, triangles = joined(grid(8, {(2, 2), (5, 5), (5, 6)}), small(0.05))
    order, turn = rng.permutation(len(triangles)), rng.integers(0, 3, len(triangles))
    mixed = np.take_along_axis(triangles, (np.arange(3) + turn[:, None]) % 3, axis=1)[order]
    assert np.array_equal(
        small_parts.is_crumb(points, mixed, 0.1)[0], small_parts.is_crumb(points, triangles, 0.1)[0][order]
    )
    assert small_parts.filled(points, mixed, 0.3)[2].mended == small_parts.filled(points, triangles, 0.3)[2].mended == 2
