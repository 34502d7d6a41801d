# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of version 0.2 open as they were: its settings, objects in slots, images and materials. tests/support/older_file.py
has written the file."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core.declarations.all_settings import FORMER
from addon.ui import object_pairs
from tests.support import older_file
from tests.support.maps import pixels

FILE = Path(older_file.__file__).parent / "data" / "version_0.2.blend"
FLAT = np.array([0.5, 0.5, 1.0])


@pytest.fixture
def opened(registered):
    """The file, opened. Gives what its scenes had by their names."""
    bpy.ops.wm.open_mainfile(filepath=str(FILE))
    return {scene.name: json.loads(scene["expected"]) for scene in bpy.data.scenes}


@pytest.mark.parametrize("scene", ["changed", "baked"])
def test_settings_have_the_values_that_were_saved(opened, scene):
    found = older_file.values(bpy.data.scenes[scene].imprint)
    wanted = opened[scene]["values"]
    assert {name: found[FORMER.get(name, name)] for name in wanted} == wanted


def test_choices_have_the_numbers_that_files_have_for_them(opened):
    """Files hold the number of a choice, not its name: a new one goes to the end."""
    found = older_file.items(bpy.context.scene.imprint)
    for name, items in opened["changed"]["items"].items():
        assert items.items() <= found[name].items(), name


def test_values_of_earlier_names_go_to_the_present_ones_once(opened):
    settings, view = bpy.data.scenes["changed"].imprint, bpy.data.scenes["changed"].imprint_view
    assert settings.targets == {"directx"}
    assert not settings.is_property_set("readers")
    settings.targets, settings.tiles = set(), ""
    with pytest.warns(FutureWarning, match="readers is now called targets"):
        settings.readers = {"unreal", "three"}
    assert settings.to_settings().map.targets == ("unreal", "three")
    with pytest.warns(FutureWarning, match="reader is now called target"):
        view.reader = "godot"
    assert view.target == "godot"


def test_the_map_and_its_material_are_there(opened):
    image = bpy.data.images["baked low_normal"]
    assert tuple(image.size) == (older_file.SIZE, older_file.SIZE)
    assert np.abs(pixels(image)[..., :3] - FLAT).max(axis=-1).min() > 0.05
    nodes = bpy.data.objects["baked low"].active_material.node_tree.nodes
    assert [node.image for node in nodes if node.type == "TEX_IMAGE"] == [image]


def test_a_bake_takes_the_old_image_and_leaves_a_pair(opened, gpu_context):
    scene = bpy.data.scenes["baked"]
    bpy.context.window.scene = scene
    image, low = bpy.data.images["baked low_normal"], scene.imprint.low
    before = pixels(image)
    assert object_pairs.of(low) is None
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert [each.name for each in bpy.data.images if each.size[0]] == ["baked low_normal"]
    assert np.abs(pixels(image) - before).max() < 1e-4
    assert [high.name for high in object_pairs.of(low).found()] == ["baked high"]
    nodes = low.active_material.node_tree.nodes
    assert [node.image for node in nodes if node.type == "TEX_IMAGE"] == [image]
