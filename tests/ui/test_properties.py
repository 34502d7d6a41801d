# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's properties match the declarations of the settings, in the scene and in operators."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

import addon
from addon.core import naming
from addon.core.declarations import kinds, targets
from addon.core.declarations.all_settings import DECLARED, FORMER
from addon.ui import declared_properties, object_pairs
from tests.support import maps, older_file, panel_layout, zoo
from tests.support.maps import pixels

pytestmark = pytest.mark.usefixtures("registered")


OWN = {"rna_type", "name", "active_high", "convert_image", "names", *declared_properties.MapList.__annotations__}
"""Properties that are not settings, or that stand for a part of one."""


def holders():
    return [bpy.context.scene.imprint.bl_rna, bpy.ops.imprint.bake.get_rna_type()]


def test_a_scene_has_each_setting():
    assert {prop.identifier for prop in bpy.context.scene.imprint.bl_rna.properties} - OWN == {*DECLARED, *FORMER}


@pytest.mark.parametrize("name", DECLARED)
def test_label_limits_and_default_are_those_of_the_declaration(name):
    declared = DECLARED[name]
    for holder in holders():
        prop = holder.properties.get(name)
        if prop is None or (holder.identifier == "IMPRINT_OT_bake" and isinstance(declared, kinds.ObjectSlot)):
            continue  # operators take names of objects
        assert (prop.name, prop.description) == (declared.label, declared.panel_tooltip)
        if isinstance(declared, kinds.Choice):
            found = [(item.identifier, item.name, item.description) for item in prop.enum_items]
            assert found == [(str(item.value), item.label, item.tooltip) for item in declared.items]
        if isinstance(declared, kinds.Flags):
            assert prop.default_flag == set(declared.default)
        elif isinstance(declared, kinds.Choice):
            assert prop.default == str(declared.default)
        elif isinstance(declared, kinds.WholeNumber):
            assert (prop.hard_min, prop.hard_max) == (declared.least, declared.most)
            assert name == "size" or prop.default == declared.default
        elif isinstance(declared, kinds.Distance):
            assert prop.default == pytest.approx(declared.shown)
            # A Reach is a length only in scene units, for which the panel has another property.
            assert prop.subtype == ("NONE" if isinstance(declared, kinds.Reach) else "DISTANCE")
        elif isinstance(declared, kinds.Color):
            assert tuple(prop.default_array) == declared.default
        elif isinstance(declared, kinds.Switch | kinds.Text):
            assert prop.default == declared.default


# Older files


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


# Presets


BUILT_IN = sorted((Path(addon.__file__).parent / "presets" / "imprint").glob("*.py"))


@pytest.fixture(autouse=True)
def label(registered):
    """The panel's label, which Blender replaces with the name of the preset."""
    panel = bpy.types.IMPRINT_PT_conventions
    before = panel.bl_label
    yield
    panel.bl_label = before


def use(path):
    """Press an entry of the menu."""
    category, name = bpy.types.IMPRINT_PT_conventions.preset_operator.split(".")
    return getattr(getattr(bpy.ops, category), name)("EXEC_DEFAULT", True, filepath=str(path))


def test_a_preset_is_an_undo_step():
    """Undo of what comes after it does not undo the preset."""
    bpy.data.objects.new("Lamp", None).use_fake_user = True
    bpy.ops.ed.undo_push(message="before")
    use(next(path for path in BUILT_IN if path.stem == "Unreal"))
    bpy.data.objects["Lamp"].location.x = 2.0
    bpy.ops.ed.undo_push(message="moved")
    for undo, place, green, names in (
        (bpy.ops.ed.undo, 0.0, "-Y", "T_{low}_N"),
        (bpy.ops.ed.undo, 0.0, "+Y", ""),
        (bpy.ops.ed.redo, 0.0, "-Y", "T_{low}_N"),
        (bpy.ops.ed.redo, 2.0, "-Y", "T_{low}_N"),
    ):
        assert undo() == {"FINISHED"}
        settings = bpy.context.scene.imprint
        assert (bpy.data.objects["Lamp"].location.x, settings.green, settings.image) == (place, green, names)


def test_names_of_a_preset_are_not_shown_as_a_mistake():
    """Blender draws a search field red whose value is not among the results."""
    settings = bpy.context.scene.imprint
    settings.low = zoo.terrain("lo", n=2)
    use(next(path for path in BUILT_IN if path.stem == "Unreal"))
    assert settings.image not in bpy.data.images
    assert panel_layout.draw().red == []
    settings.uv_layer = "missing"
    assert panel_layout.draw().red == ["uv_layer"]


def test_a_preset_that_is_no_python_says_so(tmp_path):
    broken = tmp_path / "broken.py"
    broken.write_text("settings.green = ")
    with pytest.raises(RuntimeError, match="^Error: Failed to execute the preset: SyntaxError"):
        use(broken)
    with pytest.raises(RuntimeError, match="^Error: Unknown file type"):
        use(tmp_path / "preset.txt")


def test_all_presets_are_found_by_blender():
    folders = {Path(folder) for folder in bpy.utils.preset_paths("imprint")}
    assert BUILT_IN[0].parent in folders
    assert {path.stem for path in BUILT_IN} == {targets.OF_SCENE, *(target.preset for target in targets.TARGETS)}


@pytest.mark.parametrize("path", BUILT_IN, ids=lambda path: path.stem)
def test_a_preset_sets_what_its_programs_need(path):
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue = "-Z", "+X", "-Y"
    settings.basis = "CYCLES" if path.stem == targets.OF_SCENE else "AUTO"
    settings.image, settings.output = "of another preset", "//maps/mine.<UDIM>.tif"
    assert use(path) == {"FINISHED"}
    found = settings.red, settings.green, settings.blue, settings.basis, settings.depth, settings.alpha
    names = targets.presets()[path.stem]["names"]
    # Without a name, an image has the usual one.
    assert settings.image == ("" if names == naming.USUAL else names)
    assert settings.output == f"//maps/{names}.<UDIM>.tif"
    served = [target for target in targets.TARGETS if target.preset == path.stem]
    for target in served:
        assert found == ("+X", target.green, "+Z", target.basis.name, str(target.depth), target.alpha)
        assert names == target.names
    if not served:
        assert found == ("+X", "+Y", "+Z", "AUTO", "16", True)


def test_a_preset_of_the_user_is_saved_and_removed():
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue, settings.basis = "-X", "+Z", "+Y", "MIKKTSPACE"
    settings.depth, settings.alpha = "32", False
    settings.image = "{low}_nrm"
    assert bpy.ops.imprint.convention_add(name="Our engine") == {"FINISHED"}
    kept = [Path(folder, "Our_engine.py") for folder in bpy.utils.preset_paths("imprint")]
    kept = next(path for path in kept if path.is_file())
    settings.red, settings.green, settings.blue, settings.basis = "+X", "+Y", "+Z", "CYCLES"
    settings.depth, settings.alpha = "8", True
    settings.image, settings.output = "", "//a.png"
    use(kept)
    assert (settings.red, settings.green, settings.blue) == ("-X", "+Z", "+Y")
    assert (settings.basis, settings.depth, settings.alpha) == ("MIKKTSPACE", "32", False)
    assert (settings.image, settings.output) == ("{low}_nrm", "//{low}_nrm.png")
    bpy.ops.imprint.convention_add(name="Our engine", remove_active=True)
    assert not kept.exists()


@pytest.mark.parametrize("image", ["", "helmet_normal"])
def test_a_saved_preset_leaves_names_alone_that_fit_one_object(image):
    settings = bpy.context.scene.imprint
    settings.image = image
    assert settings.names == ""
    settings.image, settings.output = "rock_normal", "//rock.png"
    settings.names = ""
    assert (settings.image, settings.output) == ("rock_normal", "//rock.png")


def test_a_preset_names_texture_sets_by_their_materials():
    settings = bpy.context.scene.imprint
    settings.texture_sets, settings.output = True, "//{low}_{material}_normal.png"
    settings.names = "T_{low}_N"
    assert (settings.image, settings.output) == ("T_{low}_{material}_N", "//T_{low}_{material}_N.png")
    assert settings.names == "T_{low}_N"


def test_maps_of_the_preset_for_unreal_are_found_under_its_names(gpu_context, tmp_path):
    low, _ = zoo.terrains_in_slots("FLATTEN")
    settings = bpy.context.scene.imprint
    settings.storage, settings.output, settings.maps = "FILE", str(tmp_path / "mine.png"), {"HEIGHT", "ROUGHNESS"}
    settings.pack = "UNREAL"
    preset = next(path for path in BUILT_IN if path.stem == "Unreal")
    use(preset)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    names = {f"T_{low.name}_{ending}" for ending in ("N", "H", "R", "ORM")}
    files = {path.stem: path for path in tmp_path.iterdir()}
    assert set(files) == names
    assert names <= {image.name for image in bpy.data.images}
    normals = bpy.data.images.load(str(files[f"T_{low.name}_N"]))
    normals.colorspace_settings.is_data = True
    assert maps.pixels(normals)[..., :3].mean(axis=(0, 1)) == pytest.approx((0.5, 0.5, 1.0), abs=0.1)
