# SPDX-License-Identifier: GPL-3.0-or-later
"""Mirror images of surfaces: found, cut and joined, with areas and volumes in closed form."""

import numpy as np
import pytest

from addon.mesh import mirrors
from addon.mesh.fitting import surface_samples
from addon.mesh.mirrors import Plane
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import enclosed_volumes, face_areas

CUBE = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
FACES = np.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])
TRIANGLES = np.concatenate([FACES[:, :3], FACES[:, [0, 2, 3]]])
WEDGE = CUBE * np.where(CUBE[:, 2:] > 0, (0.3, 0.8, 1.0), (1.0, 1.0, 1.0)) + np.where(
    CUBE[:, 2:] > 0, (0.1, 0.0, 0.0), 0.0
)
"""A stump that is its own mirror image in Y alone."""


def plane_of(points, axes=range(3)):
    return mirrors.plane_of(points.astype(np.float32), TRIANGLES, surface_samples(points, TRIANGLES, 20_000), axes)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (CUBE, Plane(0, 0.0)),
        (CUBE * (1.0, 2.0, 3.0) + (5.0, 0.0, 0.0), Plane(0, 5.0)),
        (WEDGE, Plane(1, 0.0)),
        (WEDGE[:, [1, 2, 0]] * 0.01, Plane(0, 0.0)),
        (WEDGE[:, [2, 0, 1]] + (0.0, 0.0, 7.0), Plane(2, 7.0)),
        (WEDGE + 0.2 * WEDGE[:, [1, 2, 0]], None),
    ],
)
def test_the_plane_is_found(points, expected):
    found = plane_of(points)
    assert (found is None) == (expected is None)
    if expected is not None:
        assert found.axis == expected.axis and found.place == pytest.approx(expected.place, abs=0.01)


@pytest.mark.parametrize(("moved", "is_found"), [(0.00196, True), (0.00204, False)])
def test_small_differences_count_from_a_thousandth_of_the_size_on(moved, is_found):
    """A side of the cube turns about one of its edges, so that some of it is farther off than what counts."""
    points = CUBE.copy()
    points[5::2, 0] += moved
    assert (plane_of(points, [0]) is not None) == is_found
    assert plane_of(points, [0, 1]) == Plane(0 if is_found else 1, 0.0)


@pytest.mark.parametrize(("long", "moved", "is_found"), [(3.0, 0.0056, True), (3.0, 0.0064, False)])
def test_the_size_is_the_longest_side(long, moved, is_found):
    points = CUBE * (1.0, 1.0, long)
    points[5::2, 0] += moved
    assert (plane_of(points, [0]) is not None) == is_found


@pytest.mark.parametrize(
    ("middle", "place"), [(0.00096, 0.0), (-0.00096, 0.0), (0.00104, 0.00104), (-0.00104, -0.00104)]
)
def test_a_middle_near_0_is_taken_for_0(middle, place):
    """Up to half of a thousandth of the size, here 2: images are off by twice as much."""
    found = plane_of(CUBE + (middle, 0.0, 0.0), [0])
    assert found.place == pytest.approx(place, abs=1e-6) and (found.place == 0.0) == (place == 0.0)


def test_vertices_that_no_triangle_uses_move_no_plane():
    points = np.concatenate([CUBE + (5.0, 0.0, 0.0), [(99.0, 0.0, 0.0)]])
    assert plane_of(points, [0]).place == pytest.approx(5.0)


@pytest.mark.parametrize(("slope", "is_found"), [(0.3, True), (0.7, False)])
def test_the_sides_have_the_same_normals(slope, is_found):
    """A sheet with folds on one side that hardly rise above it."""
    x = np.linspace(-1.0, 1.0, 2001)
    heights = np.where((x > 0.0) & (np.arange(len(x)) % 2 == 1), 0.001 * slope, 0.0)
    points = np.concatenate([np.stack([x, np.full_like(x, y), heights], axis=1) for y in (0.0, 0.5)])
    a, b = np.arange(len(x) - 1), np.arange(len(x) - 1) + len(x)
    triangles = np.concatenate([np.stack([a, a + 1, b + 1], axis=1), np.stack([a, b + 1, b], axis=1)])
    found = mirrors.plane_of(points.astype(np.float32), triangles, surface_samples(points, triangles, 20_000), [0])
    assert (found is not None) == is_found


def test_what_has_no_plane_is_seen_from_few_samples(monkeypatch):
    asked, closest = [], mirrors.Surface.closest
    monkeypatch.setattr(mirrors.Surface, "closest", lambda *every: asked.append(len(every[1])) or closest(*every))
    assert plane_of(WEDGE + 0.2 * WEDGE[:, [1, 2, 0]]) is None and len(asked) == 3
    assert max(asked) < 2 * mirrors.FIRST_MEASURED


def test_nothing_has_no_plane():
    empty = np.zeros((0, 3)), np.zeros((0, 3), int)
    assert mirrors.plane_of(*empty, surface_samples(*empty, 10)) is None


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("place", [0.0, 0.3, -0.999, 1.0, -1.0, 2.0, -2.0])
def test_a_half_has_its_area_and_its_border_in_the_plane(axis, place):
    points, triangles = mirrors.half(CUBE, TRIANGLES, Plane(axis, place))
    height = np.clip(1.0 - place, 0.0, 2.0)
    area = {-2.0: 24.0, 1.0: 0.0, 2.0: 0.0, -1.0: 20.0}.get(place, 4.0 + 8.0 * height)
    assert face_areas(points, triangles).sum() == pytest.approx(area)
    edges = EdgeTable.of(triangles) if len(triangles) else None
    if edges is not None:
        ends = edges.ends[edges.is_open]
        assert (points[ends][..., axis] == place).all() and not edges.is_against.any()
        assert np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1).sum() == pytest.approx(
            8.0 if area < 24.0 else 0.0
        )


@pytest.mark.parametrize("seed", range(4))
def test_halves_of_any_triangles_have_the_area_of_the_whole(seed):
    rng = np.random.default_rng(seed)
    points, triangles = rng.normal(size=(30, 3)), rng.integers(0, 30, (60, 3))
    triangles = triangles[(np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)]
    points[:8, 0] = 0.25  # in the plane
    one = mirrors.half(points, triangles, Plane(0, 0.25))
    other = mirrors.half(points * (-1.0, 1.0, 1.0), triangles, Plane(0, -0.25))
    inside = (points[triangles][..., 0] == 0.25).all(axis=1)
    areas = [face_areas(*each).sum() for each in (one, other)]
    assert sum(areas) == pytest.approx(face_areas(points, triangles[~inside]).sum())
    assert one[0][:, 0].min() >= 0.25 and np.isfinite(one[0]).all()


@pytest.mark.parametrize("place", [0.0, 0.1, 1e3 + 0.1])
def test_two_halves_are_one_mesh_that_equals_its_mirror_image_to_the_bit(place):
    rng = np.random.default_rng(5)
    plane = Plane(0, place)
    points, triangles = mirrors.half((CUBE * (1.0, 0.7, 0.6) + (place, 0, 0)).astype(np.float32), TRIANGLES, plane)
    points = points + rng.uniform(0.0, 1e-3, points.shape)  # as fitting moves them
    both, faces = mirrors.joined(points, triangles, plane)
    assert both.dtype == np.float32 and len(faces) == 2 * len(triangles)
    assert np.array_equal(faces[: len(triangles)], triangles)
    edges = EdgeTable.of(faces)
    assert (edges.counts == 2).all() and not edges.is_against.any()
    assert enclosed_volumes(both, faces).sum() / 6.0 == pytest.approx(8.0 * 0.42, rel=0.01)
    step = both[:, 0].astype(np.float64)
    middle = (step.min() + step.max()) / 2.0
    image = both.astype(np.float64)
    image[:, 0] = 2.0 * middle - image[:, 0]
    rows = [np.unique(each, axis=0) for each in (both.astype(np.float64), image)]
    assert np.array_equal(*rows) and middle == pytest.approx(place, abs=1e-3)
    assert place or middle == 0.0


def test_what_came_beyond_the_plane_lies_in_it():
    """A pyramid whose tip fitting has moved through its bottom."""
    points = np.array([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (-0.2, 0.5, 0.5)], float)
    both, _ = mirrors.joined(points, np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]), Plane(0, 0.0))
    assert (both[:, 0] == 0.0).all()


def test_vertices_that_rounding_moved_off_the_plane_are_in_it():
    points = CUBE.copy()
    points[::2, 0] = (-1e-7, 1e-7, 1e-7, -1e-7)
    cut, triangles = mirrors.half(points, TRIANGLES, Plane(0, 0.0))
    assert len(cut) == 8 and (cut[:, 0] == 0.0).sum() == 4 and face_areas(cut, triangles).sum() == pytest.approx(12.0)


def test_borders_that_were_there_stay_open():
    """A strip across the plane, whose sides are open."""
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    both, faces = mirrors.joined(points, np.array([(0, 1, 2), (0, 2, 3)]), Plane(0, 0.0))
    assert len(both) == 6 and face_areas(both, faces).sum() == 2.0 and EdgeTable.of(faces).is_open.sum() == 6


@pytest.mark.parametrize("count", [2, 5, 9, 25])
def test_the_far_side_of_a_narrow_strip_is_no_cut(count):
    """However long its triangles are."""
    along = np.linspace(0.0, 12.0, count)
    points = np.stack([np.repeat(along, 2), np.tile([-0.5, 0.5], count), np.zeros(2 * count)], axis=1)
    first = 2 * np.arange(count - 1)
    strip = np.concatenate([np.stack([first + n for n in corners], axis=1) for corners in ((0, 2, 3), (0, 3, 1))])
    both = mirrors.joined(*mirrors.half(points, strip, Plane(1, 0.0)), Plane(1, 0.0))
    assert face_areas(*both).sum() == pytest.approx(12.0)


@pytest.mark.parametrize(("place", "is_cut"), [(0.22, True), (0.225, False)])
def test_edges_near_the_plane_belong_to_the_cut(place, is_cut):
    """Up to a quarter of the mean edge of borders, here 1 - place / 2: at 2 / 9."""
    points = np.array([(place, 0, 0), (1, 0, 0), (1, 1, 0), (place, 1, 0)], float)
    both, _ = mirrors.joined(points, np.array([(0, 1, 2), (0, 2, 3)]), Plane(0, 0.0))
    assert len(both) == (6 if is_cut else 8) and (both[:, 0] == 0.0).sum() == (2 if is_cut else 0)


@pytest.mark.parametrize(("place", "is_cut"), [(0.74, True), (0.76, False)])
def test_a_border_near_the_plane_as_a_whole_belongs_to_the_cut(place, is_cut):
    """A pyramid without its bottom, of edges of 1: up to three quarters of them."""
    points = np.array([(place, 0, 0), (place, 1, 0), (place, 1, 1), (place, 0, 1), (3, 0.5, 0.5)], float)
    sides = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    both, faces = mirrors.joined(points, sides, Plane(0, 0.0))
    assert len(both) == (6 if is_cut else 10) and EdgeTable.of(faces).is_open.any() != is_cut


# A tent on four corners in the plane, A, B, P and Q, whose ridge from L to R has sagged to the edge from A to B.
A, B, P, Q, L, R, FIN = range(7)
TENT = np.array([(0, 0, 0), (0, 1, 0), (0, 0.5, 1), (0, 0.5, -1), (1, 0.5, 0.6), (1, 0.5, -0.6), (2, 0.5, 0)], float)
LEFT, RIGHT = [(A, B, L), (L, B, P), (A, L, P)], [(B, A, R), (R, A, Q), (B, R, Q)]


def test_an_edge_through_the_plane_turns():
    """Four triangles would meet at it."""
    both, faces = mirrors.joined(TENT[:FIN], np.array([*LEFT, *RIGHT]), Plane(0, 0.0))
    edges = EdgeTable.of(faces)
    assert (edges.counts == 2).all() and not edges.is_against.any() and len(both) == 8
    assert np.array_equal(faces[[1, 2, 4, 5]], np.array([*LEFT, *RIGHT])[[1, 2, 4, 5]])
    assert sorted(map(sorted, faces[[0, 3]].tolist())) == [[A, L, R], [B, L, R]]


@pytest.mark.parametrize(
    "half",
    [
        [*LEFT, *RIGHT, (L, R, FIN)],  # the edge that it would become is there
        [(A, B, P), *RIGHT],  # it would become another edge of which one end is in the plane
        [*LEFT, (B, A, Q)],
        [(B, L, A), (A, L, FIN), (A, FIN, R)],  # one end of it is not in the plane
        [(A, FIN, R), (A, L, FIN), (B, L, A)],
    ],
)
def test_other_edges_stay(half):
    _, faces = mirrors.joined(TENT, np.array(half), Plane(0, 0.0))
    assert np.array_equal(faces[: len(half)], half)


def test_normals_are_mirrored_through_the_origin():
    samples = surface_samples(CUBE, TRIANGLES, 50)
    both = Plane(0, 5.0).both(samples)
    assert np.array_equal(both.normals[50:], samples.normals * (-1.0, 1.0, 1.0))
    assert np.array_equal(both.points[50:], samples.points * (-1.0, 1.0, 1.0) + (10.0, 0.0, 0.0))
