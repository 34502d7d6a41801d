# SPDX-License-Identifier: GPL-3.0-or-later
"""Grids of quads become rectangles, where that costs little, and all else stays as it is."""

import numpy as np
import pytest

from addon.mesh import uv_islands, uv_strips
from addon.mesh.triangle_mesh import Mesh


def grid(rows, columns):
    """Quads (rows * columns, 4) between (rows + 1) * (columns + 1) points."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    start = row * (columns + 1) + column
    return np.stack([start, start + 1, start + columns + 2, start + columns + 1], axis=1)


def mesh_of(points, uv, faces):
    """A mesh of faces, each a list of corners; corners with the same numbers share points and UVs."""
    sizes = np.array([len(face) for face in faces])
    starts, corners = np.cumsum(sizes) - sizes, np.concatenate(faces)
    triangles = [
        (start, start + k, start + k + 1) for start, n in zip(starts, sizes, strict=True) for k in range(1, n - 1)
    ]
    owner = np.repeat(np.arange(len(faces)), sizes - 2)
    places, vertices = np.unique(points, axis=0, return_inverse=True)  # a seam has two UVs at a vertex
    return Mesh(
        "grid",
        places.astype(np.float32),
        vertices.reshape(-1)[corners].astype(np.int32),
        np.zeros((len(corners), 3), np.float32),
        np.array(triangles, np.int32),
        np.eye(4),
        uv=uv[corners].astype(np.float32),
        faces=owner.astype(np.int32),
    )


def arc(inner, outer=1.0, rows=1, columns=24, angle=1.7 * np.pi):
    """Points (N, 3) of a grid along an arc."""
    radius, turn = np.meshgrid(np.linspace(inner, outer, rows + 1), np.linspace(0.0, angle, columns + 1), indexing="ij")
    return np.stack([radius * np.sin(turn), radius * np.cos(turn), 0.0 * turn], axis=-1).reshape(-1, 3)


def straightened(mesh):
    nodes = np.unique(np.column_stack([mesh.uv, mesh.vertices]), axis=0, return_inverse=True)[1]
    return uv_strips.straighten(mesh, mesh.uv, nodes, uv_islands.islands(mesh))


def shuffled(faces, seed):
    """Faces in another order, which start at other corners."""
    random = np.random.default_rng(seed)
    faces = faces[random.permutation(len(faces))]
    return np.take_along_axis(faces, (random.integers(0, 4, (len(faces), 1)) + np.arange(4)) % 4, axis=1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("rows", [1, 3])
def test_an_arc_becomes_a_rectangle(seed, rows):
    """As long as the mean of its rows, in the proportions of the surface, with its area, and not turned over."""
    points = arc(0.9, rows=rows)
    mesh = mesh_of(points, 0.1 * points[:, :2] + 0.5, shuffled(grid(rows, 24), seed))
    found = straightened(mesh)
    chord, chords = 2.0 * np.sin(1.7 * np.pi / 48), np.linspace(0.9, 1.0, rows + 1).mean()
    extent = np.sort(np.ptp(found, axis=0))
    assert extent[1] / extent[0] == pytest.approx(24 * chord * chords / 0.1, rel=1e-5)
    assert extent.prod() == pytest.approx(0.01 * 24 * 0.5 * np.sin(1.7 * np.pi / 24) * (1.0 - 0.81), rel=1e-5)
    assert sorted(len(np.unique(axis.round(5))) for axis in found.T) == [rows + 1, 25]
    assert found.mean(axis=0) == pytest.approx(mesh.uv.astype(float).mean(axis=0), abs=1e-6)
    assert (np.linalg.det(found[mesh.triangles[:, 1:]] - found[mesh.triangles[:, :1]]) > 0.0).all()


def test_what_is_mirrored_stays():
    points = arc(0.9)
    mesh = mesh_of(points, 0.1 * points[:, :2] * (-1.0, 1.0) + 0.5, grid(1, 24))
    assert np.array_equal(straightened(mesh), mesh.uv)


@pytest.mark.parametrize("inner, is_straightened", [(0.67, True), (0.657, False)])
def test_what_costs_more_than_two_percent_stays(inner, is_straightened):
    """Texels at the radius r are as far apart along it as r by its mean: 1 + 1.5 v of the map are needed, v the variance of r
    by the square of its mean, and 1 / 0.98 at an inner radius of 0.664."""
    points = arc(inner, rows=12, columns=192)
    mesh = mesh_of(points, 0.1 * points[:, :2] + 0.5, grid(12, 192))
    assert (np.abs(straightened(mesh) - mesh.uv).max() > 0.01) == is_straightened


def test_uneven_rows_keep_their_mean_lengths():
    """Lines along one axis at 0, 1, 3, 6 and 10, along the other at 0, 2 and 3, turned by 30 degrees and bent a bit."""
    u, v = np.meshgrid([0.0, 1.0, 3.0, 6.0, 10.0], [0.0, 2.0, 3.0])
    points = np.stack([u, v, 0.0 * u], axis=-1).reshape(-1, 3)
    turn = np.array([[0.75**0.5, 0.5], [-0.5, 0.75**0.5]])
    uv = 0.05 * points[:, :2] @ turn + np.random.default_rng(0).uniform(-1e-4, 1e-4, (15, 2))
    mesh = mesh_of(points, uv, shuffled(grid(2, 4), 3))
    found = straightened(mesh)
    lines = [np.unique(axis.round(7)) for axis in (found - found.min(axis=0)).T]
    for line, there in zip(sorted(lines, key=len), ([0, 2, 3], [0, 1, 3, 6, 10]), strict=True):
        even = line / line[-1] * there[-1]
        assert even == pytest.approx(there, abs=1e-5) or even == pytest.approx(
            there[-1] - np.array(there[::-1]), abs=1e-5
        )


def test_a_tube_that_is_cut_along_is_a_grid():
    """The UVs bend where the tube does not: its own sides are straight."""
    turn, along = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, 3.0, 6))
    points = np.stack([np.cos(turn), np.sin(turn), along], axis=-1).reshape(-1, 3).round(12)
    uv = 0.05 * np.stack([turn + 0.2 * along**2, along], axis=-1).reshape(-1, 2)
    mesh = mesh_of(points, uv, grid(5, 16))
    extent = np.ptp(straightened(mesh), axis=0)
    assert len(mesh.positions) == 6 * 16
    assert np.sort(extent)[::-1] / extent.min() == pytest.approx([32.0 * np.sin(np.pi / 16) / 3.0, 1.0], rel=1e-5)


def islands_that_are_no_grids():
    square = grid(2, 2)
    u, v = np.meshgrid(np.arange(3.0), np.arange(3.0))
    flat = np.stack([u, v, 0.0 * u], axis=-1).reshape(-1, 3)
    closed = np.stack([np.arange(8), (np.arange(8) + 1) % 8, (np.arange(8) + 1) % 8 + 8, np.arange(8) + 8], axis=1)
    turn = np.arange(8) * np.pi / 4
    rim = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    six = np.concatenate([[(0.0, 0.0, 0.0)], rim[:6]])
    return {
        "an L": (flat, square[:3]),
        "a ring": (np.concatenate([0.9 * rim, rim]), closed),
        "two at a point": (flat, square[[0, 3]]),
        "a triangle beside": (flat, [*square[:1], [1, 2, 4]]),
        "three around a point": (six, [[0, 1, 2, 3], [0, 3, 4, 5], [0, 5, 6, 1]]),
        "without area": (0.0 * flat, square),
        "one turned over": (flat, np.concatenate([square[:3], square[3:, ::-1]])),
    }


@pytest.mark.parametrize("kind", islands_that_are_no_grids())
def test_what_is_no_grid_stays(kind):
    points, faces = islands_that_are_no_grids()[kind]
    bent = points + 0.02 * np.sin(3.0 * points[:, 1::-1] + 1.0) @ np.eye(2, 3)
    mesh = mesh_of(points, 0.2 * bent[:, :2] + 0.3, faces)
    assert np.array_equal(straightened(mesh), mesh.uv)


@pytest.mark.parametrize(("rows", "is_closed"), [(1, False), (2, False), (8, True)], ids=["ring", "band", "torus"])
def test_what_is_closed_is_no_grid(rows, is_closed):
    """Eight quads around, beside the same ones that are cut; a torus is closed along both axes."""
    lines = rows + (not is_closed)
    row, column = np.divmod(np.arange(8 * rows), 8)
    above, beside = (row + 1) % lines * 8, (column + 1) % 8
    closed = np.stack([8 * row + column, 8 * row + beside, above + beside, above + column], axis=1)
    points = np.random.default_rng(rows).normal(size=(8 * lines, 3))
    for faces, is_grid in ((closed, False), (closed[column < 7], not is_closed)):
        mesh = mesh_of(points, points[:, :2], faces)
        found = uv_strips._grids(mesh, np.concatenate(faces), np.zeros(2 * len(faces), int))
        assert (found is not None) == is_grid


def test_islands_beside_a_grid_stay():
    points = np.concatenate([arc(0.95), arc(0.5) + (3.0, 0.0, 0.0)])
    faces = np.concatenate([grid(1, 24), grid(1, 24) + 50])
    mesh = mesh_of(points, 0.1 * points[:, :2] + 0.3, faces)
    is_moved = (straightened(mesh) != mesh.uv).any(axis=1)
    assert is_moved[:96].sum() > 90 and not is_moved[96:].any()


@pytest.mark.parametrize("seed", range(5))
def test_paths_are_walked_in_order(seed):
    random = np.random.default_rng(seed)
    nodes = random.permutation(60)
    paths = np.split(nodes, np.sort(random.choice(np.arange(2, 58, 3), 5, replace=False)))
    pairs = np.concatenate([np.stack([path[:-1], path[1:]], axis=1) for path in paths])
    place, first = uv_strips._order(np.sort(pairs, axis=1)[random.permutation(len(pairs))], 60)
    for path in paths:
        way = path if path[0] < path[-1] else path[::-1]
        assert place[way].tolist() == list(range(len(way))) and (first[way] == way[0]).all()
