# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests UV islands, stacked faces and hard edges on layouts where they are known."""

from dataclasses import replace

import numpy as np
import pytest

from addon.mesh import uv_islands, uv_seams
from addon.mesh.triangle_mesh import Mesh


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


@pytest.mark.parametrize("seed", range(4))
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


@pytest.mark.parametrize("seed", range(3))
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
