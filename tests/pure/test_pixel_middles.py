# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that cover the middle of a pixel, against edge functions in float64."""

import numpy as np
import pytest

from addon.mesh.pixel_middles import MOST, Triangles

COUNT = 300


def scattered(size, side, seed=1):
    """The corners (3 T, 3) of triangles that are about so many pixels large, and a view (4, 4) that turns them."""
    dice = np.random.default_rng(seed)
    middles = dice.uniform(-0.5, 0.5, (COUNT, 1, 3))
    corners = middles + dice.normal(0.0, size / side, (COUNT, 3, 3))
    view = np.eye(4)
    view[:3, :3] = np.linalg.qr(dice.normal(size=(3, 3)))[0]
    return corners.reshape(-1, 3).astype(np.float32), view


def pixels_of(points, view, side):
    """Where corners are on the picture, (T, 3, 2) in pixels."""
    clip = points.astype(np.float64) @ view[:3, :3].T + view[:3, 3]
    return ((0.5 * clip[:, :2] + 0.5) * side).reshape(-1, 3, 2)


def covering(corners):
    """Which triangles (T, 3, 2) cover the middle of a pixel."""
    result = np.zeros(len(corners), bool)
    for number, triangle in enumerate(corners):
        least, most = np.floor(triangle.min(axis=0)), np.ceil(triangle.max(axis=0))
        x, y = np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(least, most, strict=True)))
        ends = np.roll(triangle, -1, axis=0)
        sides = [(b - a)[0] * (y - a[1]) - (b - a)[1] * (x - a[0]) for a, b in zip(triangle, ends, strict=True)]
        result[number] = (np.all(np.array(sides) > 0.0, axis=0) | np.all(np.array(sides) < 0.0, axis=0)).any()
    return result


@pytest.mark.parametrize("side", [40, 512, MOST])
@pytest.mark.parametrize("size", [0.05, 0.3, 1.0, 30.0])
def test_no_triangle_is_missing_that_shows_in_a_picture(side, size):
    points, view = scattered(size, side)
    found = Triangles(points, np.arange(len(points)).reshape(-1, 3)).at_middles(view, side)
    assert np.isin(np.flatnonzero(covering(pixels_of(points, view, side))), found).all()
    assert (np.diff(found) > 0).all()


def test_few_others_are_drawn():
    """Those alone whose box holds the middle of a pixel, or nearly so: 0.03 pixels further than its own size."""
    side = 512
    points, view = scattered(0.2, side)
    found = Triangles(points, np.arange(len(points)).reshape(-1, 3)).at_middles(view, side)
    corners = pixels_of(points, view, side)
    first, last = np.ceil(corners.min(axis=1) - 0.55), np.floor(corners.max(axis=1) - 0.45)
    assert (first <= last)[found].all()
    assert len(found) < 0.5 * COUNT


@pytest.mark.parametrize("off", [-0.007, 0.0, 0.007])
@pytest.mark.parametrize("size", [1.0, 0.01])
def test_corners_near_a_middle_are_taken_for_ones_on_it(off, size):
    """Drivers round corners to 1 / 256 of a pixel or less exactly."""
    side, place = 64, (10.5, 20.5)
    corners = np.array(place) + size * np.array([(0.0, 0.0), (0.2, 0.1), (0.1, 0.3)]) + off
    points = np.zeros((3, 3), np.float32)
    points[:, :2] = 2.0 * corners / side - 1.0
    assert Triangles(points, np.array([[0, 1, 2]])).at_middles(np.eye(4), side).tolist() == [0]


def test_vertices_that_no_triangle_uses_change_nothing():
    points, view = scattered(0.5, 64)
    triangles = np.arange(len(points)).reshape(-1, 3)
    alone = Triangles(points, triangles).at_middles(view, 64)
    more = np.concatenate([np.full((7, 3), 9.0, np.float32), points])
    assert np.array_equal(Triangles(more, triangles + 7).at_middles(view, 64), alone)
