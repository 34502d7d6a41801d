# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's properties match the declarations of the settings, in the scene and in operators."""

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core import naming
from addon.core.declarations import kinds, targets
from addon.core.declarations.all_settings import DECLARED
from addon.core.errors import BakeError
from addon.ui import object_pairs, presets
from tests.support import maps, older_file, panel_layout, zoo
from tests.support.maps import pixels
from tests.support.panel import refusal

pytestmark = pytest.mark.usefixtures("registered")


def holders():
    return [bpy.context.scene.imprint.bl_rna, bpy.ops.imprint.bake.get_rna_type()]


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
        elif isinstance(declared, kinds.Amount):
            limits = prop.hard_min, prop.hard_max, prop.default
            assert limits == pytest.approx((declared.least, declared.most, declared.default))
        elif isinstance(declared, kinds.Distance):
            assert prop.default == pytest.approx(declared.shown)
            # A Reach is a length only in scene units, for which the panel has another property.
            assert prop.subtype == ("NONE" if isinstance(declared, kinds.Reach) else "DISTANCE")
        elif isinstance(declared, kinds.Color):
            assert tuple(prop.default_array) == declared.default
        elif isinstance(declared, kinds.Switch | kinds.Text):
            assert prop.default == declared.default


# Older files


FILES = Path(older_file.__file__).parent / "data"
FLAT = np.array([0.5, 0.5, 1.0])
GONE = {"readers"}
"""Settings that later versions no longer have."""


@pytest.fixture(params=["0.2", "0.3"])
def opened(registered, request):
    """The file of a version, opened. Gives what its scenes had by their names."""
    bpy.ops.wm.open_mainfile(filepath=str(FILES / f"version_{request.param}.blend"))
    return {scene.name: json.loads(scene["expected"]) for scene in bpy.data.scenes}


@pytest.mark.parametrize("scene", ["changed", "baked"])
def test_settings_have_the_values_that_were_saved(opened, scene):
    found = older_file.values(bpy.data.scenes[scene].imprint)
    wanted = opened[scene]["values"]
    wanted = {name: value for name, value in wanted.items() if name not in GONE}
    assert {name: found[name] for name in wanted} == wanted


def test_choices_have_the_numbers_that_files_have_for_them(opened):
    """Files hold the number of a choice, not its name: a new one goes to the end."""
    found = older_file.items(bpy.context.scene.imprint)
    for name, items in opened["changed"]["items"].items():
        assert name in GONE or items.items() <= found[name].items(), name


def test_no_set_is_in_an_older_file(opened):
    for scene in bpy.data.scenes:
        assert (len(scene.imprint_sets), scene.imprint.bakes) == (0, "SELECTION")


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
    pair = object_pairs.of(low)
    assert pair is None or [high.name for high in pair.found()] == ["baked high"]
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert [each.name for each in bpy.data.images if each.size[0]] == ["baked low_normal"]
    assert np.abs(pixels(image) - before).max() < 1e-4
    assert [high.name for high in object_pairs.of(low).found()] == ["baked high"]
    nodes = low.active_material.node_tree.nodes
    assert [node.image for node in nodes if node.type == "TEX_IMAGE"] == [image]


# The setting Engine, and presets


def choose(name, settings=None):
    (settings or bpy.context.scene.imprint).engine = name


@pytest.fixture(autouse=True)
def label(registered):
    """The panel's label, which Blender replaces with the name of the preset, and a folder without presets."""
    panel = bpy.types.IMPRINT_PT_presets
    before = panel.bl_label
    yield
    panel.bl_label = before
    for path in presets.folder().glob("*.py"):
        path.unlink()


def use(path):
    """Press an entry of the menu."""
    category, name = bpy.types.IMPRINT_PT_presets.preset_operator.split(".")
    return getattr(getattr(bpy.ops, category), name)("EXEC_DEFAULT", True, filepath=str(path))


def test_an_engine_is_one_undo_step_in_a_window():
    """Blender pushes one after it has set a property that a user changes, with all that its callback has set."""
    bpy.ops.ed.undo_push(message="before")
    choose("Unreal Engine")
    bpy.ops.ed.undo_push(message="Engine")
    bpy.data.objects.new("Lamp", None).use_fake_user = True
    bpy.ops.ed.undo_push(message="later")
    for undo, green, names in (
        (bpy.ops.ed.undo, "-Y", "T_{name}_N"),
        (bpy.ops.ed.undo, "+Y", ""),
        (bpy.ops.ed.redo, "-Y", "T_{name}_N"),
    ):
        assert undo() == {"FINISHED"}
        settings = bpy.context.scene.imprint
        assert (settings.green, settings.image) == (green, names)


def test_names_of_an_engine_are_not_shown_as_a_mistake():
    """Blender draws a search field red whose value is not among the results."""
    settings = bpy.context.scene.imprint
    settings.low = zoo.terrain("lo", n=2)
    choose("Unreal Engine")
    assert settings.image not in bpy.data.images
    assert panel_layout.draw().red == []
    settings.uv_layer = "missing"
    assert panel_layout.draw().red == ["uv_layer"]


@pytest.mark.parametrize("name", targets.CHOICES)
def test_an_engine_sets_what_its_programs_need(name):
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue = "-Z", "+X", "-Y"
    settings.basis = "CYCLES" if name == targets.OF_SCENE else "AUTO"
    settings.image, settings.output, settings.export = "of another engine", "//maps/mine.<UDIM>.tif", "//out/a.usd"
    assert settings.engine == "CUSTOM"
    choose(name)
    assert settings.engine == name
    found = settings.red, settings.green, settings.blue, settings.basis, settings.depth, settings.alpha, settings.pack
    served = [target for target in targets.TARGETS if target.preset == name]
    for target in served:
        assert found == ("+X", target.green, "+Z", target.basis.name, str(target.depth), target.alpha, target.pack)
        # Without a name, an image has the usual one.
        assert settings.image == ("" if target.names == naming.USUAL else target.names)
        assert settings.output == f"//maps/{target.names}.<UDIM>.tif"
        assert settings.storage == ("FILE" if target.export else "PACK")
        assert settings.export == (f"//out/a{target.export}" if target.export else "")
    if not served:
        assert found == ("+X", "+Y", "+Z", "AUTO", "16", True, "NONE")
        assert (settings.storage, settings.export, settings.image) == ("PACK", "", "")
    settings.green = "-Y" if settings.green == "+Y" else "+Y"
    assert settings.engine == "CUSTOM"


def test_an_engine_makes_paths_beside_the_file_where_none_are_set():
    settings = bpy.context.scene.imprint
    choose("Unreal Engine")
    assert (settings.output, settings.export) == ("//T_{name}_N.png", "//{name}.fbx")
    settings.output = "//a.tga"  # which stores 8 bits alone
    choose("Godot")
    assert (settings.output, settings.export) == ("//{name}_normal.png", "//{name}.glb")
    choose("Blender")
    assert (settings.storage, settings.export) == ("PACK", "")


@pytest.mark.parametrize("engine", ["", "Unreal Engine"], ids=["without a preset", "with a preset"])
def test_a_targa_sets_8_bits_with_and_without_a_preset(tmp_path, engine):
    settings = bpy.context.scene.imprint
    if engine:
        choose(engine)
    settings.storage = "FILE"
    settings.output = "//a.tga"
    assert settings.depth == "8"
    settings.to_settings().check()
    settings.depth = "16"  # what is asked for is refused in a sentence
    with pytest.raises(BakeError, match="8 bits per channel, not 16"):
        settings.to_settings().check()
    presets.apply_preset(settings, {"depth": "16", "storage": "FILE", "output": "//a.png"})
    assert (settings.depth, settings.output) == ("16", "//a.png")


def test_a_file_that_was_never_saved_is_named_with_a_button(tmp_path):
    low, high = zoo.terrains_in_slots("FLATTEN")
    assert not bpy.data.filepath
    choose("glTF")
    drawn = panel_layout.draw()
    assert "save it first" in drawn.text
    assert not dict(drawn.buttons)["imprint.bake"]
    assert ("wm.save_mainfile", True) in drawn.buttons
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    assert dict(panel_layout.draw().buttons)["imprint.bake"]


def test_a_file_that_is_no_preset_says_so(tmp_path):
    broken = tmp_path / "broken.py"
    nested = "(" * 100_000
    for text in (
        *("settings.green = ", "settings.green = print(1)", "import bpy", "settings.depth = '7'"),
        *(
            "settings.green[0] = 1",
            "settings.green = {[]: 1}",
            f"settings.green = {nested}",
            f"settings.green = {'-' * 9000}1",
        ),
        *("settings.margin = 9" + "9" * 30, "settings.cage = 1"),
    ):
        broken.write_text(text)
        assert "preset" in refusal(presets_use, filepath=str(broken))
    assert "is not a preset" in refusal(presets_use, filepath=str(tmp_path / "preset.txt"))


def presets_use(**arguments):
    return bpy.ops.imprint.preset_use(**arguments)


def test_a_preset_runs_no_code(tmp_path):
    made = tmp_path / "made"
    path = tmp_path / "of_others.py"
    path.write_text(f"import bpy\nopen({str(made)!r}, 'w')\nsettings.green = '-Y'\n")
    assert bpy.ops.imprint.preset_load(filepath=str(path)) == {"FINISHED"}
    assert bpy.context.scene.imprint.green == "-Y"
    assert not made.exists()
    assert (presets.folder() / path.name).read_text() == path.read_text()


def test_a_preset_of_the_user_holds_all_settings_and_is_removed():
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue, settings.basis = "-X", "+Z", "+Y", "MIKKTSPACE"
    settings.depth, settings.alpha, settings.maps, settings.width = "32", False, {"AO", "HEIGHT"}, 512
    settings.missed, settings.unlimited, settings.rays, settings.ao_limited = (0.25, 0.5, 0.75), True, 64, True
    settings.image, settings.output, settings.export = "{low}_nrm", "//own/{low}_nrm.png", "//one.glb"
    wanted = settings.to_settings()
    assert bpy.ops.imprint.preset_add(name="Our engine") == {"FINISHED"}
    (kept,) = presets.folder().glob("*.py")
    assert kept.stem == "Our_engine"
    bpy.context.scene.property_unset("imprint")
    settings = bpy.context.scene.imprint
    settings.output = settings.export = "//a.png"
    assert use(kept) == {"FINISHED"}
    assert settings.to_settings() == wanted
    assert settings.export == "//a.png"  # that of the preset fits one object alone
    line = bpy.types.IMPRINT_OT_preset_use.description(None, SimpleNamespace(filepath=str(kept)))
    for words in ("512", "Samples", "Height, Ambient Occlusion", "Green +Z", "Depth 32", "{low}_nrm"):
        assert words in line
    bpy.ops.imprint.preset_add(name="Our engine", remove_active=True)
    assert not kept.exists()


def test_new_files_begin_with_my_defaults(tmp_path):
    settings = bpy.context.scene.imprint
    settings.width = 256
    path = str(tmp_path / "other.blend")
    bpy.context.scene.property_unset("imprint")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    for width in (256, 128):  # saving again replaces it
        bpy.context.scene.imprint.width = width
        assert bpy.ops.imprint.preset_add(name=presets.DEFAULTS) == {"FINISHED"}
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        assert bpy.context.scene.imprint.width == width
    bpy.ops.wm.open_mainfile(filepath=path)
    assert bpy.context.scene.imprint.width == 2048


def test_new_files_in_a_window_begin_with_four_samples():
    scene = bpy.context.scene
    scene.property_unset("imprint")
    presets.use_defaults(scene, has_window=False)
    assert scene.imprint.to_settings().sampling.samples == 1
    presets.use_defaults(scene, has_window=True)
    assert scene.imprint.to_settings().sampling.samples == 4
    scene.imprint.samples = "2"
    presets.use_defaults(scene, has_window=True)
    assert scene.imprint.to_settings().sampling.samples == 2


def test_my_defaults_come_before_four_samples():
    scene = bpy.context.scene
    scene.imprint.samples = "1"
    assert bpy.ops.imprint.preset_add(name=presets.DEFAULTS) == {"FINISHED"}
    scene.property_unset("imprint")
    presets.use_defaults(scene, has_window=True)
    assert scene.imprint.to_settings().sampling.samples == 1


@pytest.mark.parametrize("image", ["", "helmet_normal"])
def test_a_saved_preset_leaves_names_alone_that_fit_one_object(image):
    settings = bpy.context.scene.imprint
    settings.image = image
    assert settings.names == ""
    settings.image, settings.output = "rock_normal", "//rock.png"
    settings.names = ""
    assert (settings.image, settings.output) == ("rock_normal", "//rock.png")


def test_an_engine_names_texture_sets_by_their_materials():
    settings = bpy.context.scene.imprint
    settings.texture_sets, settings.output = True, "//{low}_{material}_normal.png"
    settings.names = "T_{name}_N"
    assert (settings.image, settings.output) == ("T_{name}_{material}_N", "//T_{name}_{material}_N.png")
    assert settings.names == "T_{name}_N"


def test_maps_for_unreal_are_found_under_its_names(gpu_context, tmp_path):
    low, _ = zoo.terrains_in_slots("FLATTEN")
    low.name = "rock_low"
    settings = bpy.context.scene.imprint
    settings.storage, settings.output, settings.maps = "FILE", str(tmp_path / "mine.png"), {"HEIGHT", "ROUGHNESS"}
    settings.export, settings.rays = str(tmp_path / "{name}.glb"), 16
    choose("Unreal Engine")
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    names = {f"T_rock_{ending}" for ending in ("N", "H", "R", "ORM")}
    files = {path.stem: path for path in tmp_path.iterdir() if path.suffix == ".png"}
    assert set(files) == names
    assert names <= {image.name for image in bpy.data.images}
    normals = bpy.data.images.load(str(files["T_rock_N"]))
    normals.colorspace_settings.is_data = True
    assert maps.pixels(normals)[..., :3].mean(axis=(0, 1)) == pytest.approx((0.5, 0.5, 1.0), abs=0.1)
