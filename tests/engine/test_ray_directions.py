# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the width of the blend along hard edges."""

import bpy
import pytest

from addon.core.settings import Settings
from addon.core.timings import Timings
from addon.engine.rays import ray_directions
from addon.engine.rays.tree_cache import TreeCache
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def width(low, high) -> float:
    """The width of the blend, in scene units."""
    bpy.context.view_layer.update()
    meshes = reading.read(bpy.context, low, [high], None, Settings(method="CAST"))
    trees = TreeCache()
    scene = trees.ray_scene_of(meshes.highs, Timings())
    low_surface = trees.low_surface_of(meshes.low, scene.local_space, Timings())
    directions = ray_directions.choose("BLENDED", meshes, low_surface, scene.tables)
    return directions.blend_width * scene.local_space.size


def test_hard_edges_that_the_high_mesh_shares_have_a_narrow_blend():
    """A width of 0 would mean smooth directions everywhere."""
    assert 0.0 < width(zoo.cube("lo"), zoo.cube("hi")) < 1e-3


def test_the_blend_is_as_wide_as_bevels():
    """The bevel's width is where it meets the faces; the edge itself recedes by less."""
    high = zoo.cube("hi")
    bevel = high.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.1, 8
    assert 0.05 < width(zoo.cube("lo"), high) < 0.3
