# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches of meshes whose faces point to different sides. The truth is a clean mesh, or follows from how a mesh was made."""

import numpy as np
import pytest

from addon.mesh import orientation
from addon.mesh.closest import Surface
from tests.support import oracle, random_cases


def strip(count, turns=0.5):
    """A closed strip of `count` quads with so many turns: half a turn makes a Möbius strip."""
    angle = 2.0 * np.pi * np.arange(count) / count
    twist = turns * angle
    across = np.stack([np.cos(twist) * np.cos(angle), np.cos(twist) * np.sin(angle), np.sin(twist)], axis=1)
    middle = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    points = np.concatenate([middle - 0.2 * across, middle + 0.2 * across])
    here = np.arange(count)
    after = (here + 1) % count
    low, high = np.stack([here, after]), np.stack([here, after]) + count
    if (2.0 * turns) % 2.0:  # the last quad meets the first one with its sides exchanged
        low[1, -1], high[1, -1] = high[1, -1], low[1, -1]
    triangles = np.concatenate(
        [np.stack([low[0], low[1], high[1]], axis=1), np.stack([low[0], high[1], high[0]], axis=1)]
    )
    return points.astype(np.float32), triangles


def sphere(level):
    """The points and the triangles of a closed sphere."""
    corners = oracle.icosphere(level)
    points, vertices = np.unique(np.round(corners.reshape(-1, 3), 9), axis=0, return_inverse=True)
    return points, vertices.reshape(-1, 3)


def patches(points, triangles):
    used = points[triangles]
    return orientation.patches(points, triangles, float(np.linalg.norm(np.ptp(used.reshape(-1, 3), axis=0))))


def flipped(triangles, chosen):
    return np.where(chosen[:, None], triangles[:, ::-1], triangles)


def two_spheres(level=3):
    points, triangles = sphere(level)
    both = np.concatenate([points, points + (3.0, 0.0, 0.0)]).astype(np.float32)
    return both, np.concatenate([triangles, triangles + len(points)])


def test_a_clean_mesh_has_no_pairs():
    points, triangles = two_spheres()
    found = patches(points, triangles)
    assert found.count == 2
    assert found.pairs is None
    assert not found.is_against.any()
    assert found.is_closed.all()


@random_cases.seeds(4, fast=2)
@pytest.mark.parametrize("share", [0.001, 0.15, 0.45])
def test_flipped_triangles_are_found(seed, share):
    rng = np.random.default_rng(seed)
    points, triangles = two_spheres()
    is_flipped = rng.random(len(triangles)) < share
    found = patches(points, flipped(triangles, is_flipped))
    assert found.count == 2
    assert np.array_equal(found.is_against, is_flipped)
    assert found.is_closed.all()
    assert found.contradicting == 0


def test_triangles_on_vertices_of_their_own_belong_together_seed_1():
    rng = np.random.default_rng(1)
    points, triangles = two_spheres()
    is_flipped = rng.random(len(triangles)) < 0.3
    loose = points[flipped(triangles, is_flipped)].reshape(-1, 3)
    loose = (loose + rng.uniform(-2e-7, 2e-7, loose.shape)).astype(np.float32)
    found = patches(loose, np.arange(len(loose)).reshape(-1, 3))
    assert found.count == 2
    assert np.array_equal(found.is_against, is_flipped)


def test_vertices_farther_apart_stay_apart():
    points, triangles = sphere(1)
    apart = 1.01 * points[triangles].reshape(-1, 3) + np.repeat(0.01 * points[triangles].mean(axis=1), 3, axis=0)
    assert patches(apart.astype(np.float32), np.arange(len(apart)).reshape(-1, 3)).count == len(triangles)


def test_loose_vertices_far_away_do_not_join_others():
    points, triangles = sphere(1)
    loose = points[triangles].reshape(-1, 3)
    moved = loose + np.repeat(0.002 * points[triangles].mean(axis=1), 3, axis=0)
    far = np.concatenate([moved, [(1e6, 0.0, 0.0)]]).astype(np.float32)
    assert patches(far, np.arange(len(moved)).reshape(-1, 3)).count == len(triangles)


@pytest.mark.parametrize(("turns", "contradicting"), [(0.0, 0), (0.5, 1), (1.0, 0), (1.5, 1)])
def test_a_moebius_strip_contradicts_itself(turns, contradicting):
    points, triangles = strip(40, turns)
    rng = np.random.default_rng(3)
    found = patches(points, flipped(triangles, rng.random(len(triangles)) < 0.3))
    assert found.contradicting == contradicting
    turned = flipped(triangles, np.zeros(len(triangles), bool))
    assert len(found.labels) == len(turned)
    assert not found.is_closed.any()


def test_patches_beside_one_that_contradicts_itself_keep_their_sides_seed_5():
    rng = np.random.default_rng(5)
    ball, of_ball = two_spheres()
    points, triangles = strip(40)
    is_flipped = np.concatenate([rng.random(len(of_ball)) < 0.3, rng.random(len(triangles)) < 0.3])
    both = flipped(np.concatenate([of_ball, triangles + len(ball)]), is_flipped)
    found = patches(np.concatenate([ball, points]).astype(np.float32), both)
    alone = patches(points, both[len(of_ball) :] - len(ball))
    assert found.count == 2 + alone.count
    assert found.contradicting == 1
    assert np.array_equal(found.is_against, np.concatenate([is_flipped[: len(of_ball)], alone.is_against]))
    assert not np.isin(found.labels[: len(of_ball)], found.labels[len(of_ball) :]).any()


@random_cases.seeds(4, fast=2)
def test_a_moebius_strip_is_cut_across_its_sharpest_edge(seed):
    points, triangles = strip(40)
    points[[7, 47]] *= 1.05
    rng = np.random.default_rng(seed)
    spoiled = flipped(triangles, rng.random(len(triangles)) < 0.3)
    found = patches(points, spoiled)
    mended = flipped(spoiled, found.is_against)
    ways = np.stack([mended, np.roll(mended, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, edge, counts = np.unique(np.sort(ways, axis=1), axis=0, return_inverse=True, return_counts=True)
    is_up = np.bincount(edge.reshape(-1), ways[:, 0] < ways[:, 1])
    assert edges[(counts == 2) & (is_up != 1)].tolist() == [[7, 47]]


def test_three_planes_at_an_edge_go_on_smoothly():
    points = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1)], np.float32)
    # Two triangles in a plane, the second one flipped, and a third that stands on their edge.
    found = patches(points, np.array([(1, 0, 2), (1, 0, 3), (0, 1, 4)]))
    assert found.labels[0] == found.labels[1] != found.labels[2]
    assert found.is_against[0] != found.is_against[1]


def test_an_edge_of_twenty_triangles_joins_none():
    angle = 2.0 * np.pi * np.arange(20) / 20
    rim = np.stack([np.cos(angle), np.sin(angle), np.full(20, 0.5)], axis=1)
    points = np.concatenate([[(0, 0, 0), (0, 0, 1)], rim]).astype(np.float32)
    found = patches(points, np.stack([np.zeros(20, int), np.ones(20, int), 2 + np.arange(20)], axis=1))
    assert found.count == 20
    assert not found.is_against.any()


def test_triangles_without_an_area_follow_their_neighbors():
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 0)], np.float32)
    # A square of two triangles that point to opposite sides; the last one is a line.
    found = patches(points, np.array([(0, 1, 2), (0, 3, 2), (0, 4, 2)]))
    assert found.is_against[0] != found.is_against[1]
    assert found.count == 1


@pytest.mark.parametrize("count", [0, 1])
def test_meshes_of_no_and_of_one_triangle(count):
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)
    found = orientation.patches(points, np.arange(3 * count).reshape(-1, 3), 1.0)
    assert found.count == count
    assert len(found.labels) == len(found.is_against) == count


def test_copies_are_told_from_their_other_sides():
    points, triangles = sphere(1)
    points = np.concatenate([points, points, points]).astype(np.float32)
    count = len(points) // 3
    front, back = triangles + count, triangles[:, ::-1] + 2 * count
    same, other = orientation.copies(points, np.concatenate([triangles, front[:10], back[5:20]]))
    assert np.array_equal(np.flatnonzero(same), len(triangles) + np.arange(10))
    expected = np.zeros(len(same), bool)
    expected[5:20] = True
    expected[len(triangles) + 5 : len(triangles) + 10] = True
    expected[len(triangles) + 10 :] = True
    assert np.array_equal(other, expected)


@pytest.mark.parametrize("has_order", [False, True])
@pytest.mark.parametrize(("triangles", "places"), [(1, 5), (7, 200), (500, 500)])
def test_closest_points_are_those_of_a_search_through_all_seed_6(triangles, places, has_order):
    rng = np.random.default_rng(6)
    corners = (rng.normal(size=(triangles, 1, 3)) + rng.normal(scale=0.2, size=(triangles, 3, 3))).astype(np.float32)
    asked = rng.normal(scale=1.5, size=(places, 3)).astype(np.float32)
    order = rng.permutation(triangles) if has_order else None
    found, points, squares = Surface(corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3), order).closest(
        asked
    )
    # Points all over each triangle bound its distance from above, and from below up to their spacing.
    u, v = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21))
    weights = np.stack([1 - u - v, u, v], axis=-1)[(u + v) <= 1.0 + 1e-9]
    on = np.einsum("wc,tcx->twx", weights, corners.astype(np.float64))
    distances = np.linalg.norm(points - asked, axis=1)
    assert np.allclose(distances**2, squares, rtol=1e-4, atol=1e-9)
    apart = np.array([np.linalg.norm(place - on, axis=-1).min() for place in asked])
    assert (distances <= apart + 1e-6).all()
    assert (distances >= apart - 0.05).all()
    own = [np.linalg.norm(on[number] - point, axis=-1).min() for number, point in zip(found, points, strict=True)]
    assert max(own) < 0.05


@pytest.mark.filterwarnings("error")
def test_places_far_beyond_what_floats_can_square_have_a_closest_triangle():
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1e25, 0, 0), (1e25, 1, 0), (1e25, 0, 1)], np.float32)
    asked = np.array([(-1e30, 0.2, 0.2), (2e38, 0.0, 0.0)], np.float32)
    found, _, squares = Surface(points, np.arange(6).reshape(2, 3)).closest(asked)
    assert found.tolist() == [0, 1]
    assert np.isfinite(squares).all()


def test_a_place_on_a_triangle_whose_box_rounding_leaves_out_has_that_one_seed_1():
    rng = np.random.default_rng(1)
    start, stop = -rng.random(100, np.float32), rng.random(100, np.float32) / np.float32(50.0)
    height, zero = np.arange(100, dtype=np.float32), np.zeros(100, np.float32)
    end = start + (stop - start)  # that of the edge, as the closest point is computed
    corners = [[start, height, zero], [stop, height, zero], [start, height, zero + 1.0]]
    points = np.array(corners, np.float32).transpose(2, 0, 1).reshape(-1, 3)
    assert (end > stop).sum() > 20
    found, _, squares = Surface(points, np.arange(300).reshape(-1, 3)).closest(np.stack([end, height, zero], axis=1))
    assert found.tolist() == list(range(100))
    assert not squares.any()
