# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which texels count as doubtful, and on which triangles they are."""

from dataclasses import fields, replace

import bpy
import numpy as np
import pytest

from addon.core import progress, udim
from addon.core.settings import Settings
from addon.core.timings import Timings
from addon.engine.method_choice import choose_method
from addon.engine.rays import ray_doubts
from addon.engine.rays.unsure_texels import Doubts, Explorer
from addon.engine.sources import normal_source
from addon.scene import reading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 16
CORNER = np.s_[:2, -3:]
"""Six texels at the lower right corner of the map, on one of the plane's triangles."""


@pytest.fixture
def rays():
    """The rays of a plane of two triangles to one that covers it, and the low mesh."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.location.z = 0.1
    settings = Settings(method="CAST", width=SIZE, height=SIZE, extrusion=0.2, max_distance=0.4)
    meshes = reading.read(bpy.context, low, [high], None, settings)
    plan = choose_method(meshes, [udim.FIRST], settings)
    return progress.finish(normal_source(plan, settings, Timings(), progress.Pace())).ray_cast, meshes.low


def count(rays, monkeypatch, **doubts):
    """The counts if Explorer finds these doubts as well."""

    class Doubting(Explorer):
        def doubts(self, size, view):
            return replace(super().doubts(size, view), **doubts)

    monkeypatch.setattr(ray_doubts, "Explorer", Doubting)
    by_triangle, texels = ray_doubts.count(*rays, (SIZE, SIZE), [udim.uv_to_clip(), udim.uv_to_clip(1002)])
    assert texels == SIZE * SIZE  # nothing lies on the second tile
    return by_triangle.tolist()


@pytest.mark.parametrize("reason", [field.name for field in fields(Doubts)][1:])
def test_each_reason_counts(rays, monkeypatch, reason):
    mask = np.zeros((SIZE, SIZE), bool)
    mask[CORNER] = True
    assert sorted(count(rays, monkeypatch, **{reason: mask})) == [0, 6]


def test_without_reasons_only_misses_count(rays, monkeypatch):
    assert count(rays, monkeypatch) == [0, 0]
    ray_cast, low = rays
    rays = replace(ray_cast, extrusion=0.05), low  # they start below the high plane
    assert sum(count(rays, monkeypatch)) == SIZE * SIZE
