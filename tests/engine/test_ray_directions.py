# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the width of the blend along hard edges."""

import bpy
import pytest

from addon.core.progress import Timings
from addon.core.settings import Settings
from addon.engine import ray_distances
from addon.engine.tree_cache import TreeCache
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def width(low, *highs) -> float:
    """The width of the blend, in scene units."""
    bpy.context.view_layer.update()
    meshes = reading.read(bpy.context, low, highs, None, Settings(method="CAST"))
    trees = TreeCache()
    scene = trees.ray_scene_of(meshes.highs, Timings())
    low_surface = trees.low_surface_of(meshes.low, scene.local_space, Timings())
    directions = ray_distances.choose_directions("BLENDED", meshes, low_surface, scene.tables)
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


def test_what_lies_farther_out_along_hard_edges_does_not_count():
    """A larger cube around both: the nearest surface is the one that has the bevels."""
    shell = zoo.cube("shell")
    shell.scale = (1.5, 1.5, 1.5)
    assert 0.0 < width(zoo.cube("lo"), zoo.cube("hi"), shell) < 1e-3


def test_rays_do_not_cross_where_the_high_mesh_is_far_from_a_few_hard_edges():
    """Four of twelve edges recede by 0.42 along their rays: on a narrow blend, rays would cross there."""
    high = zoo.cube("hi")
    high.scale.x, high.location.x = 0.85, -0.15
    assert width(zoo.cube("lo"), high) > 0.6


@pytest.mark.parametrize(("n", "bends"), [(24, False), (8, True)])
def test_flat_shading_alone_makes_no_hard_edges(n, bends):
    """Where all faces are flat, only edges that bend by more than 30 degrees are features of the shape."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=n, ring_count=n)
    low = bpy.context.object
    assert (width(low, zoo.sphere("hi", 48)) > 0.0) == bends
