# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that tangents of large meshes are the same each time, to the bit, and that they are those of MikkTSpace."""

import bpy
import numpy as np
import pytest

from addon.scene import mesh_reader, steady_tangents

SIDE = 120
"""Faces along a side of the grids: more than PARALLEL in all."""
ROUNDED = 2e-5
"""How far MikkTSpace in single precision may be from double precision where faces take 4e-3 of the layout: 6e-8 / 4e-3."""


def grid(quads, side=SIDE):
    """A wavy grid with a share of quads, the others cut into triangles, a mirrored half of its UVs and a seam between both."""
    rng = np.random.default_rng(17)
    rows, columns = np.mgrid[0 : side + 1, 0 : side + 1] / side
    points = np.stack([columns * 2, rows * 2, 0.2 * np.sin(5 * columns) * np.cos(4 * rows)], axis=-1).reshape(-1, 3)
    numbers = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    corners = np.stack([numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]], axis=-1).reshape(-1, 4)
    is_quad = rng.random(len(corners)) < quads
    cut = corners[~is_quad]
    faces = [*corners[is_quad].tolist(), *cut[:, [0, 1, 2]].tolist(), *cut[:, [0, 2, 3]].tolist()]
    data = bpy.data.meshes.new("grid")
    data.from_pydata(points.tolist(), [], faces)
    data.shade_smooth()
    layout = points[mesh_reader.corner_vertices(data)][:, :2] / 2
    layout[:, 0] = np.abs(layout[:, 0] - 0.5)
    layout += rng.normal(0, 1e-3, (len(points), 2))[mesh_reader.corner_vertices(data)]
    data.uv_layers.new(name="UVMap").uv.foreach_set("vector", layout.astype(np.float32).reshape(-1))
    return data


def of_blender(data):
    data.calc_tangents(uvmap="UVMap")
    values = np.empty((len(data.loops), 3), np.float32)
    data.loops.foreach_get("tangent", values.reshape(-1))
    data.free_tangents()
    return values


def read(data):
    return mesh_reader.with_tangents(data, "UVMap", "grid", np.eye(4)).tangents


@pytest.mark.parametrize("quads", [0.0, 0.5, 1.0])
def test_tangents_are_those_of_mikktspace_and_the_same_each_time(quads):
    data = grid(quads)
    assert len(data.polygons) > steady_tangents.PARALLEL
    found = {read(data).tobytes() for _ in range(4)}
    assert len(found) == 1
    found, expected = read(data)[:, :3], of_blender(data)
    assert np.abs(found - expected).max() < ROUNDED
    assert not np.array_equal(found, expected)  # or nothing was added up again


def test_small_meshes_are_steady_in_blender():
    """The reason for PARALLEL."""
    data = grid(1.0, 100)
    assert len(data.polygons) == steady_tangents.PARALLEL
    assert len({of_blender(data).tobytes() for _ in range(6)}) == 1


def test_corners_that_differ_for_another_reason_stay():
    data = grid(0.5)
    before = of_blender(data)
    before[:7] = [0.6, 0.8, 0.0]
    before[9] = np.nan
    mesh = mesh_reader.surface(data, "UVMap", "grid", np.eye(4))
    tangents = np.concatenate([before, np.ones((len(before), 1), np.float32)], axis=1)
    found = steady_tangents.steady(
        tangents,
        positions=mesh.positions[mesh.vertices],
        normals=mesh.normals,
        uv=mesh.uv,
        starts=mesh_reader.face_values(data, "loop_start"),
        sizes=mesh_reader.face_values(data, "loop_total"),
    )
    assert np.array_equal(found[[*range(7), 9]], tangents[[*range(7), 9]], equal_nan=True)
    assert np.array_equal(found[:, 3], tangents[:, 3])
