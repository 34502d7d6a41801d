# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that Live follows painted weights and their groups. tests/window/live_weights.py paints them with the mouse."""

import bpy
import numpy as np
import pytest

from addon.ui.live import live
from tests.support import zoo
from tests.support.following import follow, follows, is_fresh, shown
from tests.support.panel import use

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")


@pytest.fixture
def low(monkeypatch):
    """A low cube inside a larger one, of which rays reach some sides, with groups of neutral weights."""
    low, high = zoo.cube("lo"), zoo.sphere("hi", latitude=85.0)
    high.scale = (1.5, 1.7, 1.9)
    for name in ("far", "turned"):
        low.vertex_groups.new(name=name).add(range(8), 0.5, "REPLACE")
    use(low, high, size=64, method="CAST", measure=False, extrusion=0.6, max_distance=1.2)
    use(hit="OUTERMOST", show_result=False, offset_group="far", straight_group="turned")
    monkeypatch.setattr(live, "rest", 0.0)
    assert bpy.ops.imprint.live() == {"FINISHED"}
    yield low
    live.stop()


@pytest.mark.parametrize(("name", "weight"), [("far", 0.25), ("far", 1.0), ("turned", 0.0), ("turned", 1.0)])
def test_live_follows_weights(low, name, weight):
    before = shown()
    follows(lambda: low.vertex_groups[name].add([0, 1, 2], weight, "REPLACE"))
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
    assert is_fresh()


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
    assert is_fresh()
