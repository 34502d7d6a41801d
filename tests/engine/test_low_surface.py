# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays need of the low mesh: triangles without area, and the width of the blend of directions."""

import bpy
import gpu
import numpy as np
import pytest

from addon.core import progress, udim
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.core.timings import Timings
from addon.engine.method_choice import choose_method
from addon.engine.sources import normal_source
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def ray_cast(low, high, **values):
    settings = Settings("CAST", width=32, height=32, **values)
    plan = choose_method(reading.read(bpy.context, low, [high], None, settings), [udim.FIRST], settings)
    return progress.finish(normal_source(plan, settings, Timings(), progress.Pace())).ray_cast


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
    with pytest.raises(BakeError, match="'low' has 20,000 triangles; rays take at most 16,384 of the low mesh"):
        ray_cast(low, high)
