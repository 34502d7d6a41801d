# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which triangles of a drawn mesh count as changed, and which boxes and parts of the map they touch."""

from dataclasses import replace

import numpy as np
import pytest

from addon.engine import live_redraw
from addon.engine.bands import Band
from addon.engine.live_redraw import DrawnMesh, Part, parts_of
from addon.mesh.triangle_mesh import Mesh

COUNT = 3 * DrawnMesh.BLOCK + 17


def random_mesh(seed, count=COUNT):
    """Small triangles with corners of their own, anywhere in the UV square, from left to right."""
    random = np.random.default_rng(seed)
    middles = random.random((count, 1, 2))
    uv = middles[middles[:, 0, 0].argsort()] + random.normal(0.0, 0.01, (count, 3, 2))
    corners = np.arange(3 * count, dtype=np.int32)
    return Mesh(
        "some",
        np.zeros((3 * count, 3), np.float32),
        corners,
        random.normal(size=(3 * count, 3)).astype(np.float32),
        corners.reshape(-1, 3),
        np.eye(4),
        uv=uv.reshape(-1, 2).astype(np.float32),
    )


def with_other_normals(mesh, triangles):
    normals = mesh.normals.copy()
    normals[mesh.triangles[triangles, 1]] += 1.0
    return replace(mesh, normals=normals)


def with_other_corners(mesh, triangles, others):
    """`triangles` have the corners of `others`."""
    found = mesh.triangles.copy()
    found[triangles] = mesh.triangles[others]
    return replace(mesh, triangles=found)


def boxes(mesh):
    corners = mesh.uv[mesh.triangles]
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)


def in_box(mesh, box):
    """The triangles that meet `box`, each looked at by itself."""
    found = boxes(mesh)
    meets = (found[:, :2] <= box[2:]).all(axis=1) & (found[:, 2:] >= box[:2]).all(axis=1)
    return mesh.uv[mesh.triangles[meets]].reshape(-1, 2)


BOXES = np.array([(0.1, 0.2, 0.3, 0.25), (0.0, 0.0, 1.0, 1.0), (0.7, 0.7, 0.71, 0.9)])


def test_random_triangles_with_other_normals_and_their_boxes_seed_1():
    mesh = random_mesh(1)
    drawn = DrawnMesh(mesh)
    moved = with_other_normals(mesh, [5, 2000, 3000])
    changed = drawn.changed(moved)
    assert changed.tolist() == [5, 2000, 3000]
    np.testing.assert_array_equal(drawn.replace(moved, changed), boxes(mesh)[changed])
    assert drawn.mesh is moved
    assert len(drawn.changed(moved)) == 0


def test_random_triangles_with_other_corners_change_where_they_were_and_where_they_are_seed_2():
    mesh = random_mesh(2)
    drawn = DrawnMesh(mesh)
    for box in BOXES:
        np.testing.assert_array_equal(drawn.within(box).uv, in_box(mesh, box))
    other = with_other_corners(mesh, [7, 1500], [2500, 100])
    changed = drawn.changed(other)
    assert changed.tolist() == [7, 1500]
    found = drawn.replace(other, changed)
    np.testing.assert_array_equal(found, np.concatenate([boxes(mesh)[changed], boxes(other)[changed]]))
    for box in [*BOXES, *boxes(other)[changed], *boxes(mesh)[changed]]:
        np.testing.assert_array_equal(drawn.within(box).uv, in_box(other, box))


def test_too_many_changes_are_no_changes_seed_3():
    mesh = random_mesh(3)
    drawn, most = DrawnMesh(mesh), int(live_redraw.MOST_CHANGED * COUNT)
    assert len(drawn.changed(with_other_normals(mesh, range(most)))) == most
    assert drawn.changed(with_other_normals(mesh, range(most + 1))) is None
    assert drawn.changed(with_other_normals(mesh, range(COUNT))) is None
    assert drawn.changed(with_other_corners(mesh, range(most + 1), range(1, most + 2))) is None


@pytest.mark.parametrize("what", ["place", "UVs", "count", "corners"])
def test_other_meshes_have_no_changes_seed_4(what):
    mesh = random_mesh(4)
    other = {
        "place": replace(mesh, to_world=np.diag([2.0, 1, 1, 1])),
        "UVs": replace(mesh, uv=mesh.uv + np.float32(1e-3)),
        "count": replace(mesh, triangles=mesh.triangles[:-1]),
        "corners": replace(mesh, normals=mesh.normals[:-3], triangles=mesh.triangles.clip(max=3 * COUNT - 4)),
    }[what]
    assert DrawnMesh(mesh).changed(other) is None


@pytest.mark.parametrize("what", ["same", "UVs", "corners"])
def test_boxes_of_the_mesh_before_are_kept_only_where_they_are_the_same_seed_5(what):
    mesh = random_mesh(5)
    before = DrawnMesh(mesh)
    before.within(BOXES[0])
    other = {
        "same": replace(mesh, uv=mesh.uv.copy()),
        "UVs": replace(mesh, uv=mesh.uv[::-1].copy()),
        "corners": with_other_corners(mesh, range(COUNT // 2), range(COUNT // 2, 2 * (COUNT // 2))),
    }[what]
    drawn = DrawnMesh(other, before)
    for box in BOXES:
        np.testing.assert_array_equal(drawn.within(box).uv, in_box(other, box))


def test_parts_hold_a_texel_more_on_all_sides():
    side, size = live_redraw.TILE, (64, 64)
    box = np.array([[side, side, 2 * side, 2 * side]]) / 64
    inner = box + np.array([1.5, 1.5, -1.5, -1.5]) / 64
    assert parts_of(inner, size) == [Part(range(side, 2 * side), range(side, 2 * side))]
    outer = box + np.array([0.5, 0.5, -0.5, -0.5]) / 64
    assert parts_of(outer, size) == [Part(range(3 * side), range(3 * side))]


@pytest.mark.parametrize("count", [2, live_redraw.MOST_PARTS, live_redraw.MOST_PARTS + 1])
def test_parts_divide_where_they_are_empty_and_all_become_one_if_they_are_many(count):
    side, size = live_redraw.TILE, (live_redraw.TILE * 2 * count,) * 2
    corners = np.arange(0, 2 * count, 2)[:, None] + np.array([0.3, 0.3, 0.6, 0.6])
    found = parts_of(corners * side / size[0], size)
    single = [range(2 * side * k, 2 * side * k + side) for k in range(count)]
    if count > live_redraw.MOST_PARTS:
        single = [range(single[0].start, single[-1].stop)]
    assert sorted(found, key=lambda part: part.x.start) == [Part(x, x) for x in single]


def test_a_band_shows_its_rows_and_its_halo():
    band = Band(12, 24, (64, 48), 4, tile=1012)
    scale, shift = np.split(np.array(band.uv_to_clip), 2)
    corners = np.array([(1.0, 1.0 + 8 / 48), (2.0, 1.0 + 28 / 48)])
    np.testing.assert_allclose(corners * scale + shift, [[-1, -1], [1, 1]])
