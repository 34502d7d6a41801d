# SPDX-License-Identifier: GPL-3.0-or-later
"""A high mesh that stands off the low one: rays start outside of it by themselves, and a sentence names the extrusion."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from tests.support import angles, maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 24
"""Texels of a map."""
SAME = 0.5
"""Degrees between a map from afar and the one from close by: rays meet other places by the rounding of their starts."""


def bricks(n=3, thick=0.2):
    """Closed boxes in z = -thick to thick, each turned a little."""
    parts = []
    for number in range(n * n):
        parts.append(zoo.cube(f"brick {number}"))
        parts[-1].scale = (0.96 / n, 0.9 / n, thick)
        parts[-1].location = (-1 + (number % n + 0.5) * 2 / n, -1 + (number // n + 0.5) * 2 / n, 0.0)
    return parts


def baked(low, *highs, **settings):
    bpy.context.view_layer.update()
    report = scenes.bake(low, *highs, method="CAST", size=SIDE, **settings)
    texels = maps.pixels(bpy.data.images[report.image])
    return report, angles.decode(texels), texels[..., 3] > 0.0


@pytest.mark.parametrize(("thick", "behind"), [(0.02, 0.1), (0.1, 0.2), (0.2, 0.1), (0.5, 0.2)])
def test_rays_start_outside_of_bricks_before_the_low_mesh(thick, behind):
    """As from a low mesh in the middle of the bricks: their fronts, and not their backs from inside."""
    low, parts = zoo.plane("lo"), bricks(thick=thick)
    for number, part in enumerate(parts):
        part.rotation_euler = (0.02 * np.sin(number), 0.02 * np.cos(number), 0.0)
    low.location.z = thick
    _, truth, is_known = baked(low, *parts)
    low.location.z = -thick - behind
    report, found, is_found = baked(low, *parts)
    both = angles.eroded(is_known & is_found, 1)
    assert both.mean() > 0.3
    assert report.distances["extrusion"] > behind + 2.0 * thick
    assert np.percentile(angles.degrees(found, truth)[both], 95) < SAME
    assert "set an extrusion from which rays start outside of them" in report.warnings[0]


@pytest.mark.parametrize("far", [0.5, 0.8, 1.9])
def test_a_card_far_in_front_is_baked_with_a_warning(far):
    low, high = zoo.plane("lo"), zoo.terrain("hi", 16, height=0.05)
    _, truth, _ = baked(low, high)
    high.location.z = far
    report, found, is_known = baked(low, high)
    assert is_known.all()
    assert angles.degrees(found, truth).max() < SAME
    (warning,) = report.warnings
    assert "differ in place or size" in warning
    assert "extrusion" in warning


@pytest.mark.parametrize("settings", [{"extrusion": 8.0}, {"extrusion": 8.0, "max_distance": 9.0}])
def test_distances_that_are_set_are_never_too_far(settings):
    low, high = zoo.plane("lo"), zoo.terrain("hi", 16, height=0.05)
    high.location.z = 7.0
    with pytest.raises(BakeError, match="do not overlap: they are"):
        baked(low, high)
    assert baked(low, high, **settings)[2].all()


def test_objects_side_by_side_are_refused_as_before():
    low, high = zoo.cube("lo"), zoo.cube("hi")
    high.location.x = 3.2
    with pytest.raises(BakeError, match="they are 1.2 m apart"):
        baked(low, high)


def test_rays_that_are_too_short_say_so():
    low, high = zoo.plane("lo"), zoo.terrain("hi", 16, height=0.05)
    high.location.z = 0.5
    with pytest.raises(BakeError, match="without --extrusion and"):
        baked(low, high, extrusion=0.05, max_distance=0.1)
