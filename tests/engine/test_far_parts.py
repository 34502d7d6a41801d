# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of the high mesh that stand off farther than rays usually search."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.engine.rays import low_surface, ray_distances
from addon.jobs import bake_pair
from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
DIAGONAL = 8.0**0.5
"""Of the low plane."""
FARTHEST = low_surface.ROOM * ray_distances.FARTHEST_PART * DIAGONAL


def bake(height, **settings):
    """A plane, and above a sixteenth of it a small plate. Returns the heights (SIZE, SIZE) and the report."""
    low, base, plate = zoo.plane("lo", 4), zoo.plane("hi", 4), zoo.plane("plate")
    plate.scale, plate.location = (0.25, 0.25, 1.0), (0.0, 0.0, height)
    bpy.context.view_layer.update()
    values = {"method": "CAST", "maps": ("HEIGHT",), "margin": 0, "depth": 32, "storage": "MEMORY", "material": False}
    report = bake_pair(bpy.context, low, [base, plate], Settings(width=SIZE, height=SIZE, **values | settings))
    return maps.pixels(bpy.data.images[report.maps["height"]["image"]])[..., 0], report


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_a_plate_within_12_percent_of_the_diagonal_is_found(share):
    heights, report = bake(share * FARTHEST)
    stands = np.abs(heights - share * FARTHEST) < 1e-4
    assert np.count_nonzero(stands) == SIZE * SIZE / 16
    assert (np.abs(heights[~stands]) < 1e-4).all()
    assert report.distances["extrusion"] <= FARTHEST * 1.001


def test_the_extrusion_for_far_parts_is_rounded():
    """In the high meshes' local space: GPUs round measurements differently, and all rays start there."""
    height = 0.6 * FARTHEST
    _, report = bake(height)
    extrusion = report.distances["extrusion"] / (np.hypot(DIAGONAL, height) / 2.0)
    assert extrusion == pytest.approx(float(f"{extrusion:.3g}"), rel=1e-6)


def test_a_plate_beyond_them_needs_an_extrusion():
    height = 1.1 * FARTHEST
    assert (np.abs(bake(height)[0]) < 1e-4).all()
    heights, _ = bake(height, extrusion=1.2 * FARTHEST, max_distance=2.0 * FARTHEST)
    assert np.count_nonzero(np.abs(heights - height) < 1e-4) == SIZE * SIZE / 16


def test_without_far_parts_rays_search_the_usual_room():
    _, report = bake(0.0)
    assert report.distances["extrusion"] == pytest.approx(low_surface.ROOM * DIAGONAL, rel=1e-4)


def test_with_a_length_that_is_set_rays_still_reach_what_was_measured_inside():
    heights, report = bake(0.6 * FARTHEST, max_distance=0.02)
    assert report.distances["max_distance"] == pytest.approx(0.02)
    assert (np.abs(heights) < 1e-4).all()
    assert report.missed == 0.0
