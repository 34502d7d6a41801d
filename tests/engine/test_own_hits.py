# SPDX-License-Identifier: GPL-3.0-or-later
"""What places on a low mesh show of the high meshes."""

import bpy
import numpy as np
import pytest

from addon.core.progress import Timings
from addon.core.settings import Settings
from addon.engine import own_hits
from addon.jobs import Job
from addon.jobs.job import Request, read_meshes
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def read(low, *highs):
    bpy.context.view_layer.update()
    return read_meshes(bpy.context, Request(Job(low, highs), Settings(method="CAST")))


def test_places_cover_the_area_evenly():
    """Each cell of a plane has as many places as its share of the area."""
    places = own_hits.LowPlaces.of(read(zoo.plane("lo", 3), zoo.terrain("hi", 4)), 1024)
    points = places.points(own_hits.local_space_of([places.mesh]))
    cells = np.histogram2d(*points[:, :2].T, bins=4, range=[[points.min(), points.max()]] * 2)[0]
    assert cells.min() >= 0.9 * 1024 / 16 and cells.max() <= 1.1 * 1024 / 16


@pytest.mark.parametrize("is_aside", [False, True])
def test_a_right_low_mesh_owns_hits_and_a_turned_one_does_not(is_aside):
    low, high = zoo.plane("lo"), zoo.terrain("hi", 16)
    high.location.x = 20.0 * is_aside
    assert own_hits.shares_of_sides(read(low, high), Timings()) == (1.0, 0.0)
    low.data.flip_normals()
    assert own_hits.shares_of_sides(read(low, high), Timings()) == (0.0, 1.0)


def test_a_plane_through_the_middle_of_bricks_is_judged_by_what_its_rays_hit():
    """The nearest face of a brick is as often its back."""
    low, bricks = zoo.plane("lo"), []
    for number, (x, y) in enumerate(((-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5))):
        brick = zoo.cube(f"brick {number}")
        brick.scale, brick.location = (0.45, 0.45, 0.02), (x, y, -0.004)
        bricks.append(brick)
    as_is, turned = own_hits.shares_of_sides(read(low, *bricks), Timings())
    assert as_is == turned > 0.7  # from below, it is as right a low mesh
