# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the button that proposes weights."""

import bpy
import numpy as np
import pytest

from addon.scene import mesh_elements
from addon.ui.bake_results import results
from tests.support import zoo
from tests.support.panel import use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def settings():
    """A low plane whose rays reach only half of the high surface."""
    settings = use(zoo.plane("lo", n=4), size=32, method="CAST", storage="MEMORY", show_result=False)
    for side, height in ((-1.0, 0.1), (1.0, 0.5)):
        high = zoo.plane("hi")
        high.scale.x, high.location.x, high.location.z = 0.5, 0.5 * side, height
        settings.highs.add().object = high
    return use(measure=False, extrusion=0.3, max_distance=0.6)


def weights(name):
    low = bpy.data.objects["lo"]
    return mesh_elements.weights(low, low.data, [name], outside=-1.0)[0]


def test_the_groups_are_created_named_and_used_by_the_next_bake(settings):
    assert not bpy.ops.imprint.propose_weights.poll()
    bpy.ops.imprint.bake()
    assert results.of(bpy.context).missed > 0.4
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}
    assert (settings.offset_group, settings.straight_group) == ("Imprint Offset", "Imprint Straight")
    assert settings.low.vertex_groups.active.name == "Imprint Offset"
    assert set(weights("Imprint Offset")) == {0.5, 1.0}
    assert (weights("Imprint Straight") == 0.5).all()
    bpy.ops.imprint.bake()
    assert results.of(bpy.context).missed == 0.0
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}  # nothing is better, and nothing changes
    assert set(weights("Imprint Offset")) == {0.5, 1.0}


def test_groups_with_other_names_are_filled(settings):
    settings.low.vertex_groups.new(name="mine")
    settings.offset_group = "mine"
    bpy.ops.imprint.bake()
    bpy.ops.imprint.propose_weights()
    assert settings.offset_group == "mine"
    assert [group.name for group in settings.low.vertex_groups] == ["mine", "Imprint Straight"]
    assert set(weights("mine")) == {0.5, 1.0}


def test_undo_takes_the_weights_back(settings):
    bpy.ops.imprint.bake()
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.imprint.propose_weights()
    bpy.ops.ed.undo_push(message="after")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert not bpy.data.objects["lo"].vertex_groups
    assert bpy.context.scene.imprint.offset_group == ""


def test_no_weights_in_edit_mode_or_without_rays(settings):
    bpy.ops.imprint.bake(method="FLATTEN")
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.imprint.propose_weights()
    bpy.ops.imprint.bake(method="CAST")
    assert bpy.ops.imprint.propose_weights.poll()
    bpy.context.view_layer.objects.active = settings.low
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.imprint.propose_weights.poll()
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}
    assert np.ptp(weights("Imprint Offset")) == 0.5


def test_an_object_that_was_deleted_is_an_error(settings):
    bpy.ops.imprint.bake()
    bpy.data.objects.remove(settings.highs[0].object)
    with pytest.raises(RuntimeError, match="was deleted"):
        bpy.ops.imprint.propose_weights()
    assert not settings.low.vertex_groups
