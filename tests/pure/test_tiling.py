# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how meshes repeat, on arrays alone."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.mesh.tiling import Repeat, repeat_of
from addon.mesh.triangle_mesh import Mesh

SIDE = 6
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
UP = (0.0, 0.0, 1.0)


def grid(heights=lambda u, v: 0.0 * u, *, flat=()):
    """The square 0..1 with one normal at each vertex, and its own in each corner of some triangles."""
    u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, SIDE + 1), np.linspace(0, 1, SIDE + 1)))
    first = (np.arange(SIDE)[:, None] * (SIDE + 1) + np.arange(SIDE)).ravel()
    right, up = first + 1, first + SIDE + 1
    triangles = np.concatenate([np.stack([first, right, up + 1], axis=1), np.stack([first, up + 1, up], axis=1)])
    points = np.stack([u, v, heights(u, v)], axis=1)
    mesh = Mesh.of_arrays("tile", points, triangles, np.stack([u, v], axis=1))
    normals = mesh.normals.reshape(-1, 3, 3).copy()
    sums = np.zeros((len(points), 3))
    np.add.at(sums, triangles.reshape(-1), normals.reshape(-1, 3))
    smooth = (sums / np.linalg.norm(sums, axis=1, keepdims=True))[triangles].astype(np.float32)
    smooth[list(flat)] = normals[list(flat)]
    return replace(mesh, normals=smooth.reshape(-1, 3), normals_domain="CORNER" if len(flat) else "POINT")


def placed(mesh, matrix, at):
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = matrix, at
    return replace(mesh, to_world=to_world)


def wave(u, v):
    return 0.1 * np.sin(2 * np.pi * (u + 0.1)) * np.cos(2 * np.pi * (v + 0.2))


@pytest.mark.parametrize("heights", [lambda u, v: 0.0 * u, wave, lambda u, v: 0.5 * u - 0.2 * v + wave(u, v)])
def test_steps_are_those_from_border_to_border(heights):
    low = placed(grid(heights), 2.0 * TURN, (5.0, 6.0, 7.0))
    repeat = repeat_of(low, "uv")
    u, v = (
        [x, y, float(heights(np.array(x), np.array(y)) - heights(np.array(0.0), np.array(0.0)))]
        for x, y in ((1, 0), (0, 1))
    )
    assert np.allclose(repeat.to_dict()["u"], 2.0 * TURN @ u, atol=1e-6)
    assert np.allclose(repeat.to_dict()["v"], 2.0 * TURN @ v, atol=1e-6)
    assert repeat == repeat_of(low, "uv") and len(repeat_of(low, "u").moves) == 1


def test_borders_may_be_cut_otherwise_on_both_sides():
    low = grid()
    uv = np.float32([(0, 0), (1, 0), (1, 1), (0, 1), (1, 0.3)])
    points = np.pad(3.0 * uv, ((0, 0), (0, 1)))
    fan = Mesh.of_arrays("lo", points, np.array([(0, 1, 4), (0, 4, 3), (4, 2, 3)]), uv)
    assert repeat_of(fan, "u").to_dict() == {"u": [3.0, 0.0, 0.0]}
    assert repeat_of(low, "v").to_dict() == {"v": [0.0, 1.0, 0.0]}


def test_what_differs_in_more_than_a_step_is_no_tile():
    with pytest.raises(BakeError, match="'tile' is no tile along U"):
        repeat_of(grid(lambda u, v: 0.1 * u * v), "uv")
    half = grid()
    kept = (half.uv[half.triangles][..., 0] < 0.9).all(axis=1)
    with pytest.raises(BakeError, match="'tile' is no tile along U"):
        repeat_of(half.with_triangles(kept), "uv")


def test_only_what_reaches_into_the_tile_comes_in():
    low, high = grid(), placed(grid(), np.eye(3), (0.25, 0.0, 0.3))
    # Columns of triangles: those beyond 1 come in on the left, and none touches the other borders but with its edge.
    (_, found), *others = replace(repeat_of(low, "u"), reach=-1e-6).copies(high)
    centers = high.positions[high.vertices[high.triangles[found]]].mean(axis=1)[:, 0] + 0.25
    assert not others and centers.min() > 1.0 - 1.0 / SIDE
    count = len(list(replace(repeat_of(low, "uv"), reach=0.5).copies(high)))
    assert count == 8
    for copy, numbers in replace(repeat_of(low, "uv"), reach=0.2).copies(high):
        moved = copy.positions[copy.vertices] + copy.to_world[:3, 3]
        whole = high.positions[high.vertices[high.triangles[numbers].reshape(-1)]] + high.to_world[:3, 3]
        step = moved - whole
        assert np.allclose(step, np.round(step[0]), atol=1e-6) and np.abs(step[0]).max() > 0.5
        assert np.array_equal(copy.normals, high.normals[high.triangles[numbers].reshape(-1)])


def test_a_tile_far_smaller_than_what_repeats_is_refused():
    repeat = Repeat((("u", (1e-3, 0.0, 0.0)), ("v", (0.0, 1e-3, 0.0))), (0.0, 0.0), (1.0, 1.0))
    with pytest.raises(BakeError, match="times as large as the tile"):
        list(repeat.copies(grid()))


def test_normals_at_opposite_borders_become_one():
    mesh = grid(wave)
    joined = repeat_of(mesh, "uv").joined(mesh)
    normals = np.empty((SIDE + 1, SIDE + 1, 3))
    normals.reshape(-1, 3)[joined.vertices] = joined.normals
    assert np.array_equal(normals[:, 0], normals[:, -1]) and np.array_equal(normals[0], normals[-1])
    before = np.empty_like(normals)
    before.reshape(-1, 3)[mesh.vertices] = mesh.normals
    assert np.array_equal(normals[1:-1, 1:-1], before[1:-1, 1:-1]) and not np.array_equal(before[:, 0], before[:, -1])
    assert repeat_of(mesh, "uv").joined(mesh) is joined


@pytest.mark.parametrize(("off", "is_joined"), [(1e-5, True), (1e-4, False)])
def test_borders_join_that_meet_but_for_rounding(off, is_joined):
    """A sculpt's borders are off by what single precision loses; those of two different ones stay open."""
    mesh = grid(lambda u, v: 0.1 * np.sin(np.pi * u) + off * (u == 1.0))
    joined = repeat_of(grid(), "u").joined(mesh)
    normals = np.empty((SIDE + 1, SIDE + 1, 3))
    normals.reshape(-1, 3)[joined.vertices] = joined.normals
    assert np.array_equal(normals[1:-1, 0], normals[1:-1, -1]) == is_joined


def test_flat_faces_keep_their_normals():
    flat = [0, 5, SIDE * SIDE - 1]
    mesh = grid(wave, flat=flat)
    joined = repeat_of(mesh, "uv").joined(mesh)
    assert np.array_equal(joined.normals[joined.triangles[flat]], mesh.normals[mesh.triangles[flat]])
    assert not np.array_equal(joined.normals, mesh.normals)


def test_normals_of_its_own_stay():
    mesh = replace(grid(wave), normals_domain="")
    assert repeat_of(mesh, "uv").joined(mesh) is mesh


def test_other_open_edges_stay():
    """A mesh of two halves that are not joined: in the middle, it looks as it did."""
    mesh = grid(wave)
    is_left = mesh.positions[mesh.vertices[mesh.triangles]].mean(axis=1)[:, 0] < 0.5
    vertices = mesh.vertices.copy()
    vertices[mesh.triangles[is_left].reshape(-1)] += len(mesh.positions)
    normals = mesh.normals.copy()
    normals[mesh.triangles[is_left].reshape(-1)] = UP
    halves = replace(mesh, positions=np.tile(mesh.positions, (2, 1)), vertices=vertices, normals=normals)
    joined = repeat_of(halves, "uv").joined(halves)
    is_middle = np.abs(mesh.positions[mesh.vertices] - 0.5)[:, :2].max(axis=1) < 0.4
    assert np.array_equal(joined.normals[is_middle], normals[is_middle])
    assert not np.array_equal(joined.normals, normals)
