# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which triangles are found near some squares of a map, against every triangle's box by itself."""

import numpy as np
import pytest

from addon.core import udim
from addon.mesh import uv_layout
from addon.mesh.triangle_mesh import Mesh

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


@pytest.mark.parametrize("seed", range(4))
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


@pytest.mark.parametrize("seed", range(4))
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


@pytest.mark.parametrize("seed", range(4))
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
