# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets: those that come with Imprint are right, and the user's own can be saved and removed."""

from pathlib import Path

import bpy
import pytest

import addon
from addon.core import naming
from addon.core.declarations import targets
from tests.support import maps, panel_layout, zoo

BUILT_IN = sorted((Path(addon.__file__).parent / "presets" / "imprint").glob("*.py"))

pytestmark = pytest.mark.usefixtures("registered")


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
