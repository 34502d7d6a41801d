# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the width of the blend along hard edges."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core import progress
from addon.core.progress import Timings
from addon.core.settings import Settings
from addon.engine import coverage, ray_casting, ray_distances, tree_cache
from addon.engine.tree_cache import TreeCache
from addon.jobs import bake_pair
from addon.mesh import subdividing
from addon.mesh.local_space import local_space_of
from addon.passes import cast, rays, target
from addon.scene import reading
from tests.support import maps, zoo
from tests.support.raster import unit

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


# Ray points


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


# Ray slices


SIZE = 256
RAYS = {"method": "CAST", "size": (SIZE, SIZE), "space": "OBJECT"}


@pytest.fixture
def slow(monkeypatch):
    """A GPU that takes 0.05 s for each row. Returns a list of the slices, as ranges of rows."""
    clock, given, trace, finish = SimpleNamespace(now=0.0, left=0.0), [], cast.trace, target.Target.finish

    def slow_trace(into, rays, *arguments, rows=None, **options):
        given.append(range(rays.height) if rows is None else rows)
        clock.left += 0.05 * len(given[-1])
        trace(into, rays, *arguments, rows=rows, **options)

    def slow_finish(self):
        clock.now, clock.left = clock.now + clock.left, 0.0  # drivers start their work later
        finish(self)

    monkeypatch.setattr(progress, "SLOWEST", 1e4)  # the first slice is as small as slices are
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    monkeypatch.setattr(cast, "trace", slow_trace)
    monkeypatch.setattr(target.Target, "finish", slow_finish)
    tree_cache.trees.free()
    return given


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("samples", [1, 4])
def test_slices_do_not_change_the_map(slow, monkeypatch, samples):
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    sliced = maps.bake(low, high, **RAYS, samples=samples)
    assert len(slow) > 16
    monkeypatch.setattr(progress, "SLOWEST", 1e12)  # the first slice is the whole map
    assert np.array_equal(sliced, maps.bake(low, high, **RAYS, samples=samples))
    assert len(np.unique(sliced)) > 1000


@pytest.mark.usefixtures("gpu_context")
def test_probes_for_distances_and_checks_are_sliced_too(slow):
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    settings = Settings(method="CAST", width=SIZE, height=SIZE, image="map", storage="MEMORY", material=False)
    bake_pair(bpy.context, low, [high], settings)
    # Both sides of the low mesh, as it has few faces; the distances, parts that stand off, and surfaces beyond the rays; then
    # the map; then the checks on some of its texels: hits, and other layers of the low mesh on both sides.
    starts = [rows.start for rows in slow].count(0)
    assert starts == 9
    assert max(map(len, slow)) < coverage.SAMPLES_A_SIDE, "the map or a probe was drawn at once"
