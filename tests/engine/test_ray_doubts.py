# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which texels count as doubtful or as lost, and on which triangles they are."""

from dataclasses import fields, replace

import bpy
import numpy as np
import pytest

from addon.core import progress, udim
from addon.core.settings import Run, Settings
from addon.engine import unsure_texels
from addon.engine.baking import draw
from addon.engine.method_choice import Choice
from addon.engine.planning import Plan
from addon.engine.unsure_texels import Doubts, Explorer
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
    plan = Plan(meshes, (udim.FIRST,), Choice("CAST"))
    return progress.finish(draw(plan, Run(settings))).ray_cast, meshes.low


def trace(rays):
    return unsure_texels.trace_doubts(*rays, (SIZE, SIZE), [udim.uv_to_clip(), udim.uv_to_clip(1002)])


def doubtful(rays, monkeypatch, **doubts):
    """The counts if Explorer finds these doubts as well."""

    class Doubting(Explorer):
        def doubts(self, size, view):
            return replace(super().doubts(size, view), **doubts)

    monkeypatch.setattr(unsure_texels, "Explorer", Doubting)
    found = trace(rays)
    assert len(found.triangles) == SIZE * SIZE  # nothing lies on the second tile
    return found.doubtful().tolist()


@pytest.mark.parametrize("reason", [field.name for field in fields(Doubts)][2:])
def test_each_reason_counts(rays, monkeypatch, reason):
    mask = np.zeros((SIZE, SIZE), bool)
    mask[CORNER] = True
    assert sorted(doubtful(rays, monkeypatch, **{reason: mask})) == [0, 6]


def test_without_reasons_only_misses_count(rays, monkeypatch):
    assert doubtful(rays, monkeypatch) == [0, 0]
    ray_cast, low = rays
    rays = replace(ray_cast, extrusion=0.05), low  # they start below the high plane
    assert sum(doubtful(rays, monkeypatch)) == SIZE * SIZE


def test_texels_have_their_triangle_and_their_hit(rays):
    found, (ray_cast, low) = trace(rays), rays
    unit = ray_cast.ray_scene.local_space.size
    assert np.allclose(found.heights * unit, 0.1, atol=1e-5)
    assert np.allclose(np.ptp(found.hits, axis=0) * unit, [2 - 2 / SIZE, 2 - 2 / SIZE, 0.0], atol=1e-5)
    assert np.allclose(found.directions, [0.0, 0.0, 1.0], atol=1e-6)
    corners = ray_cast.ray_scene.local_space.points(low)[low.vertices[low.triangles]]
    for number, corner in enumerate(corners):
        hits = found.hits[found.triangles == number]
        assert len(hits) > SIZE * SIZE / 3
        assert np.allclose(hits[:, :2].mean(axis=0), corner[:, :2].mean(axis=0), atol=2.0 / SIZE / unit)


def texel(**values):
    """The rays of two triangles, with one texel that is on the second one. Its ray hits at a height of 0.1."""
    neutral = {"direction": (0, 0, 1), "hit": (0, 0, 0.1), "is_missed": False, "is_unsure": False, "is_doubtful": False}
    neutral |= values
    return unsure_texels.Traced(
        np.array([1]),
        np.array([neutral["direction"]], np.float32),
        np.array([neutral["hit"]], np.float32),
        np.float32([0.1]),
        np.array([neutral["is_missed"]]),
        np.array([neutral["is_unsure"]]),
        np.array([neutral["is_doubtful"]]),
        gap=1e-3,
        count=2,
    )


HIGHER = {"hit": (0, 0, 0.102)}
MISSED = {"is_missed": True, "is_doubtful": True}
DOUBTFUL = {"is_doubtful": True}
UNSURE = {"is_unsure": True, "is_doubtful": True}


@pytest.mark.parametrize(
    ("before", "after", "lost"),
    [
        ({}, {}, 0),
        ({}, {"hit": (0, 0, 0.1005)}, 0),
        ({}, HIGHER, 1),
        ({}, HIGHER | DOUBTFUL, 1),
        ({}, DOUBTFUL, 0),
        (DOUBTFUL, HIGHER, 0),
        (DOUBTFUL, HIGHER | DOUBTFUL, 1),
        (UNSURE, HIGHER | DOUBTFUL, 0),
        ({}, MISSED, 1),
        (UNSURE, MISSED, 1),
        (MISSED, MISSED | HIGHER, 0),
        (MISSED, {}, 0),
        ({}, {"direction": (0.1, 0, 0.995), "hit": (0.01, 0, 0.12)}, 0),  # as far as a slope moves a ray that turns
        ({}, {"direction": (0.1, 0, 0.995), "hit": (0.01, 0, 0.14)}, 1),
    ],
)
def test_which_texels_are_lost(before, after, lost):
    assert texel(**before).lost(texel(**after)).tolist() == [0, lost]
