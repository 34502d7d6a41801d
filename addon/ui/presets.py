# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets for programs that read a normal map: those that come with Imprint, and the user's own."""

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel
from bpy.props import BoolProperty, StringProperty

from .translations import LABEL

FOLDER = "imprint"
"""Below "presets", here and in the user's scripts."""


class IMPRINT_PT_conventions(PresetPanel, bpy.types.Panel):
    """Presets for programs that read the map: channels, basis, depth, alpha and names"""

    bl_label = "Presets"
    bl_translation_context = LABEL
    preset_subdir = FOLDER
    preset_operator = "imprint.use_preset"
    preset_add_operator = "imprint.convention_add"


class IMPRINT_OT_use_preset(bpy.types.Operator):
    """Set channels, basis, depth, alpha and the names of maps as a program needs them"""

    bl_idname = "imprint.use_preset"
    bl_label = "Use Preset"
    bl_options = {
        "REGISTER",
        "UNDO",
    }  # Blender's own operator makes no undo step: undoing the next one would undo the preset

    filepath: StringProperty(
        name="File", description="File of the preset", options={"HIDDEN", "SKIP_SAVE"}, translation_context=LABEL
    )

    def execute(self, _context: bpy.types.Context) -> set[str]:
        try:
            return bpy.ops.script.execute_preset(filepath=self.filepath, menu_idname=IMPRINT_PT_conventions.__name__)
        except RuntimeError as error:  # what Blender's operator reports as an error
            self.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
            return {"CANCELLED"}


class IMPRINT_OT_convention_add(AddPresetBase, bpy.types.Operator):
    """Save the channels, the basis, depth, alpha and the names of maps as a preset, or remove a preset"""

    bl_idname = "imprint.convention_add"
    bl_label = "Add Preset"
    preset_menu = "IMPRINT_PT_conventions"
    preset_defines = ["settings = bpy.context.scene.imprint"]
    preset_values = [f"settings.{name}" for name in ("red", "green", "blue", "basis", "depth", "alpha", "names")]
    preset_subdir = FOLDER

    # As in Blender's base class, which has no descriptions.
    remove_name: BoolProperty(
        description="Remove the preset of this name", default=False, options={"HIDDEN", "SKIP_SAVE"}
    )
    remove_active: BoolProperty(
        description="Remove the preset that is shown", default=False, options={"HIDDEN", "SKIP_SAVE"}
    )


CLASSES = (IMPRINT_PT_conventions, IMPRINT_OT_use_preset, IMPRINT_OT_convention_add)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)
_PLACE = str(Path(__file__).parents[1])


def register() -> None:
    bpy.utils.register_preset_path(_PLACE)
    _register()


def unregister() -> None:
    _unregister()
    bpy.utils.unregister_preset_path(_PLACE)
