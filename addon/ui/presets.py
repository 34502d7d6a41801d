# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of all settings of a bake: files of the user that others can load.

A preset is a file as Blender's own operator writes it, with a line `settings.NAME = VALUE` for each setting. It is read and
never run, so that files of others run no code. New files begin with the preset DEFAULTS, if there is one.
"""

import ast
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel
from bpy.props import BoolProperty, StringProperty

from ..core import naming
from ..core.declarations.all_settings import DECLARED
from ..core.errors import BakeError
from ..core.settings import PART_OF
from . import sets
from .callbacks import Timer, events
from .engine_choice import describe
from .modal import FileOperator, QuickOperator, file_filter
from .texts import LABEL, label, labeled

FOLDER = "imprint"
"""Below "presets" in the user's scripts."""
FINAL_SAMPLES = "4"
"""The samples of new files in a window. Shells, scripts and files that are there have the declared ones."""
DEFAULTS = "My Defaults"
"""The name of the preset with which new files begin."""


def read_preset(path: Path) -> dict[str, Any]:
    """The settings of a preset by their names. Raises BakeError for a file that is none."""
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        values = {
            node.targets[0].attr: ast.literal_eval(node.value)
            for node in tree.body
            if isinstance(node, ast.Assign) and _is_setting(node.targets[0])
        }
    except (OSError, SyntaxError, ValueError, TypeError) as error:
        raise BakeError(f"{str(path)!r} is not a preset: {error}.") from error
    except (MemoryError, RecursionError) as error:  # of Python's parser
        raise BakeError(f"{str(path)!r} is not a preset: it is nested too deep.") from error
    if not values:
        raise BakeError(f"{str(path)!r} is not a preset: it has no line that begins with 'settings.'.")
    return values


def _is_setting(target: ast.expr) -> bool:
    return isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name) and target.value.id == "settings"


def apply_preset(settings: bpy.types.PropertyGroup, values: Mapping[str, Any]) -> None:
    """Set settings. Raises BakeError for a value that is not possible, and changes nothing then."""
    may_be_set = {each.identifier for each in settings.bl_rna.properties if not each.is_readonly}
    known = {name: value for name, value in values.items() if name in may_be_set}
    known = dict(
        sorted(known.items(), key=lambda item: item[0] == "depth")
    )  # a path sets it, if the one before does not fit
    before = {name: getattr(settings, name) for name in known if settings.is_property_set(name)}
    try:
        for name, value in known.items():
            setattr(settings, name, value)
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        for name, value in before.items():
            setattr(settings, name, value)
        for name in known.keys() - before:
            settings.property_unset(name)
        raise BakeError(f"A preset cannot be used: {error}.") from error


def folder() -> Path:
    """The user's folder of presets, which is made if it is not there."""
    return Path(bpy.utils.user_resource("SCRIPTS", path=f"presets/{FOLDER}", create=True))


def use_defaults(scene: bpy.types.Scene, *, has_window: bool) -> None:
    """Set what the preset DEFAULTS says in a scene in which nothing is set; without one, FINAL_SAMPLES, in a window alone."""
    path = folder() / f"{AddPresetBase.as_filename(DEFAULTS)}.py"
    settings = scene.imprint
    if any(map(settings.is_property_set, PART_OF)):
        return
    if path.is_file():
        apply_preset(settings, read_preset(path))
    elif has_window:
        settings.samples = FINAL_SAMPLES


class IMPRINT_PT_presets(PresetPanel, bpy.types.Panel):
    """Presets of all settings of a bake"""

    bl_label = "Presets"
    bl_translation_context = LABEL
    preset_subdir = FOLDER
    preset_operator = "imprint.preset_use"
    preset_add_operator = "imprint.preset_add"

    def draw(self, context: bpy.types.Context) -> None:
        folder()
        super().draw(context)
        column = self.layout.column()
        button = column.operator("imprint.preset_add", text=label("Save as My Defaults"), translate=False, icon="HOME")
        button.name = DEFAULTS
        column.operator_context = "INVOKE_DEFAULT"
        column.operator("imprint.preset_load", icon="FILEBROWSER")


class IMPRINT_OT_preset_use(QuickOperator, bpy.types.Operator):
    """Set what the preset holds"""

    bl_idname = "imprint.preset_use"
    bl_label = "Use Preset"
    bl_options = {"REGISTER", "UNDO"}

    filepath: labeled(StringProperty, "File", "File of the preset", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        try:
            return describe(read_preset(Path(properties.filepath)))
        except BakeError as error:
            return str(error)

    def apply(self, context: bpy.types.Context) -> str:
        path = Path(self.filepath)
        values = read_preset(path)
        apply_preset(sets.whole(context), values)
        IMPRINT_PT_presets.bl_label = bpy.path.display_name(path.name)  # as Blender's own presets do
        return describe(values)


class IMPRINT_OT_preset_load(FileOperator, bpy.types.Operator):
    """Copy the file of a preset, of another person for example, to the own presets, and use it. It runs no code"""

    bl_idname = "imprint.preset_load"
    bl_label = "Load Preset"
    bl_options = {"REGISTER", "UNDO"}

    filepath: labeled(StringProperty, "File", "File of the preset", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: file_filter("*.py")

    def apply(self, context: bpy.types.Context) -> str:
        path = Path(bpy.path.abspath(self.filepath))
        values = read_preset(path)
        apply_preset(sets.whole(context), values)
        own = folder() / path.name
        if own.exists():
            return describe(values)
        shutil.copyfile(path, own)
        return f"{own.name}: {describe(values)}"


class IMPRINT_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Save all settings of a bake as a preset, or remove a preset"""

    bl_idname = "imprint.preset_add"
    bl_label = "Add Preset"
    preset_menu = "IMPRINT_PT_presets"
    preset_subdir = FOLDER

    # As in Blender's base class, which has no descriptions.
    remove_name: BoolProperty(
        description="Remove the preset of this name", default=False, options={"HIDDEN", "SKIP_SAVE"}
    )
    remove_active: BoolProperty(
        description="Remove the preset that is shown", default=False, options={"HIDDEN", "SKIP_SAVE"}
    )

    @property
    def preset_defines(self) -> list[str]:
        """How Blender finds the settings: those of the active set, or else of the scene."""
        one = sets.active(bpy.context)
        return [f"settings = bpy.context.scene.{one.path_from_id() + '.own.whole' if one else 'imprint'}"]

    @property
    def preset_values(self) -> list[str]:
        """What Blender writes: all settings, but paths only if they fit more than one object."""
        settings = sets.whole(bpy.context)
        patterns = [name for name in ("output", "export") if naming.has_low(getattr(settings, name))]
        left_out = {"image", "output", "export"}
        names = [name for name in (*PART_OF, *_SWITCHES) if name not in left_out]
        return [f"settings.{name}" for name in (*names, *patterns, "names", "engine_name")]

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self.name == DEFAULTS and not (self.remove_name or self.remove_active):
            (folder() / f"{self.as_filename(DEFAULTS)}.py").unlink(missing_ok=True)  # it is replaced without a question
        return super().execute(context)


_SWITCHES = [name for name, setting in DECLARED.items() if getattr(setting, "empties", None) is not None]
"""The settings that make others None."""


def _use_in_new_file(*_) -> None:
    if not bpy.data.filepath:
        for scene in bpy.data.scenes:
            use_defaults(scene, has_window=not bpy.app.background)


events.hear(load_post=_use_in_new_file)
_at_start = Timer(_use_in_new_file)
CLASSES = (IMPRINT_OT_preset_use, IMPRINT_OT_preset_load, IMPRINT_OT_preset_add, IMPRINT_PT_presets)
_register, unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()
    if not bpy.app.background:  # Blender opens its first file before it enables extensions
        _at_start.start(0.1)
