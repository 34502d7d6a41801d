# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the gradient map by closed form: from 0 to 1 along an axis of the low mesh's box."""

import numpy as np
import pytest
from mathutils import Euler, Matrix

from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 32
MATRIX = Matrix.LocRotScale((1.0, 2.0, 3.0), Euler((0.3, 0.5, 0.7)), (1.0, 2.0, 0.5))
CORNERS = np.array([(x, y, 0.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
HEIGHT = 0.25


def gradient(low, high, axis, **settings):
    """The texels (SIDE, SIDE) of the map."""
    report, found = maps.bake_all_maps(low, high, maps=["GRADIENT"], size=SIDE, gradient_axis=axis, **settings)
    assert (found["gradient"][..., 3] > 0).all()
    assert np.ptp(found["gradient"][..., :3], axis=-1).max() == 0.0
    return found["gradient"][..., 0]


def pair():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    low.matrix_world, high.matrix_world = MATRIX, MATRIX @ Matrix.Translation((0.0, 0.0, HEIGHT))
    return low, high


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
@pytest.mark.parametrize("axis", "XYZ")
def test_values_run_from_end_to_end_of_the_low_mesh(axis, space, samples):
    at = "XYZ".index(axis)
    matrix = np.array(MATRIX) if space == "WORLD" else np.eye(4)
    points = np.dstack([2 * maps.texel_uv(SIDE, SIDE) - 1, np.full((SIDE, SIDE), HEIGHT)])
    ends, along = (each @ matrix[at, :3] for each in (CORNERS, points))
    # The plane has no extent along its own z.
    expected = ((along - ends.min()) / (np.ptp(ends) or np.inf)).clip(0.0, 1.0)
    found = gradient(*pair(), axis, space=space, samples=samples)
    # The mean of clamped values differs from the clamped mean where samples of a texel are on both sides of an end.
    assert np.abs(found - expected).max() < (1e-5 if samples == 1 else 0.01)


def test_a_low_mesh_without_an_extent_is_black():
    """A wall, whose depth is only what rounding makes of none."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    wall = Matrix.LocRotScale((0.1, 0.2, 0.3), Euler((np.pi / 2, 0.0, 0.7)), None)
    low.matrix_world = high.matrix_world = Matrix.Rotation(-0.7, 4, "Z") @ wall
    with np.errstate(all="raise"):
        assert not gradient(low, high, "Y", space="WORLD").any()


def test_a_packed_channel_holds_it():
    more = {"pack": "CUSTOM", "pack_red": "GRADIENT", "gradient_axis": "X"}
    _, found = maps.bake_all_maps(*pair(), maps=[], size=SIDE, **more)
    assert np.abs(found["packed"][..., 0] - maps.texel_uv(SIDE, SIDE)[..., 0]).max() < 1e-5
