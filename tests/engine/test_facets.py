# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests ambient occlusion of coarse meshes that are shaded smooth, where normals lean against the faces."""

import pytest

from tests.support import zoo
from tests.support.maps import bake_all_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDES = 8
LEAN = 180.0 / (2 * SIDES)
"""Degrees between faces and normals at the corners of a ball, roughly."""
STEP = 1.0 / 255


def occlusion(bias_angle):
    """The values of a coarse ball, which nothing hides: rays are blocked only below the face that they start from."""
    _, maps = bake_all_maps(zoo.sphere("lo", SIDES), zoo.sphere("hi", SIDES), maps=["AO"], bias_angle=bias_angle)
    return maps["ao"][maps["ao"][..., 3] == 1.0, 0]


def test_a_coarse_mesh_shows_its_facets():
    assert 1.0 - occlusion(0).min() > STEP
    assert occlusion(0).max() > 1.0 - STEP / 2


def test_a_bias_angle_hides_facets():
    assert (occlusion(int(2 * LEAN)) == 1.0).all()
