# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what the panel says of parts whose UVs lie over one another in the image that they share."""

import bpy
import pytest

from addon.ui import bake_panel, findings, set_lists, sets, signs
from addon.ui.signs import looks
from tests.support import panel_layout, zoo
from tests.support.panel import select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

NAMES = ("crate", "lid", "leg")
OVER = "The UVs of 'crate_low', 'lid_low', 'leg_low' lie over one another in the image that they share"


@pytest.fixture
def props():
    """A set of three planes, each with the whole map, and high objects by name."""
    for number, name in enumerate(NAMES):
        low, high = zoo.plane(f"{name}_low", 2), zoo.terrain(f"{name}_high", n=8)
        low.location.x = high.location.x = 4.0 * number
    select(*(bpy.data.objects[f"{name}_low"] for name in NAMES))
    use(size=32, samples="1", rays=16, storage="MEMORY")
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    return sets.active(bpy.context)


def look():
    while findings.findings.look() is not None:
        pass
    while looks.advance(bpy.context, 10.0):
        pass


def main():
    """The main panel after all looks that it has asked for."""
    bpy.context.view_layer.update()
    for _ in range(2):
        panel_layout.draw(panels=[bake_panel.IMPRINT_PT_bake])
        look()
    return panel_layout.draw(panels=[bake_panel.IMPRINT_PT_bake])


def packs(drawn):
    return sum(name == "imprint.pack_uvs" for name, _ in drawn.given)


def give(*names, of="Wood"):
    for name in names:
        bpy.data.objects[f"{name}_low"].data.materials.append(bpy.data.materials.get(of) or bpy.data.materials.new(of))


def test_it_is_said_before_the_bake_with_a_button(props):
    props.textures = "ONE"
    drawn = main()
    assert OVER in drawn.text
    assert packs(drawn) == 2
    assert bpy.ops.imprint.pack_uvs() == {"FINISHED"}
    assert "lie over one another" not in main().text


def test_parts_with_images_of_their_own_may(props):
    assert "lie over one another" not in main().text


def test_parts_of_a_material_alone_share_its_image(props):
    give("crate", "lid")
    give("leg", of="Iron")
    props.textures = "MATERIAL"
    assert "The UVs of 'crate_low', 'lid_low' lie over one another" in main().text
    bpy.data.objects["lid_low"].imprint_is_baked = False
    bpy.data.objects["lid_low"].update_tag()  # as Blender does where it is switched in a panel
    assert "lie over one another" not in main().text


def test_a_wrong_bake_has_no_check_mark_and_stands_in_the_box(props):
    props.textures = "ONE"
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    main()
    assert signs.of_set(bpy.context, props).icon == "ERROR"
    sentence = "found something wrong, in 2 of 3 parts: 'lid_low', 'leg_low'"
    assert sentence in signs.of_set(bpy.context, props).text
    assert OVER in main().text
    assert bpy.ops.imprint.pack_uvs() == {"FINISHED"}
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    main()
    assert signs.of_set(bpy.context, props).icon == "CHECKMARK"


def test_the_sentence_of_the_bake_has_the_button_and_comes_before_others(props):
    for name in NAMES:
        low = bpy.data.objects[f"{name}_low"]
        low.data.edges.foreach_set("use_edge_sharp", [True] * len(low.data.edges))
        low.data.vertices[4].co.z = 0.3
    props.textures = "ONE"
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    told = findings.findings.worst(bpy.context, bpy.data.objects["lid_low"])
    assert "in the same image: Pack UV Maps lays their islands side by side, or bake" in told.text
    assert told.fixes == ("PACK",)
    told = findings.results.warnings_of(findings.results.all_of(bpy.context, bpy.data.objects["lid_low"]))
    assert [each.kind for each in told][:2] == ["shared", "hard_edges"]


def test_a_row_names_its_only_high_object_also_where_little_room_is_left(props, monkeypatch):
    monkeypatch.setattr(set_lists, "room", lambda _context: set_lists.BESIDE_NAMES + width)
    size = set_lists.font_size(1.0)
    width = set_lists.text_width("crate_low", size) + set_lists.GAP + set_lists.LEAST + 1.0
    assert "crate_high" in panel_layout.draw(panels=[bake_panel.IMPRINT_PT_bake]).labels
    width -= 2.0
    assert "crate_high" not in panel_layout.draw(panels=[bake_panel.IMPRINT_PT_bake]).labels
