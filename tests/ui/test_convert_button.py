# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Convert Map makes a new image from an existing map."""

import bpy
import numpy as np
import pytest

from addon.ui import more_panels
from tests.support import angles, panel_layout, zoo
from tests.support.maps import bake, pixels

pytestmark = [pytest.mark.usefixtures("gpu_context"), pytest.mark.usefixtures("registered")]

EXACT = 0.002
"""Degrees at the 99th percentile, as for bakes."""


def button():
    """Whether the button is enabled in the panel."""
    return dict(panel_layout.draw().buttons)["imprint.convert"]


def test_one_press_converts_with_the_settings_of_the_panels():
    low, high = zoo.terrain("low", n=9, height=0.3), zoo.terrain("high", n=64, height=0.3)
    expected = bake(low, high, space="OBJECT", image="expected")
    bake(low, high, basis="NORMALIZED", green="-Y", image="map")
    settings = bpy.context.scene.imprint
    settings.low = low
    assert not button()
    settings.convert_image, settings.from_basis, settings.from_green = bpy.data.images["map"], "NORMALIZED", "-Y"
    settings.space, settings.depth, settings.margin, settings.storage = "OBJECT", "32", 0, "MEMORY"
    assert button()
    assert bpy.ops.imprint.convert() == {"FINISHED"}
    found = pixels(bpy.data.images["map_object"])
    off = angles.degrees(angles.decode(found), angles.decode(expected))
    assert np.percentile(off[expected[..., 3] > 0], 99) < EXACT
    assert "Converted map from tangent space (All Normalized; +X, -Y, +Z)" in bpy.context.window_manager.imprint_summary


def test_modifiers_of_an_object_alone_count_unless_it_was_baked_onto_itself():
    low, high = zoo.terrain("low", n=9, height=0.3), zoo.terrain("high", n=64, height=0.3)
    low.modifiers.new("Flat", "EDGE_SPLIT").split_angle = 0.0
    expected = bake(low, high, space="OBJECT", image="expected")
    bake(low, high, image="map")
    settings = bpy.context.scene.imprint
    settings.low, settings.convert_image = low, bpy.data.images["map"]
    settings.space, settings.depth, settings.margin, settings.storage = "OBJECT", "32", 0, "MEMORY"
    assert bpy.ops.imprint.convert() == {"FINISHED"}
    off = angles.degrees(angles.decode(pixels(bpy.data.images["map_object"])), angles.decode(expected))
    assert np.percentile(off[expected[..., 3] > 0], 99) < EXACT
    low.imprint.is_own, low.imprint.had_detail = True, False
    assert more_panels._is_own_base(settings.chosen(bpy.context))


@pytest.mark.parametrize(
    ("from_basis", "green", "name"), [("MIKKTSPACE", "+Y", "map_opengl"), ("NORMALIZED", "+Y", "map_mikktspace")]
)
def test_a_new_map_is_named_after_what_is_new(from_basis, green, name):
    low, high = zoo.terrain("low", n=5), zoo.terrain("high", n=8)
    bake(low, high, basis="MIKKTSPACE", green="-Y", image="map")
    settings = bpy.context.scene.imprint
    settings.low, settings.basis, settings.green, settings.storage = low, "MIKKTSPACE", green, "MEMORY"
    settings.convert_image, settings.from_basis, settings.from_green = bpy.data.images["map"], from_basis, "-Y"
    assert bpy.ops.imprint.convert() == {"FINISHED"}
    assert name in bpy.data.images


def test_the_panel_opens_files():
    assert ("convert_image", "image.open") in panel_layout.draw().files


def test_without_a_map_the_operator_says_what_is_missing():
    bpy.context.scene.imprint.low = zoo.plane("low")
    with pytest.raises(RuntimeError, match="No map to convert: choose an image"):
        bpy.ops.imprint.convert()
