# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what the panels show while they bake a set: its own settings, its parts, its textures."""

from types import SimpleNamespace

import bpy
import pytest

from addon.core.settings import PART_OF
from addon.ui import bake_panel, object_pairs, set_lists, set_operators, sets, settings_panels
from addon.ui.setting_rows import MADE, Rows
from scripts.dev import presses
from tests.support import panel_layout, zoo
from tests.support.panel import select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SETTINGS = [cls for cls in settings_panels.CLASSES if issubclass(cls, bpy.types.Panel)]


@pytest.fixture
def crate():
    """A set of two parts, each with a high object by its name, and small maps."""
    for number, name in enumerate(("crate", "lid")):
        low, high = zoo.plane(f"{name}_low", 2), zoo.terrain(f"{name}_high", n=8)
        low.location.x = high.location.x = 4.0 * number
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
    pinned = set(pins(drawn))
    for output, export in (("//map.dds", ""), ("//map.webp", "//low.glb")):  # some stand for such files alone
        use(output=output, export=export)
        pinned.update(pins(panel_layout.draw(panels=SETTINGS)))
    use(format="AUTO")
    pinned.update(pins(panel_layout.draw(panels=SETTINGS)))
    switches = {name for name in PART_OF if name.endswith("_limited")}
    # Textures stand for texture sets, and the main panel has size and samples.
    assert set(PART_OF) - pinned - switches <= {"texture_sets", "width", "height", "samples", "low_suffix"}
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


def test_the_menu_of_sizes_sets_what_the_row_shows(crate):
    scene = bpy.context.scene.imprint
    assert bpy.ops.imprint.resize(side=64) == {"FINISHED"}
    assert (scene.width, crate.settings.sampling.size) == (32, (64, 64))
    assert bpy.ops.imprint.resize(factor=2.0) == {"FINISHED"}
    assert (scene.width, crate.settings.sampling.size) == (32, (128, 128))
    scene.bakes = "SELECTION"
    assert bpy.ops.imprint.resize(side=256) == {"FINISHED"}
    assert (scene.width, crate.settings.sampling.size) == (256, (128, 128))


def test_what_is_set_at_the_head_is_the_sets_own_at_once(crate):
    scene = bpy.context.scene.imprint

    def put(name, value):
        owner, stored = Rows(bpy.context).at_head(name)
        assert getattr(owner, stored) == getattr(scene, name)
        setattr(owner, stored, value)
        return getattr(owner, stored)

    for name, value in (("samples", "64"), ("size", 128), ("engine", "Godot")):
        before = getattr(scene, name)
        assert put(name, value) == value
        assert getattr(scene, name) == before
        assert crate.is_own(name)
        crate.back(name)
        assert not crate.is_own(name)
    scene.height = 16
    assert put("square", False) is False
    assert (crate.own.width, crate.own.height, scene.square) == (32, 16, True)
    crate.own.width_of_head = 64
    assert crate.settings.sampling.size == (64, 16)
    crate.own.square_of_head = True
    assert crate.settings.sampling.size == (64, 64)
    scene.bakes = "SELECTION"
    assert Rows(bpy.context).at_head("samples") == (scene, "samples")
    assert Rows(bpy.context).at_head("width") == (scene, "width")


def test_all_own_settings_go_back_by_one_press(crate):
    for name in ("margin", "maps", "size", "depth"):
        bpy.ops.imprint.set_own(setting=name)
    assert crate.own.names_of_own()
    assert bpy.ops.imprint.set_own() == {"FINISHED"}
    assert crate.own.names_of_own() == []


def test_the_menu_of_sets_gives_all_own_settings_back_and_names_them(crate):
    def entry():
        assert not [text for text in main(width=2000).labels if "own setting" in text]
        layout = panel_layout.Layout()
        bpy.types.IMPRINT_MT_sets.draw(SimpleNamespace(layout=layout), bpy.context)
        return ("imprint.set_own", True) in layout.drawn.buttons

    def described(setting):
        return set_operators.IMPRINT_OT_set_own.description(bpy.context, SimpleNamespace(setting=setting))

    assert not entry()
    for name in ("margin", "size"):
        bpy.ops.imprint.set_own(setting=name)
    assert entry()
    assert described("").startswith("Give all settings that are the set's own back to the scene: ")
    assert {"Margin", "Width", "Height"} <= set(described("").partition(": ")[2].split(", "))
    assert described("margin") == ""


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


# The head of the panel


def main(**how):
    return panel_layout.draw(panels=[bake_panel.IMPRINT_PT_bake], **how)


def above_button(drawn):
    """What decides how far the button is from the top: lists with their rows, and rows of single settings and buttons."""
    in_lists = {"is_on", "name", "imprint_is_baked"}
    names = [name for name in drawn.order if name not in in_lists]
    menus = {"imprint.set_duplicate", "imprint.set_move", "imprint.set_high_remove", "imprint.resize"}
    at = names.index("engine")
    return drawn.rows, [name for name in names[:at] if name not in menus and name != "imprint.bake_sets"]


def test_the_head_says_what_the_panel_bakes(crate):
    drawn = main(width=2000)
    assert drawn.order[0] == "bakes"
    assert [name for name, _ in drawn.rows] == ["imprint_sets", "parts"]
    assert "Engine" in drawn.labels  # beside its field, so that long names are not cut
    assert "Bakes 2 parts: 32 x 32, an image for each part." in drawn.text
    baked = [vars(given) for name, given in drawn.given if name == "imprint.bake_sets" and vars(given)]
    assert baked == [{"name": crate.name}, {"name": crate.name, "changed": True}]
    bpy.context.scene.imprint.bakes = "SELECTION"
    drawn = main()
    assert drawn.order[0] == "bakes"
    assert [name for name, _ in drawn.rows] == ["highs"]


def test_the_button_stays_where_it_is(crate):
    before = above_button(main())
    assert bpy.ops.imprint.bake_sets(name=crate.name) == {"FINISHED"}
    assert above_button(main()) == before
    for number in range(40):
        crate.parts.add().object = zoo.cube(f"bolt_{number}")
    for textures in ("PART", "MATERIAL", "ONE"):
        crate.textures = textures
        for at in (0, 20):
            crate.active_part = at
            bpy.data.objects["crate_low"].imprint_size = "512"
            crate.parts[at].find().imprint  # noqa: B018 - as the operator does
            assert above_button(main()) == before


def test_what_a_part_has_for_itself_is_named(crate, monkeypatch):
    shown, prop = {}, panel_layout.Layout.prop

    def noted(layout, data, name, **how):
        shown[name] = how.get("text", data.bl_rna.properties[name].name)
        prop(layout, data, name, **how)

    monkeypatch.setattr(panel_layout.Layout, "prop", noted)
    low = crate.parts[0].find()
    low.imprint  # noqa: B018 - as the operator does
    main()
    assert {name: shown[name] for name in ("imprint_size", "imprint_distance", "cage")} == {
        "imprint_size": "Size",
        "imprint_distance": "Distance",
        "cage": "Cage",
    }
    assert low.bl_rna.properties["imprint_size"].enum_items["0"].name == "Set's"


def test_the_marks_of_floaters_are_those_of_the_active_part(crate):
    use(maps={"AO"})
    bpy.context.view_layer.objects.active = bpy.data.objects["crate_high"]

    def marked():
        found, prop = [], panel_layout.Layout.prop
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                panel_layout.Layout,
                "prop",
                lambda layout, data, name, **how: (
                    found.extend([how["text"]] if name == "imprint_is_floater" else [])
                    or prop(layout, data, name, **how)
                ),
            )
            panel_layout.draw(panels=SETTINGS)
        return found

    crate.active_part = 1
    assert marked() == ["Floater: lid_high"]
    crate.active_part = 0
    assert marked() == ["Floater: crate_high"]
    bpy.context.view_layer.objects.active = bpy.data.objects["lid_high"]
    assert marked() == ["Floater: crate_high"]
    bpy.context.scene.imprint.bakes = "SELECTION"
    assert marked() == ["Floater: lid_high"]


def test_a_part_that_is_gone_is_named(crate):
    bpy.data.objects.remove(bpy.data.objects["lid_low"])
    crate.parts[1].called = "lid_low"
    drawn = main(width=2000)
    assert ("lid_low", "ERROR") in zip(drawn.labels, drawn.icons, strict=True)


def test_parts_of_a_collection_are_listed_by_themselves(crate):
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(shelf)
    for name in ("lid_low", "lid_high"):
        shelf.objects.link(bpy.data.objects[name])
    crate.source, crate.collection = "COLLECTION", shelf
    drawn = main(width=2000)
    assert drawn.rows[1][0] == "all_objects"
    assert "lid_low" in drawn.labels
    assert drawn.properties.count("imprint_is_baked") == 1
    crate.source = "NAMES"
    drawn = main(width=2000)
    assert drawn.rows[1][0] == "objects"
    assert {"crate_low", "lid_low"} <= set(drawn.labels)
    assert "Bakes 2 parts" in drawn.text
    assert drawn.properties.count("imprint_is_baked") == 2
    for name in ("lid_low", "lid_high"):
        crate.active_part = bpy.context.view_layer.objects.find(name)
        chosen = set_lists.chosen_low(bpy.context)
        assert (chosen.name if chosen else "") == ("lid_low" if name == "lid_low" else "")


def test_a_picked_object_becomes_a_high_one_of_the_chosen_part(crate):
    bolt = zoo.cube("bolt")
    crate.active_part = 0
    low = crate.parts[0].find()
    bpy.context.scene.imprint_picked = bolt
    assert bpy.context.scene.imprint_picked is None
    assert bolt in object_pairs.of(low).found()
    assert "2 highs" in main(width=2000).labels
    crate.active_part = 1
    assert set_lists.chosen_low(bpy.context) == crate.parts[1].find()


def test_the_images_of_a_set_are_named_with_their_folder(crate):
    use(maps={"AO"}, storage="FILE", output="//textures/T_{name}.png", image="T_{name}")
    crate.textures = "MATERIAL"
    for name, low in (("wood", "crate_low"), ("iron", "lid_low")):
        bpy.data.objects[low].data.materials.append(bpy.data.materials.new(name))
    bpy.ops.wm.save_as_mainfile(filepath=bpy.app.tempdir + "crate.blend")
    drawn = main(width=2000)
    assert "Images of this bake: 4" in drawn.labels
    assert {"wood", "iron", "//textures/", "T_wood.png", "T_wood_ao.png"} <= set(drawn.labels)
    crate.textures = "ONE"
    drawn = main(width=2000)
    assert "Images of this bake: 2" in drawn.labels
    assert f"T_{crate.name}.png" in drawn.labels


def test_a_redraw_looks_for_parts_only_where_something_has_changed(crate, monkeypatch):
    calls, lows = [], sets.lows
    monkeypatch.setattr(sets, "lows", lambda *given: calls.append(1) or lows(*given))
    main()
    before = len(calls)
    for _ in range(3):
        main()
    assert len(calls) == before
    bpy.data.objects["lid_low"].location.z = 1.0
    main()
    assert len(calls) > before


def height():
    """The height of the main panel, in pixels at a scale of 1."""
    layout = presses.Layout(SimpleNamespace(opened=set(), inside={}, closed_bodies={}))
    bake_panel.IMPRINT_PT_bake.draw(
        panel_layout.Drawn(bake_panel.IMPRINT_PT_bake, layout), panel_layout.context_of(2000)
    )
    return layout.measured()[0]


@pytest.mark.parametrize("bakes", ["SELECTION", "SETS"])
def test_what_lies_below_stays_where_it_is_when_results_come(crate, bakes):
    settings = use(bakes=bakes, show_result=True)
    if bakes == "SELECTION":
        select(bpy.data.objects["crate_low"])
    before = height()
    if bakes == "SELECTION":
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        bpy.data.objects["crate_high"].hide_set(True)
    else:
        assert bpy.ops.imprint.bake_sets(name=crate.name) == {"FINISHED"}
    settings.bakes = bakes
    assert height() == before
    assert panels_at_top() == ["Imprint", "View", "More", "Results"]


def panels_at_top():
    """The labels of the panels at the top, in their order."""
    tops = [
        one
        for one in panel_layout.PANELS
        if not hasattr(one, "bl_parent_id") and "INSTANCED" not in getattr(one, "bl_options", ())
    ]
    return [one.bl_label for one in sorted(tops, key=lambda one: getattr(one, "bl_order", 0))]
