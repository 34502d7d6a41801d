# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets: those that come with Imprint are right, and the user's own can be saved and removed."""

from pathlib import Path

import bpy
import pytest

import addon
from addon.core.declarations import readers

BUILT_IN = sorted((Path(addon.__file__).parent / "presets" / "imprint").glob("*.py"))

pytestmark = pytest.mark.usefixtures("registered")


def test_all_presets_are_found_by_blender():
    folders = {Path(folder) for folder in bpy.utils.preset_paths("imprint")}
    assert BUILT_IN[0].parent in folders
    assert {path.stem for path in BUILT_IN} == {readers.OF_SCENE, *(reader.preset for reader in readers.READERS)}


@pytest.mark.parametrize("path", BUILT_IN, ids=lambda path: path.stem)
def test_a_preset_sets_what_its_programs_need(path):
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue = "-Z", "+X", "-Y"
    settings.basis = "CYCLES" if path.stem == readers.OF_SCENE else "AUTO"
    assert bpy.ops.script.execute_preset(filepath=str(path), menu_idname="IMPRINT_PT_conventions") == {"FINISHED"}
    found = settings.red, settings.green, settings.blue, settings.basis, settings.depth, settings.alpha
    served = [reader for reader in readers.READERS if reader.preset == path.stem]
    for reader in served:
        assert found == ("+X", reader.green, "+Z", reader.basis.name, str(reader.depth), reader.alpha)
    if not served:
        assert found == ("+X", "+Y", "+Z", "AUTO", "16", True)


def test_a_preset_of_the_user_is_saved_and_removed():
    settings = bpy.context.scene.imprint
    settings.red, settings.green, settings.blue, settings.basis = "-X", "+Z", "+Y", "MIKKTSPACE"
    settings.depth, settings.alpha = "32", False
    assert bpy.ops.imprint.convention_add(name="Our engine") == {"FINISHED"}
    kept = [Path(folder, "Our_engine.py") for folder in bpy.utils.preset_paths("imprint")]
    kept = next(path for path in kept if path.is_file())
    settings.red, settings.green, settings.blue, settings.basis = "+X", "+Y", "+Z", "CYCLES"
    settings.depth, settings.alpha = "8", True
    bpy.ops.script.execute_preset(filepath=str(kept), menu_idname="IMPRINT_PT_conventions")
    assert (settings.red, settings.green, settings.blue) == ("-X", "+Z", "+Y")
    assert (settings.basis, settings.depth, settings.alpha) == ("MIKKTSPACE", "32", False)
    bpy.ops.imprint.convention_add(name="Our engine", remove_active=True)
    assert not kept.exists()
