# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how much of a mesh's UV area is cut off at the border of the tile."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from addon.mesh import uv_layout
from addon.mesh.triangle_mesh import Mesh


def quads(u, width):
    """Squares whose left sides are at `u` (N,), from v = 0 to `width`, as a mesh of two triangles each."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)], np.float32) * np.float32(width)
    uv = (corners + np.stack([u, np.zeros_like(u)], axis=1)[:, None]).reshape(-1, 2).astype(np.float32)
    numbers = np.arange(len(uv), dtype=np.int32)
    positions = np.column_stack([uv, np.zeros(len(uv), np.float32)])
    return Mesh("mesh", positions, numbers, np.zeros_like(positions), numbers.reshape(-1, 3), np.eye(4), uv)


@pytest.mark.parametrize("is_along_v", [False, True])
@pytest.mark.parametrize(("tiles", "share"), [((1, 1), 0.625), ((2, 1), 0.0)])
def test_the_share_that_is_cut_off_is_that_of_the_area_outside(tiles, share, is_along_v):
    mesh = quads(np.array([0.0, 0.75, 1.0, 1.75 if share else 1.5], np.float32), 0.5)
    if is_along_v:
        mesh, tiles = replace(mesh, uv=mesh.uv[:, ::-1].copy()), tiles[::-1]
    assert uv_layout.cut_off(mesh, uv_layout.outside(mesh, tiles), tiles) == pytest.approx(share, abs=0.01)


def test_a_square_that_fills_a_tile_is_on_no_other():
    assert uv_layout.tiles(quads(np.zeros(1), 1.0)) == [1001]
    assert uv_layout.tiles(quads(np.array([1.0, 0.5]), 1.0)) == [1001, 1002]


def test_the_area_outside_of_a_large_mesh_takes_little_memory():
    mesh = quads(np.linspace(2.0, 3.0, 100_000, dtype=np.float32), 0.5)
    tracemalloc.start()
    try:
        assert uv_layout.cut_off(mesh, uv_layout.outside(mesh)) == 1.0
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()
