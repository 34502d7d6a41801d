# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces without a surface: points, lines, NaN. Each way to use one ends in a sentence and changes nothing."""

import bpy
import numpy as np
import pytest

from addon.core.asset_limits import Wanted
from addon.core.errors import BakeError
from addon.core.levels import limits
from addon.core.naming import Suffixes
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.jobs import asset, bake_all, lod, unwrapping
from addon.jobs.job import Job
from addon.mesh.edges import is_without_area
from addon.mesh.triangle_mesh import Mesh
from tests.support import scenes, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = [pytest.mark.usefixtures("gpu_context"), pytest.mark.filterwarnings("error::RuntimeWarning")]

SETTINGS = Settings(width=32, height=32, storage="MEMORY", material=False)
NAN, ONE = [(float("nan"),) * 3] * 3, [(0, 1, 2)]
SHAPES = {
    "line": ([(0, 0, 0), (1, 0, 0), (2, 0, 0)], ONE),
    "skew line": ([(0.1, 0.2, 0.3), (0.2, 0.4, 0.6), (0.3, 0.6, 0.9)], ONE),  # rounding gives it an area
    "two lines": ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0, 1), (1, 0, 1), (2, 0, 1)], [(0, 1, 2), (3, 4, 5)]),
    "line of five": ([(i, 0, 0) for i in range(5)], [range(5)]),
    "point": ([(5, 5, 5)] * 3, ONE),
    "speck": ([(7, 0, 0), (7, 1e-25, 0), (7, 0, 1e-25)], ONE),
    "sliver": ([(0, 0, 0), (1, 0, 0), (2, 1e-20, 0)], ONE),
    "nan": (NAN, ONE),
    "nan and line": ([*NAN, (0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2), (3, 4, 5)]),
    "edge": ([(0, 0, 0), (1, 0, 0)], []),
    "nothing": ([], []),
    "masked": ([(0, 0, 0), (1, 0, 0), (1, 1, 0)], ONE),
}


def shape(name):
    data = bpy.data.meshes.new(name)
    points, faces = SHAPES[name]
    data.from_pydata(points, [(0, 1)] if name == "edge" else [], faces)
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0.5)] * 2, np.float32)[: len(data.loops)]
    data.uv_layers.new().uv.foreach_set("vector", corners.ravel())
    obj = scenes.link(bpy.data.objects.new(name, data))
    if name == "masked":
        obj.modifiers.new("Mask", "MASK").vertex_group = obj.vertex_groups.new(name="none").name
    return obj


def as_asset(obj, low):
    job = Job(obj, [obj])
    return finish(asset.work(bpy.context, job, Wanted(triangles=8), SETTINGS, Pace(), suffixes=Suffixes()))


def beside_a_low(obj, low):
    return finish(
        asset.work(bpy.context, Job(low, [obj]), Wanted(triangles=8, levels=1), SETTINGS, Pace(), suffixes=Suffixes())
    )


def as_the_low_of_an_asset(obj, low):
    wanted = Wanted(triangles=0, distance=0.01)
    return finish(asset.work(bpy.context, Job(obj, [low]), wanted, SETTINGS, Pace(), suffixes=Suffixes()))


WAYS = {
    "asset": as_asset,
    "levels of an asset": beside_a_low,
    "low of an asset": as_the_low_of_an_asset,
    "levels": lambda obj, low: finish(lod.work(bpy.context, obj, limits("1, 4"), SETTINGS, Pace())),
    "high": lambda obj, low: bake_all(bpy.context, [Job(low, [obj])], SETTINGS),
    "low": lambda obj, low: bake_all(bpy.context, [Job(obj, [low])], SETTINGS),
    "unwrap": lambda obj, low: unwrapping.unwrap(obj, SETTINGS),
}
HAVE_A_SURFACE = {("unwrap", "masked"), ("unwrap", "speck")}
"""What is unwrapped is the object's own mesh, of any size."""


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", SHAPES)
def test_a_surface_without_a_surface_is_a_sentence(name, way):
    obj, low = shape(name), zoo.plane("low")
    if (way, name) in HAVE_A_SURFACE:
        assert "is unwrapped" in WAYS[way](obj, low)
        return
    before = snapshot()
    with pytest.raises(BakeError) as caught:
        WAYS[way](obj, low)
    assert repr(name) in str(caught.value)
    assert "allow more" not in str(caught.value)
    assert difference(before, snapshot()) == {}


def test_one_face_with_an_area_is_a_surface():
    lines = np.tile([[0, 1, 2]], (5000, 1))
    points = np.float32([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1e-3, 0]])
    for scale in (1e-25, 1.0, 1e15):
        assert is_without_area(Mesh.of_arrays("lines", scale * points, lines))
        assert not is_without_area(Mesh.of_arrays("one", scale * points, np.concatenate([lines, [[0, 1, 3]]])))
