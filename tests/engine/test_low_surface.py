# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays need of the low mesh: triangles without area, and the width of the blend of directions."""

from dataclasses import replace

import bpy
import gpu
import numpy as np
import pytest

from addon.core import progress, udim
from addon.core.declarations.choices import Hit
from addon.core.errors import BakeError
from addon.core.progress import Timings
from addon.core.settings import Run, Settings
from addon.engine.baking import draw
from addon.engine.method_choice import Choice
from addon.engine.planning import Plan
from addon.engine.tree_cache import TreeCache
from addon.mesh.local_space import LocalSpace
from addon.passes import target
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def ray_cast(low, high, **values):
    settings = Settings(method="CAST", width=32, height=32, **values)
    plan = Plan(reading.read(bpy.context, low, [high], None, settings), (udim.FIRST,), Choice("CAST"))
    return progress.finish(draw(plan, Run(settings))).ray_cast


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
ACROSS = [(0, 1, 2), (0, 2, 3)]
FLAT = {
    "a line between two triangles": ([*SQUARE, (0.5, 0.5, 0)], [(0, 1, 2), (0, 2, 4), (0, 4, 3), (4, 2, 3)], [1]),
    "two points in one place": ([*SQUARE, (1, 1, 0)], [*ACROSS, (0, 2, 4)], [2]),
    "a needle beside": ([*SQUARE, (1, 0.5, 1e-7)], [*ACROSS, (1, 2, 4)], [2]),
}


@pytest.mark.parametrize("name", FLAT)
def test_walks_from_triangles_without_area_start_from_a_neighbor(name):
    points, triangles, flat = FLAT[name]
    uv = np.random.default_rng(1).random((len(triangles), 3, 2))
    low, high = zoo.build("low", points, triangles, uv), zoo.build("high", SQUARE, ACROSS)
    surface = ray_cast(low, high).low
    assert sorted(surface.numbers) == list(range(1, len(triangles) + 1))
    differs = np.flatnonzero(surface.starts != surface.numbers)
    assert differs.tolist() == flat
    others = np.delete(surface.numbers, flat)
    assert np.isin(surface.starts[flat], others).all()


@pytest.mark.parametrize("turn", range(3))
def test_walks_from_a_line_start_across_its_longest_edge(turn):
    """All of the line lies on that edge, and only half of it on each of the others."""
    points, triangles, (flat,) = FLAT["a line between two triangles"]
    triangles = [*triangles]
    triangles[flat] = (*triangles[flat][turn:], *triangles[flat][:turn])
    low = zoo.build("low", points, triangles, np.random.default_rng(1).random((len(triangles), 3, 2)))
    surface = ray_cast(low, zoo.build("high", SQUARE, ACROSS)).low
    assert surface.starts[flat] == surface.numbers[0]


def test_a_triangle_without_area_and_neighbors_stays_its_own():
    line = [(0.1, 0.3, 0), (0.9, 0.3, 0), (0.5, 0.3, 0)]
    low = zoo.build("low", [*SQUARE, *line], [*ACROSS, (4, 5, 6)], np.random.default_rng(1).random((3, 3, 2)))
    surface = ray_cast(low, zoo.build("high", SQUARE, ACROSS)).low
    assert np.array_equal(surface.starts, surface.numbers)


def clearances(surface):
    """The clearance of each triangle, in the tree's order."""
    texture = surface.owners.corners
    texels = np.empty((texture.height, texture.width, 4), np.float32)
    target.read(texture, texels)
    return texels.reshape(-1, 4)[3 : 4 * len(surface.numbers) : 4, 3]


def test_clearances_reach_to_the_next_layer():
    """Squares of 1 / 16; the farthest corner of half a square is `radius` from its center."""
    cell = 1.0 / 16.0
    radius = cell * np.sqrt(5.0) / 3.0
    gap = 1.2 * radius
    uv, quads = zoo.grid_uv(32, 32), zoo.grid_faces(32, 32)
    sheet = np.column_stack([2.0 * uv - 1.0, np.zeros(len(uv))])
    one = zoo.build("one", sheet, quads, uv[quads])
    both = [*sheet, *(sheet + (0.0, 0.0, gap))]
    two = zoo.build("two", both, [*quads, *(quads + len(sheet))], [*uv[quads], *uv[quads]])
    for low, expected in ((one, 0.5 * radius), (two, gap - radius)):
        cast = ray_cast(low, zoo.plane("high"))
        found = clearances(cast.low) * cast.ray_scene.local_space.size
        assert np.abs(found - expected).max() < 1e-5


@pytest.mark.parametrize("hit", Hit)
def test_clearances_are_measured_only_for_the_rule_that_asks_for_owners(hit):
    surface = ray_cast(zoo.plane("low", n=4), zoo.plane("high"), hit=hit).low
    assert (clearances(surface) > 0.0).any() == (hit == Hit.OWN)


def test_clearances_are_not_measured_where_very_many_triangles_are_near():
    """Around the center of a fan, each triangle has all others near it."""
    for sides, has_clearance in ((100, True), (1000, False)):
        angles = np.arange(sides) / sides * 2.0 * np.pi
        rim = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
        triangles = np.stack([np.zeros(sides), 1 + np.arange(sides), 1 + (np.arange(sides) + 1) % sides], axis=1)
        uv = np.random.default_rng(1).random((sides, 3, 2))
        surface = ray_cast(zoo.build("fan", [(0, 0, 0), *rim], triangles, uv), zoo.plane("high")).low
        assert (clearances(surface) > 0.0).any() == has_clearance


def test_the_width_of_the_blend_is_rounded():
    """GPUs round measurements differently, and all directions depend on the width."""
    low, high = zoo.cube("low"), zoo.cube("high")
    high.scale = (1.0987654, 1.0987654, 1.0987654)
    bpy.context.view_layer.update()
    width = ray_cast(low, high).directions.blend_width
    assert width > 0.01
    assert width == float(f"{width:.3g}")


def test_a_low_mesh_too_large_for_the_gpu_is_refused_with_the_limit(monkeypatch):
    low, high = zoo.plane("low", n=100), zoo.plane("high")
    monkeypatch.setattr(gpu.capabilities, "max_texture_size_get", lambda: 16)
    with pytest.raises(BakeError, match="rays take at most 16,384"):
        ray_cast(low, high)


@pytest.mark.parametrize("change", [{}, {"origin": np.ones(3)}, {"size": 2.0}])
def test_the_low_surface_is_built_once_for_each_local_space(change):
    low, trees = zoo.plane("low"), TreeCache()
    meshes = reading.read(bpy.context, low, [low], None, Settings(method="CAST"))
    space = LocalSpace(np.zeros(3), 1.0)
    first = trees.low_surface_of(meshes.low, space, Timings())
    assert (trees.low_surface_of(meshes.low, replace(space, **change), Timings()) is first) == (not change)
