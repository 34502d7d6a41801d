# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what the panels show while they bake a set: its own settings, its parts, its textures."""

import bpy
import pytest

from addon.core.settings import PART_OF
from addon.ui import sets, settings_panels
from addon.ui.setting_rows import MADE, Rows
from tests.support import panel_layout, zoo
from tests.support.panel import select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SETTINGS = [cls for cls in settings_panels.CLASSES if issubclass(cls, bpy.types.Panel)]


@pytest.fixture
def crate():
    """A set of two parts, each with a high object by its name, and small maps."""
    for number, name in enumerate(("crate", "lid")):
        for end in ("low", "high"):
            zoo.cube(f"{name}_{end}").location.x = 4.0 * number
    select(bpy.data.objects["crate_low"], bpy.data.objects["lid_low"])
    use(size=32, samples="1", rays=16, storage="MEMORY")
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    return sets.active(bpy.context)


def pins(drawn):
    """The settings that have a pin, in the order in which they are drawn."""
    return [given.setting for name, given in drawn.given if name == "imprint.set_own" and given.setting]


# Own settings


def test_every_setting_of_a_set_has_a_pin_and_none_without_one(crate):
    use(maps={"AO", "THICKNESS", "CURVATURE", "DISPLACEMENT", "PART_ID", "GRADIENT", "ATTRIBUTE"}, pack="CUSTOM")
    use(depth="8", storage="FILE", udim=True, measure=False, ao_limited=True, thickness_limited=True, limited=True)
    bpy.context.scene.imprint.curvature_limited = True
    drawn = panel_layout.draw(panels=SETTINGS)
    repeated = [name for name in pins(drawn) if name != "distance_unit"]
    assert len(repeated) == len(set(repeated))
    switches = {name for name in PART_OF if name.endswith("_limited")}
    # Textures stand for texture sets, and the main panel has size and samples.
    assert set(PART_OF) - set(pins(drawn)) - switches <= {"texture_sets", "width", "height", "samples", "low_suffix"}
    bpy.context.scene.imprint.bakes = "SELECTION"
    assert pins(panel_layout.draw(panels=SETTINGS)) == []


def test_a_pinned_row_is_that_of_the_set_and_others_are_those_of_the_scene(crate):
    settings, rows = bpy.context.scene.imprint, Rows(bpy.context)
    assert rows.owner("margin") == settings
    assert bpy.ops.imprint.set_own(setting="margin") == {"FINISHED"}
    assert rows.owner("margin") == crate.own
    rows.owner("margin").margin = 3
    assert (rows["margin"], settings.margin) == (3, 16)
    assert rows.owner("mips") == settings
    settings.margin = 8
    assert crate.settings.sampling.margin == 3
    assert bpy.ops.imprint.set_own(setting="margin") == {"FINISHED"}
    assert (rows["margin"], crate.settings.sampling.margin) == (8, 8)


def test_all_own_settings_go_back_by_one_press(crate):
    for name in ("margin", "maps", "size", "depth"):
        bpy.ops.imprint.set_own(setting=name)
    assert crate.own.names_of_own()
    assert bpy.ops.imprint.set_own() == {"FINISHED"}
    assert crate.own.names_of_own() == []


def test_the_maps_of_a_set_are_one_setting(crate):
    bpy.ops.imprint.set_own(setting="maps")
    assert Rows(bpy.context).owner("maps") == crate.own
    crate.own.bakes_ao = True
    assert bpy.context.scene.imprint.maps == set()
    assert "AO" in crate.settings.map.drawn_maps
    assert MADE == ("engine",)


def test_few_bakes_need_what_is_behind_the_fold(crate):
    bpy.context.scene.imprint.bakes = "SELECTION"
    seen = panel_layout.draw(panels=[one for one in SETTINGS if one is not settings_panels.IMPRINT_PT_more_settings])
    for name in ("basis", "blue", "facing_only", "straight_group", "bias_angle", "floor", "dither", "bakes_sheen"):
        assert name not in seen.properties
    folded = panel_layout.draw(panels=[settings_panels.IMPRINT_PT_more_settings])
    assert {"basis", "blue", "facing_only", "bias_angle", "floor", "dither", "bakes_sheen"} <= set(folded.properties)


def test_what_a_packed_image_needs_says_so(crate):
    settings = use(pack="GLTF")
    drawn = panel_layout.draw(panels=SETTINGS, width=2000)
    assert "ao_distance" in drawn.properties
    assert "In the packed image: Ambient Occlusion" in drawn.text
    settings.maps = {"AO", "ROUGHNESS", "METALLIC"}
    assert "In the packed image" not in panel_layout.draw(panels=SETTINGS, width=2000).text
