# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that rays at single points are those that a bake casts there."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.engine import ray_casting, tree_cache
from addon.mesh import subdividing
from addon.mesh.local_space import local_space_of
from addon.passes import rays
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

WIDTH = 0.5
PARTS = 8


def read(low, cage=None, **settings):
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return reading.read_low(depsgraph, low, cage, Settings(**settings), is_own_base=False, with_uv=False)


def evaluate(meshes, parts=PARTS, **options):
    """The points, and the local space. options: of rays.Directions; the width is in scene units."""
    local_space = local_space_of([meshes.low])
    width = options.pop("blend_width", 0.0) / local_space.size
    directions = rays.Directions(
        tree_cache.build_low_surface(meshes.low, local_space).edges, blend_width=width, **options
    )
    pieces = subdividing.divide(np.full(len(meshes.low.triangles), parts))
    return ray_casting.rays_at_points(meshes, pieces, local_space, directions, extrusion=1.0), pieces, local_space


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_directions_blend_from_hard_edges_inwards():
    """On the cube -1..1, a point's smooth normal is interpolated between the corners, and its edge the nearest side."""
    found, pieces, space = evaluate(read(zoo.cube("lo")), blend_width=WIDTH)
    points = found.places * space.size + space.origin
    meshes = read(bpy.data.objects["lo"])
    faces = unit(pieces.interpolate(meshes.low.normals, meshes.low.triangles))
    corners = meshes.low.positions[meshes.low.vertices] / np.sqrt(3.0)
    smooth = unit(pieces.interpolate(corners.astype(np.float32), meshes.low.triangles))
    edge = (
        1.0 - np.sort(np.abs(points), axis=1)[:, 1]
    )  # the largest coordinate is the face's, the next one the nearest edge's
    step = np.clip(edge / WIDTH, 0.0, 1.0)
    share = (step * step * (3.0 - 2.0 * step))[:, None]
    assert 0.0 < share.mean() < 1.0
    assert np.abs(found.directions - unit(smooth * (1.0 - share) + faces * share)).max() < 1e-5
    assert np.allclose(found.starts, 1.0)


def test_painted_points_start_elsewhere():
    low = zoo.plane("lo", n=2)
    group = low.vertex_groups.new(name="far")
    for vertex in low.data.vertices:
        group.add([vertex.index], 0.5 + 0.5 * vertex.co.x, "REPLACE")
    found, _, space = evaluate(read(low, offset_group="far", method="CAST"))
    assert np.allclose(found.starts, 1.0 + found.places[:, 0] * space.size + space.origin[0], atol=1e-6)
    assert np.allclose(found.directions, (0, 0, 1))


def test_with_a_cage_rays_start_on_it():
    low, cage = zoo.plane("lo", n=2), zoo.plane("cage", n=2)
    cage.location.z, cage.scale = 0.5, (2.0, 2.0, 1.0)
    found, _, space = evaluate(read(low, cage))
    starts = found.places * space.size + space.origin
    reached = starts + found.directions * found.starts[:, None] * space.size
    assert np.allclose(reached, starts * (2.0, 2.0, 1.0) + (0, 0, 0.5), atol=1e-5)


@pytest.mark.parametrize("parts", [1, 2, 40])
def test_each_point_has_a_texel_of_its_own(parts):
    """Neighboring points differ, and none is read from the texel of another."""
    low = zoo.sphere("lo", n=8)
    meshes = read(low)
    found, pieces, _ = evaluate(meshes, parts)
    expected = unit(pieces.interpolate(meshes.smooth_normals, meshes.low.triangles))
    assert np.abs(found.directions - expected).max() < 1e-5
