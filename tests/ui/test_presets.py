# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets: those that come with Imprint are right, and the user's own can be saved and removed."""

from pathlib import Path

import bpy
import pytest

import addon

BUILT_IN = sorted((Path(addon.__file__).parent / "presets" / "imprint").glob("*.py"))
DOWN = {"Unreal", "DirectX", "CryEngine"}

pytestmark = pytest.mark.usefixtures("registered")


def test_all_presets_are_found_by_blender():
    folders = {Path(folder) for folder in bpy.utils.preset_paths("imprint")}
    assert BUILT_IN[0].parent in folders
    names = {path.stem for path in BUILT_IN}
    assert names == {"Blender", "Unity", "Godot", "glTF", "Unreal", "DirectX", "CryEngine"}


@pytest.mark.parametrize("path", BUILT_IN, ids=lambda path: path.stem)
def test_a_preset_sets_the_channels_and_the_basis(path):
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue = "-Z", "+X", "-Y"
    settings.basis = "MIKKTSPACE" if path.stem == "Blender" else "BLENDER"
    assert bpy.ops.script.execute_preset(filepath=str(path), menu_idname="IMPRINT_PT_conventions") == {"FINISHED"}
    assert (settings.red, settings.green, settings.blue) == ("+X", "-Y" if path.stem in DOWN else "+Y", "+Z")
    assert settings.basis == ("AUTO" if path.stem == "Blender" else "MIKKTSPACE")


def test_a_preset_of_the_user_is_saved_and_removed():
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue, settings.basis = "-X", "+Z", "+Y", "MIKKTSPACE"
    assert bpy.ops.imprint.convention_add(name="Our engine") == {"FINISHED"}
    kept = [Path(folder, "Our_engine.py") for folder in bpy.utils.preset_paths("imprint")]
    kept = next(path for path in kept if path.is_file())
    settings.red, settings.green, settings.blue, settings.basis = "+X", "+Y", "+Z", "BLENDER"
    bpy.ops.script.execute_preset(filepath=str(kept), menu_idname="IMPRINT_PT_conventions")
    assert (settings.red, settings.green, settings.blue) == ("-X", "+Z", "+Y")
    assert settings.basis == "MIKKTSPACE"
    bpy.ops.imprint.convention_add(name="Our engine", remove_active=True)
    assert not kept.exists()
