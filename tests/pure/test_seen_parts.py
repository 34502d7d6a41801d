# SPDX-License-Identifier: GPL-3.0-or-later
"""What stays of a surface of which some triangles are hidden: borders by closed forms, on grids and on random triangles."""

import numpy as np
import pytest

from addon.mesh.seen_parts import kept
from addon.mesh.topology import EdgeTable


def grid(columns, rows, height=lambda x, y: 0.0 * x):
    """Squares of side 1 as two triangles each: points (V, 3), triangles (T, 3), and their middles (T, 3)."""
    y, x = np.divmod(np.arange((columns + 1) * (rows + 1)), columns + 1)
    points = np.stack([x, y, height(x, y)], axis=1).astype(float)
    j, i = np.divmod(np.arange(columns * rows), columns)
    first = j * (columns + 1) + i
    ahead, above = first + 1, first + columns + 1
    triangles = np.concatenate([np.stack([first, ahead, above], axis=1), np.stack([ahead, above + 1, above], axis=1)])
    return points, triangles, points[triangles].mean(axis=1)


def border(points, triangles, stays):
    """The ends (N, 2, 3) of edges between what stays and what does not."""
    one, other = (side // 3 for side in EdgeTable.of(triangles).pairs)
    table = EdgeTable.of(triangles)
    return points[table.ends[table.counts == 2][stays[one] != stays[other]]]


@pytest.mark.parametrize("height", [lambda x, y: 0.0 * x, lambda x, y: 0.02 * x**2], ids=["flat", "bent"])
def test_the_teeth_of_a_row_stay_or_go_together(height):
    """Of the fourth column of ten, every other triangle is seen."""
    points, triangles, middles = grid(10, 6, height)
    is_seen = middles[:, 0] < 3.5
    assert np.ptp(border(points, triangles, is_seen)[..., 0]) == 1.0  # teeth
    stays = kept(points, triangles, is_seen)
    assert np.array_equal(stays, middles[:, 0] < 4.0)


def test_a_straight_border_does_not_move():
    points, triangles, middles = grid(10, 6)
    is_seen = middles[:, 0] < 3.0
    assert np.array_equal(kept(points, triangles, is_seen), is_seen)


@pytest.mark.parametrize(("column", "is_whole"), [(5, False), (6, True)])
def test_a_plane_stays_whole_if_more_than_half_of_it_is_seen(column, is_whole):
    points, triangles, middles = grid(10, 6)
    is_seen = middles[:, 0] < column
    assert np.array_equal(kept(points, triangles, is_seen), is_seen | is_whole)


def test_a_hidden_side_behind_sharp_edges_does_not_stay():
    """Of a cube of two triangles a side, the lower side is hidden, and each of its triangles has two sides beside it that
    are seen."""
    points = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)], float)
    quads = np.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    is_seen = np.tile(np.arange(6) > 0, 2)
    assert np.array_equal(kept(points, triangles, is_seen), is_seen)


def test_a_border_does_not_run_around_a_fan():
    """Each spoke is 2 % shorter than the one before."""
    angles, lengths = np.linspace(0.0, 1.5 * np.pi, 40), 0.98 ** np.arange(40)
    rim = lengths[:, None] * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    points = np.concatenate([[(0.0, 0.0, 0.0)], rim])
    triangles = np.stack([np.zeros(39, int), np.arange(1, 40), np.arange(2, 41)], axis=1)
    is_seen = np.arange(39) < 3
    assert np.array_equal(kept(points, triangles, is_seen), is_seen)


def test_all_or_nothing_that_is_seen_stays_as_it_is():
    points, triangles, middles = grid(2, 2)
    for is_seen in (np.ones(len(middles), bool), np.zeros(len(middles), bool)):
        assert np.array_equal(kept(points, triangles, is_seen), is_seen)
