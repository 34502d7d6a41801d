# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Levels of Detail and its operator."""

import bpy
import pytest

from tests.support import zoo
from tests.support.panel_layout import draw

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def settings():
    """The settings of the scene, for small maps of an active terrain."""
    obj = zoo.terrain("Hill", 12)
    bpy.context.view_layer.objects.active = obj
    settings = bpy.context.scene.imprint
    settings.width = settings.height = 64
    settings.storage = "MEMORY"
    return settings


def test_the_panel_shows_the_limits_and_the_button(settings):
    drawn = draw()
    assert {"level_degrees", "level_distance"} <= set(drawn.properties)
    assert ("imprint.make_levels", True) in drawn.buttons


def test_the_button_makes_a_level_for_each_limit(settings):
    settings.level_degrees, settings.level_distance = "", "2, 4"
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    assert [obj.name for obj in bpy.data.collections["Hill_LODs"].objects] == ["Hill_LOD1", "Hill_LOD2"]
    assert bpy.context.window_manager.imprint_summary.startswith("Hill_LOD1: ")


def test_the_usual_limits_are_valid_and_wrong_ones_are_reported(settings):
    assert (settings.level_degrees, settings.level_distance) == ("1, 2, 4", "1")
    settings.level_degrees = "one"
    with pytest.raises(RuntimeError, match="are not degrees"):
        bpy.ops.imprint.make_levels()
    bpy.context.view_layer.objects.active = None
    settings.level_degrees = "1"
    with pytest.raises(RuntimeError, match="No object is active"):
        bpy.ops.imprint.make_levels()
    assert len(bpy.data.objects) == 1
