# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests threads: each element of a long array is visited once, also where the last block is shorter."""

import os
import threading
import time

import numpy as np
import pytest

from addon.core import threads
from addon.mesh import bvh, uv_layout
from addon.mesh.triangle_mesh import Mesh

BLOCK = threads.ELEMENTS_AT_ONCE


@pytest.mark.parametrize("count", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 3 * BLOCK + 7])
def test_blocks_cover_each_element_once(count):
    seen = np.zeros(count, int)

    def count_visits(part):
        seen[part] += 1
        assert 0 < part.stop - part.start <= BLOCK

    threads.for_blocks(count, count_visits)
    assert (seen == 1).all()


def test_blocks_of_another_size_cover_each_element_once():
    seen = np.zeros(17, int)
    sizes = []

    def count_visits(part):
        seen[part] += 1
        sizes.append(part.stop - part.start)

    threads.for_blocks(17, count_visits, 5)
    assert (seen == 1).all()
    assert sorted(sizes) == [2, 5, 5, 5]


@pytest.mark.parametrize("cores", [1, 3, 8])
@pytest.mark.parametrize("count", [0, 1, 5, 17])
def test_shares_cover_each_element_once_in_as_many_calls_as_cores(count, cores, monkeypatch):
    monkeypatch.setattr(threads, "processors", lambda: cores)
    seen, calls = np.zeros(count, int), []

    def count_visits(parts):
        calls.append(list(parts))
        for part in calls[-1]:
            seen[part] += 1
            assert 0 < part.stop - part.start <= 5

    threads.for_shares(count, 5, count_visits)
    assert (seen == 1).all()
    assert len(calls) == min(cores, -(-count // 5))


@pytest.mark.parametrize(
    ("quota", "expected"),
    [("max 100000", 8), ("150000 100000", 2), ("50000 100000", 1), ("9900000 100000", 8), ("", 8), (None, 8)],
)
def test_a_container_may_have_fewer_processors(monkeypatch, tmp_path, quota, expected):
    monkeypatch.setattr(os, "process_cpu_count", lambda: 8, raising=False)
    monkeypatch.setattr(threads, "QUOTA", tmp_path / "cpu.max")
    if quota is not None:
        threads.QUOTA.write_text(f"{quota}\n")
    assert threads.processors() == expected


def test_threads_are_used_again_and_calls_within_calls_end():
    """All threads of the pool are in the outer call."""
    seen = set()

    def work(number):
        seen.add(threading.get_ident())
        return sum(threads.map_parallel(lambda other: number * other, range(10)))

    for _ in range(20):
        assert threads.map_parallel(work, range(40)) == [45 * number for number in range(40)]
    assert len(seen) <= threads.processors()


def test_after_an_error_no_thread_goes_on():
    going = []

    def work(number):
        if number == 0:
            raise ValueError
        going.append(number)
        time.sleep(0.01)
        going.remove(number)

    with pytest.raises(ValueError):
        threads.map_parallel(work, range(100))
    assert going == []


def test_map_parallel_returns_results_in_order():
    assert threads.map_parallel(lambda number: number * number, range(50)) == [number * number for number in range(50)]


@pytest.mark.parametrize("shape", [(17,), (17, 3)], ids=str)
def test_rows_are_taken_by_places_of_any_shape_seed_2(shape, monkeypatch):
    monkeypatch.setattr(threads, "ELEMENTS_AT_ONCE", 5)
    rng = np.random.default_rng(2)
    rows, places = rng.random((9, 2)), rng.integers(0, 9, shape)
    assert np.array_equal(threads.take(rows, places), rows[places])


def triangles(seed, count):
    """A mesh of triangles that share no vertices."""
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


def test_a_partial_second_block_gives_the_same_areas_and_tree_as_one_block_seed_3(monkeypatch):
    monkeypatch.setattr(threads, "ELEMENTS_AT_ONCE", 64)
    mesh = triangles(3, 64 + 1)
    areas, tree = uv_layout.areas(mesh), bvh.build(mesh.positions, mesh.triangles)
    monkeypatch.setattr(threads, "ELEMENTS_AT_ONCE", 2**16)
    assert np.array_equal(areas, uv_layout.areas(mesh))
    whole = bvh.build(mesh.positions, mesh.triangles)
    assert np.array_equal(tree.order, whole.order)
    assert np.array_equal(tree.nodes, whole.nodes)
