# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what coarser meshes keep of a UV layout: vertices on borders, and UVs that may move."""

import numpy as np

from addon.mesh import coarser_uvs

SIDE = 5


def grid():
    """A flat grid of SIDE x SIDE vertices: vertices (C,), triangles (T, 3) and UVs (C, 2). Each corner is of one triangle."""
    row, column = np.mgrid[0 : SIDE - 1, 0 : SIDE - 1].reshape(2, -1)
    a = row * SIDE + column
    quads = np.stack([a, a + 1, a + SIDE + 1, a + SIDE], axis=1)
    vertices = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).reshape(-1).astype(np.int32)
    uv = np.stack([vertices % SIDE, vertices // SIDE], axis=1).astype(np.float32) / (SIDE - 1)
    return vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3), uv


def inside():
    """Which vertices of the grid are not on its edge."""
    result = np.zeros((SIDE, SIDE), bool)
    result[1:-1, 1:-1] = True
    return result.reshape(-1)


def test_the_edge_of_a_surface_is_kept():
    vertices, triangles, uv = grid()
    kept = coarser_uvs.kept_vertices(vertices, triangles, [uv], np.zeros(len(triangles), np.int32))
    assert (kept == ~inside()).all()


def test_a_seam_is_kept_with_its_end():
    vertices, triangles, uv = grid()
    # Cut along the middle row, from the left edge to its middle: the vertex in the middle ends the seam.
    above = (uv[triangles].mean(axis=1)[:, 1] > 0.5).repeat(3)
    on_cut = (vertices // SIDE == SIDE // 2) & (vertices % SIDE < SIDE // 2)
    torn = uv + np.where(above & on_cut, 0.01, 0.0)[:, None].astype(np.float32)
    kept = coarser_uvs.kept_vertices(vertices, triangles, [torn], np.zeros(len(triangles), np.int32))
    middle = SIDE // 2 * SIDE
    expected = ~inside()
    expected[middle : middle + SIDE // 2 + 1] = True
    assert (kept == expected).all()


def test_seams_of_each_layer_are_kept():
    vertices, triangles, uv = grid()
    other = uv.copy()
    other[vertices >= SIDE * SIDE // 2] += 0.0
    other[:3] += 0.5
    kept = coarser_uvs.kept_vertices(vertices, triangles, [uv, other], np.zeros(len(triangles), np.int32))
    assert kept[vertices[:3]].all()


def test_borders_of_materials_are_kept():
    vertices, triangles, uv = grid()
    labels = (uv[triangles].mean(axis=1)[:, 0] > 0.5).astype(np.int32)
    kept = coarser_uvs.kept_vertices(vertices, triangles, [uv], labels)
    assert (kept == (~inside() | (np.arange(SIDE * SIDE) % SIDE == SIDE // 2))).all()


def test_edges_of_three_triangles_are_kept():
    vertices, triangles, uv = grid()
    middle = SIDE * SIDE // 2
    fin = np.array([middle, middle + 1, SIDE * SIDE], np.int32)  # on an edge inside the grid
    vertices, triangles = np.append(vertices, fin), np.append(triangles, [[len(uv) + i for i in range(3)]], axis=0)
    uv = np.concatenate([uv, np.stack([fin % SIDE, fin // SIDE], axis=1).astype(np.float32) / (SIDE - 1)])
    kept = coarser_uvs.kept_vertices(vertices, triangles, [uv], np.zeros(len(triangles), np.int32))
    assert kept[[middle, middle + 1]].all()


def moved(vertex, by):
    """The grid with the UVs of one vertex moved, as uv_moves.accepted returns them, and whether the move was accepted."""
    vertices, triangles, uv = grid()
    after = uv + np.where(vertices == vertex, 1.0, 0.0)[:, None] * np.float32(by)
    result = coarser_uvs.moved_uvs(uv, after.astype(np.float32), vertices, triangles, ~inside())
    assert ((result == uv).all(axis=1) | (vertices == vertex)).all()
    return bool((result != uv).any())


def test_small_moves_inside_are_accepted():
    assert moved(SIDE * SIDE // 2, (0.05, -0.03))


def test_moves_are_accepted_up_to_half_of_the_longest_edge():
    """No triangle folds: the next vertex is 0.25 away. The longest edge at the vertex is a diagonal."""
    reach = 0.5 * 0.25 * np.sqrt(2.0)
    assert moved(SIDE * SIDE // 2, (0.99 * reach, 0.0))
    assert not moved(SIDE * SIDE // 2, (1.01 * reach, 0.0))


def test_vertices_on_borders_do_not_move():
    assert not moved(0, (0.05, 0.03))


def test_moves_that_fold_are_taken_back_and_others_stay():
    """A vertex moves past an edge of its neighbor's triangles, and by less than half of a long edge beside it."""
    vertices, triangles, uv = grid()
    uv[:, 1] *= 4.0
    middle = SIDE * SIDE // 2
    after = uv.copy()
    after[vertices == middle] += (0.3, 0.0)
    after[vertices == middle - SIDE - 1] += (0.02, 0.0)  # no triangle has both
    result = coarser_uvs.moved_uvs(uv, after, vertices, triangles, ~inside())
    assert (result[vertices == middle] == uv[vertices == middle]).all()
    assert (result[vertices == middle - SIDE - 1] == after[vertices == middle - SIDE - 1]).all()


def test_moves_to_another_island_are_taken_back():
    """All vertices inside move by the same distance, so that only the triangles at the edge change."""
    vertices, triangles, uv = grid()
    after = uv.copy()
    free = inside()[vertices]
    after[free] = 0.5 + 0.45 * (uv[free] - 0.5)  # no triangle turns over
    result = coarser_uvs.moved_uvs(uv, after, vertices, triangles, ~inside())
    assert (result != uv).any()
    far = uv.copy()
    far[free, 0] += 5.0
    turned = coarser_uvs.moved_uvs(uv, far, vertices, triangles, ~inside())
    assert (turned == uv).all()


def test_corners_of_a_vertex_move_together():
    vertices, triangles, uv = grid()
    after = uv.copy()
    after[np.flatnonzero(vertices == SIDE * SIDE // 2)[0]] += 0.02
    assert (coarser_uvs.moved_uvs(uv, after, vertices, triangles, ~inside()) == uv).all()
