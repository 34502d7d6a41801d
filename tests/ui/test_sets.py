# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests sets: their parts, their own settings, and that they bake what pairs by name and single bakes do."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.ui import object_pairs, presets, sets
from tests.support.panel import select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 32


def cube(name, x=0.0, size=2.0):
    bpy.ops.mesh.primitive_cube_add(location=(x, 0.0, 0.0), size=size)
    bpy.context.object.name = name
    return bpy.context.object


@pytest.fixture
def props():
    """Two pairs of cubes by name."""
    objects = {}
    for number, name in enumerate(("crate", "lid")):
        for end, size in (("low", 2.0), ("high", 1.9)):
            objects[f"{name}_{end}"] = cube(f"{name}_{end}", 4.0 * number, size)
    bpy.ops.object.select_all(action="DESELECT")
    use(size=SIDE, maps={"AO"}, storage="MEMORY", samples="1", rays=16, occluders="OWN")
    return objects


def texels(name):
    image = bpy.data.images[name]
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values


def new_set(*lows, name="Prop", **values):
    one = bpy.context.scene.imprint_sets.add()
    one.name = name
    for low in lows:
        one.parts.add().object = low
    for key, value in values.items():
        setattr(one, key, value)
    bpy.context.scene.imprint.bakes = "SETS"
    return one


def names_of(one):
    return [low.name for low in sets.lows(bpy.context, one)]


def highs_of(one):
    return {job.low.name: [high.name for high in job.highs] for job in sets.resolve(bpy.context, one).jobs}


def added(*objects):
    """The high objects by the parts of the set that one click adds."""
    select(*objects)
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    return highs_of(sets.active(bpy.context))


class TestAdd:
    """A set from the selection."""

    @pytest.mark.parametrize("active", ["crate_low", "lid_low", "crate_high", "lid_high"])
    def test_names_decide_whatever_is_active(self, props, active):
        others = [obj for name, obj in props.items() if name != active]
        assert added(props[active], *others) == {"crate_low": ["crate_high"], "lid_low": ["lid_high"]}
        assert all(object_pairs.of(low) is None or not object_pairs.of(low).is_kept for low in props.values())

    def test_what_a_pair_calls_low_is_no_high(self, props):
        ball, shell = cube("ball", 8.0), cube("shell", 8.0, 1.9)
        ball.imprint.put([shell])
        assert added(props["crate_low"], ball, shell, props["crate_high"]) == {
            "crate_low": ["crate_high"],
            "ball": ["shell"],
        }

    def test_others_are_the_high_ones_of_the_active_object(self):
        sculpt, bolts, low = cube("sculpt"), cube("bolts"), cube("crate", size=2.1)
        bpy.context.scene.imprint.method = "CAST"
        assert added(low, sculpt, bolts) == {"crate": ["sculpt", "bolts"]}
        pair = object_pairs.of(low)
        assert (pair.is_kept, pair.method) == (True, "CAST")
        assert sets.active(bpy.context).own.names_of_own() == []
        sculpt.name = "detail"
        assert highs_of(sets.active(bpy.context)) == {"crate": ["detail", "bolts"]}

    def test_what_lies_elsewhere_is_a_part_of_its_own(self, props):
        table, bolt = cube("table", 20.0), cube("bolt", 0.1)
        assert added(props["crate_low"], props["crate_high"], table) == {
            "crate_low": ["crate_high"],
            "table": ["table"],
        }
        assert added(props["crate_low"], props["crate_high"], bolt) == {"crate_low": ["crate_high", "bolt"]}
        assert added(props["lid_low"], table) == {"lid_low": ["lid_high"], "table": ["table"]}
        props["lid_high"].location.x = 30.0
        bpy.context.view_layer.update()
        assert added(props["lid_low"], props["lid_high"], cube("screw", 4.1)) == {"lid_low": ["lid_high", "screw"]}

    def test_another_high_object_than_that_by_name(self, props):
        assert added(props["crate_low"], cube("sculpt")) == {"crate_low": ["sculpt"]}
        assert added(props["crate_low"]) == {"crate_low": ["sculpt"]}

    def test_a_high_object_beside_its_low_one(self):
        assert added(cube("crate_low"), cube("sculpt", 9.0)) == {"crate_low": ["sculpt"]}

    def test_objects_side_by_side_are_a_part_each(self):
        objects = [cube(name, 3.0 * number) for number, name in enumerate(("lamp", "table", "vase"))]
        assert added(*objects) == {name: [name] for name in ("lamp", "table", "vase")}
        assert sets.active(bpy.context).name == sets.NEW

    def test_distances_of_a_pair_become_the_sets(self, props):
        object_pairs.remember_objects(
            props["crate_low"],
            [props["crate_high"]],
            None,
            {"method": "CAST", "extrusion": 0.2, "max_distance": 0.7},
            {},
        )
        added(props["crate_low"])
        tracing = sets.active(bpy.context).settings.tracing
        assert (tracing.method, tracing.extrusion, tracing.max_distance) == pytest.approx(("CAST", 0.2, 0.7))

    def test_measured_distances_of_a_pair_stay_measured(self, props):
        use(measure=False, extrusion=0.5)
        settings = {"method": "CAST", "extrusion": None, "max_distance": None}
        object_pairs.remember_objects(props["crate_low"], [props["crate_high"]], None, settings, {"extrusion": 0.3})
        added(props["crate_low"])
        assert sorted(sets.active(bpy.context).own.names_of_own()) == ["measure", "method"]

    def test_distances_of_one_of_several_pairs_become_its_own(self, props):
        settings = {"method": "AUTO", "extrusion": 0.2, "max_distance": 0.7}
        object_pairs.remember_objects(props["crate_low"], [props["crate_high"]], None, settings, {})
        added(props["crate_low"], props["lid_low"])
        assert sets.active(bpy.context).own.names_of_own() == []
        assert props["crate_low"].imprint_distance == pytest.approx(0.35)
        assert props["lid_low"].imprint_distance == 0.0

    def test_without_a_selection_and_pairs_it_is_empty(self):
        bpy.ops.object.select_all(action="DESELECT")
        assert bpy.ops.imprint.set_add() == {"FINISHED"}
        assert names_of(sets.active(bpy.context)) == []

    def test_a_light_is_no_part(self):
        bpy.ops.object.light_add()
        assert bpy.ops.imprint.set_add() == {"FINISHED"}
        assert names_of(sets.active(bpy.context)) == []


def test_sets_bake_the_maps_of_pairs_by_name(props):
    props["lid_low"].imprint_size, props["crate_low"].imprint_distance = "256", 0.3
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    before = {name: texels(name) for name in ("crate_low_normal", "lid_low_normal", "lid_low_ao")}
    for image in list(bpy.data.images):
        bpy.data.images.remove(image)
    bpy.ops.object.select_all(action="DESELECT")
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    assert sets.active(bpy.context).source == "NAMES"
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    for name, values in before.items():
        np.testing.assert_array_equal(texels(name), values)


@pytest.mark.parametrize(
    ("textures", "engine", "named"),
    [
        ("PART", "", {"crate_low_normal", "lid_low_normal"}),
        ("ONE", "", {"Prop_normal"}),
        ("MATERIAL", "", {"Wood_normal"}),
        ("ONE", "Unreal Engine", {"T_Prop_N"}),
        ("MATERIAL", "Unreal Engine", {"T_Wood_N"}),
    ],
)
def test_images_are_named_after_what_shares_them(props, textures, engine, named, tmp_path):
    one, material = new_set(props["crate_low"], props["lid_low"], textures=textures), bpy.data.materials.new("Wood")
    one.own.output = str(tmp_path / "map.png")
    for low in (props["crate_low"], props["lid_low"]):
        low.data.materials.append(material)
    if engine:
        one.own.engine = engine
    use(maps=set())
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    images = {image.name for image in bpy.data.images if image.size[0]}
    assert {name for name in images if name.endswith(("_N", "_normal"))} == named
    if engine:
        assert {path.name for path in tmp_path.glob("*_N.png")} == {f"{name}.png" for name in named}


def test_one_material_is_named_after_the_set(props):
    new_set(props["crate_low"], props["lid_low"], textures="ONE").own.one_material = True
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    assert [props[name].active_material.name for name in ("crate_low", "lid_low")] == ["Prop", "Prop"]


def test_a_part_that_is_off_is_not_baked_and_says_nothing(props):
    new_set(props["crate_low"], props["lid_low"], textures="ONE")
    props["lid_low"].imprint_is_baked = False
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    assert {name for name, low in props.items() if object_pairs.of(low) and low.imprint.baked} == {"crate_low"}
    assert [job.low.name for job in sets.resolve(bpy.context, sets.active(bpy.context)).jobs] == [
        "crate_low",
        "lid_low",
    ]
    props["lid_low"].imprint.put([props["crate_low"]])
    assert sets.resolve(bpy.context, sets.active(bpy.context)).left_out == ()
    props["lid_low"].data.uv_layers.remove(props["lid_low"].data.uv_layers[0])
    assert sets.resolve(bpy.context, sets.active(bpy.context)).left_out == ()


@pytest.mark.parametrize("source", ["PARTS", "NAMES"])
def test_a_cage_by_name_and_that_of_the_pair(props, source):
    one, cage, hull = new_set(props["crate_low"], source=source), cube("crate_cage", size=2.4), cube("hull", size=2.2)
    used = lambda: sets.resolve(bpy.context, one).jobs[0].cage  # noqa: E731
    assert used() == cage
    assert bpy.ops.imprint.set_high_add(low="crate_low", high="lid_high") == {"FINISHED"}
    assert props["crate_low"].imprint.cage == cage
    props["crate_low"].imprint.cage = hull
    assert used() == (cage if source == "NAMES" else hull)
    bpy.context.scene.imprint.method = "FLATTEN"
    if source == "PARTS":  # which has no use for it; by name it is told, as by Bake Pairs by Name
        assert used() is None


def test_one_image_for_all_pairs_by_name_stays_so():
    bpy.context.scene.imprint.share_image = True
    cube("a_low")
    cube("a_high")
    bpy.ops.object.select_all(action="DESELECT")
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    assert (sets.active(bpy.context).source, sets.active(bpy.context).textures) == ("NAMES", "ONE")


def test_a_switch_and_its_numbers_belong_together(props):
    one, scene = new_set(props["crate_low"]), bpy.context.scene.imprint
    scene.measure = False
    one.make_own("extrusion")
    assert sorted(one.own.names_of_own()) == ["extrusion", "measure"]
    scene.measure = True
    assert one.settings.tracing.extrusion is not None
    one.make_own("max_distance")
    one.back("extrusion")
    assert sorted(one.own.names_of_own()) == ["max_distance", "measure"]
    one.back("measure")
    assert one.own.names_of_own() == []
    assert one.settings.tracing.max_distance is None


def test_own_settings_count_in_place_of_the_scene(props):
    one, scene = new_set(props["crate_low"]), bpy.context.scene.imprint
    assert one.settings == scene.to_settings()
    one.make_own("size")
    scene.width = scene.height = 512
    assert one.is_own("size") and one.settings.sampling.size == (SIDE, SIDE)
    one.own.size = 64
    assert one.settings.sampling.size == (64, 64)
    assert one.own.whole.width == 64
    one.back("size")
    assert not one.is_own("size") and one.settings == scene.to_settings()
    one.make_own("extrusion")
    one.own.measure, one.own.extrusion = False, 0.25
    assert one.settings.tracing.extrusion == 0.25
    assert one.settings.tracing.max_distance is not None
    one.back("extrusion")
    assert one.own.names_of_own() == []


def test_an_engine_of_a_set_leaves_the_scene_alone(props):
    one, scene = new_set(props["crate_low"]), bpy.context.scene.imprint
    scene.output = "//maps/x.png"
    before = scene.to_settings()
    assert one.own.engine == scene.engine
    one.own.engine = "Unreal Engine"
    assert scene.to_settings() == before
    settings = one.settings
    assert settings.storing.output == "//maps/T_{name}_N.png"
    assert settings.map.green == "-Y"
    assert one.own.engine == "Unreal Engine" != scene.engine
    one.back("engine")
    assert one.own.names_of_own() == []


@pytest.mark.parametrize("is_own", [True, False])
def test_a_button_that_fixes_changes_what_counts(props, is_own):
    one, scene = new_set(props["crate_low"]), bpy.context.scene.imprint
    props["crate_low"].imprint.put([props["crate_high"]])
    for name in ("udim", "storage", "method") if is_own else ():
        one.make_own(name)
    assert bpy.ops.imprint.fix(kind="UDIM", low="crate_low") == {"FINISHED"}
    assert (one.settings.sampling.udim, one.settings.storing.storage) == (True, "PACK")
    assert (scene.udim, scene.storage) == ((False, "MEMORY") if is_own else (True, "PACK"))
    assert sorted(one.own.names_of_own()) == (["method", "storage", "udim"] if is_own else [])


@pytest.fixture
def saved_presets():
    """Removes those that a test makes, and shows no name of them."""
    panel = bpy.types.IMPRINT_PT_presets
    before = panel.bl_label
    yield
    panel.bl_label = before
    for path in presets.folder().glob("*.py"):
        path.unlink()


@pytest.mark.usefixtures("saved_presets")
def test_a_preset_of_a_set_leaves_the_scene_alone(props, tmp_path):
    one, scene = new_set(props["crate_low"]), bpy.context.scene.imprint
    before, path = scene.to_settings(), tmp_path / "p.py"
    path.write_text(
        "settings.width = 64\nsettings.depth = '8'\nsettings.storage = 'FILE'\nsettings.output = '//{low}.png'\n"
    )
    assert bpy.ops.imprint.preset_use(filepath=str(path)) == {"FINISHED"}
    assert scene.to_settings() == before
    assert (one.settings.sampling.width, one.settings.storing.depth) == (64, 8)
    assert sorted(one.own.names_of_own()) == ["depth", "output", "storage", "width"]
    path.write_text("settings.samples = '4'\nsettings.width = 'wide'\n")
    with pytest.raises(RuntimeError, match="A preset cannot be used"):
        bpy.ops.imprint.preset_use(filepath=str(path))
    assert sorted(one.own.names_of_own()) == ["depth", "output", "storage", "width"]
    bpy.ops.imprint.preset_add(name="Of a Set")
    saved = presets.read_preset(presets.folder() / "Of_a_Set.py")
    assert (saved["width"], saved["output"]) == (64, "//{low}.png")
    bpy.context.scene.imprint.bakes = "SELECTION"
    bpy.ops.imprint.preset_add(name="Of the Scene")
    assert presets.read_preset(presets.folder() / "Of_the_Scene.py")["width"] == SIDE


def test_an_empty_set_says_so(props):
    with pytest.raises(BakeError, match="has no part"):
        sets.resolve(bpy.context, new_set())
