# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that Live follows painted weights and their groups. tests/window/live_weights.py paints them with the mouse."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.ui.live_switch import live
from tests.support import zoo
from tests.support.maps import pixels

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")


@pytest.fixture
def low(monkeypatch):
    """A low cube inside a larger one, of which rays reach some sides, with groups of neutral weights."""
    low, high = zoo.cube("lo"), zoo.sphere("hi", latitude=85.0)
    high.scale = (1.5, 1.7, 1.9)
    for name in ("far", "turned"):
        low.vertex_groups.new(name=name).add(range(8), 0.5, "REPLACE")
    settings = bpy.context.scene.imprint
    settings.low = low
    settings.highs.add().object = high
    settings.method, settings.width, settings.height = "CAST", 64, 64
    settings.measure, settings.extrusion, settings.max_distance = False, 0.6, 1.2
    settings.hit, settings.show_result = "OUTERMOST", False
    settings.offset_group, settings.straight_group = "far", "turned"
    monkeypatch.setattr(live, "rest", 0.0)
    assert bpy.ops.imprint.live() == {"FINISHED"}
    yield low
    live.stop()


def follow():
    bpy.context.view_layer.update()
    for _ in range(200):
        live.tick()
        if not live.is_on or live.is_resting:
            return
    raise AssertionError("Live does not come to rest")


def shown():
    return pixels(bpy.data.images["lo_normal"])


def fresh():
    """The texels of a new bake."""
    settings = bpy.context.scene.imprint
    own = {"image": "fresh", "storage": "MEMORY", "material": False, "modifiers": "VIEWPORT"}
    chosen = settings.chosen(bpy.context)
    bake_pair(bpy.context, chosen.low, chosen.highs, Settings(**settings.to_settings().flat() | own))
    return pixels(bpy.data.images["fresh"])


@pytest.mark.parametrize(("name", "weight"), [("far", 0.25), ("far", 1.0), ("turned", 0.0), ("turned", 1.0)])
def test_live_follows_weights(low, name, weight):
    before = shown()
    low.vertex_groups[name].add([0, 1, 2], weight, "REPLACE")
    follow()
    assert not np.array_equal(shown(), before)
    assert np.array_equal(shown(), fresh())
    low.vertex_groups[name].add([0, 1, 2], 0.5, "REPLACE")
    follow()
    assert np.array_equal(shown(), before)


def test_live_waits_for_a_group_that_is_renamed_or_removed(low):
    low.vertex_groups["far"].add([0], 1.0, "REPLACE")
    follow()
    before = shown()
    low.vertex_groups["far"].name = "other"
    follow()
    assert "'lo' has no vertex group 'far'" in live.message
    assert live.is_on
    bpy.context.scene.imprint.offset_group = "other"
    follow()
    assert live.message == ""
    assert np.array_equal(shown(), before)
    low.vertex_groups.remove(low.vertex_groups["other"])
    follow()
    assert "'lo' has no vertex group 'other'" in live.message
    bpy.context.scene.imprint.offset_group = ""
    follow()
    assert live.message == ""
    assert not np.array_equal(shown(), before)
    assert np.array_equal(shown(), fresh())


def test_live_follows_proposed_weights(low):
    settings = bpy.context.scene.imprint
    bpy.ops.imprint.live()
    settings.extrusion = 0.3
    bpy.ops.imprint.bake()
    bpy.ops.imprint.live()
    before = shown()
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}
    assert any(group.weight == 1.0 for vertex in low.data.vertices for group in vertex.groups)
    follow()
    assert not np.array_equal(shown(), before)
    assert np.array_equal(shown(), fresh())
