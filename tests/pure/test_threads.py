# SPDX-License-Identifier: GPL-3.0-or-later
"""Long arrays in blocks: each element once, however many are left for the last block."""

import numpy as np
import pytest

from addon.mesh import bvh, threads, triangle_mesh
from addon.mesh.triangle_mesh import Mesh

BLOCK = threads.BLOCK


@pytest.mark.parametrize("count", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 3 * BLOCK + 7])
def test_blocks_cover_each_element_once(count):
    seen = np.zeros(count, int)

    def touch(part):
        seen[part] += 1
        assert 0 < part.stop - part.start <= BLOCK

    threads.each(count, touch)
    assert (seen == 1).all()


def test_results_come_in_the_order_of_the_parts():
    assert threads.at_once(lambda number: number * number, range(50)) == [number * number for number in range(50)]


def triangles(seed, count):
    """A mesh of triangles that share nothing."""
    rng = np.random.default_rng(seed)
    positions = (rng.random((count, 1, 3)) + 0.1 * rng.random((count, 3, 3))).astype(np.float32).reshape(-1, 3)
    corners = np.arange(3 * count, dtype=np.int32)
    return Mesh(
        name="many",
        positions=positions,
        vertices=corners,
        normals=np.zeros((3 * count, 3), np.float32),
        triangles=corners.reshape(-1, 3),
        to_world=np.eye(4),
        uv=np.ascontiguousarray(positions[:, :2]),
    )


def test_one_triangle_more_than_a_block_is_measured_and_enclosed_as_in_one_seed_3(monkeypatch):
    monkeypatch.setattr(threads, "BLOCK", 64)
    mesh = triangles(3, 64 + 1)
    areas, tree = triangle_mesh.uv_areas(mesh), bvh.build(mesh.positions, mesh.triangles)
    monkeypatch.setattr(threads, "BLOCK", 2**16)
    assert np.array_equal(areas, triangle_mesh.uv_areas(mesh))
    whole = bvh.build(mesh.positions, mesh.triangles)
    assert np.array_equal(tree.order, whole.order)
    assert np.array_equal(tree.nodes, whole.nodes)
