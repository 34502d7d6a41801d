# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that divided triangles cover their parents once."""

import numpy as np
import pytest

from addon.mesh import subdividing

CORNERS = np.array([(0, 0), (4, 0), (0, 2), (5, 5), (5, 6), (7, 5)], np.float32)
TRIANGLES = np.array([(0, 1, 2), (3, 4, 5)])


def doubled_areas(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


@pytest.mark.parametrize("counts", [(1, 1), (2, 5), (7, 1), (3, 3)])
def test_pieces_are_equal_and_fill_their_triangle(counts):
    pieces = subdividing.divide(np.array(counts))
    points = pieces.interpolate(CORNERS, TRIANGLES)
    areas, parents = doubled_areas(points, pieces.triangles), pieces.parents[pieces.triangles]
    for number, (count, whole) in enumerate(zip(counts, doubled_areas(CORNERS, TRIANGLES), strict=True)):
        own = areas[(parents == number).all(axis=1)]
        assert len(own) == count**2
        assert np.allclose(own, whole / count**2, rtol=1e-4)  # equal areas of the same sign
    assert len(areas) == sum(count**2 for count in counts)


def test_corners_stay_where_they_are():
    pieces = subdividing.divide(np.array([4, 2]))
    points = pieces.interpolate(CORNERS, TRIANGLES)
    assert {tuple(corner) for corner in CORNERS} <= {tuple(point) for point in points}


def test_nothing_has_no_pieces():
    pieces = subdividing.divide(np.zeros(0, int))
    assert len(pieces.triangles) == len(pieces.interpolate(CORNERS, TRIANGLES)) == 0
