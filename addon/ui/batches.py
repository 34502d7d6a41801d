# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes that make many maps: the panels of pairs by name and of sequences, and job files that are sent to a render farm."""

from functools import lru_cache
from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty

from .. import flamenco
from ..core import naming
from ..core.declarations.choices import Storage
from ..core.errors import BakeError
from .modal import QuickOperator
from .sidebar import SettingsPanel, draw_paragraphs
from .translations import LABEL, label, message, tooltip

MODULE = __package__.partition(".addon.")[0]
"""Blender's name for the extension."""


class IMPRINT_AP_preferences(bpy.types.AddonPreferences):
    """What the extension keeps in Blender's preferences."""

    bl_idname = MODULE

    flamenco: StringProperty(
        name="Flamenco Manager",
        description="Address of the Flamenco Manager that gets job files, as http://flamenco.local:8080",
        translation_context=LABEL,
    )

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.prop(self, "flamenco")


def flamenco_address(context: bpy.types.Context) -> str:
    """The address of the Flamenco Manager, or "" if none is set, or if this is no installed extension."""
    own = context.preferences.addons.get(MODULE)
    return own.preferences.flamenco.strip() if own and own.preferences else ""


class IMPRINT_OT_send_to_flamenco(QuickOperator, bpy.types.Operator):
    """Send a job file to the Flamenco Manager in the add-on's preferences. All its machines must see the file"""

    bl_idname = "imprint.send_to_flamenco"
    bl_label = "Send to Flamenco"

    filepath: StringProperty(
        name="Job File",
        description="Job file with the bakes, .toml or .json",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )
    filter_glob: StringProperty(
        name="File Filter",
        description="Names of the files that the file browser lists",
        default="*.toml;*.json",
        options={"HIDDEN", "SKIP_SAVE"},
        translation_context=LABEL,
    )
    shards: IntProperty(
        name="Parts",
        description="Number of parts of about the same cost, each a task",
        default=16,
        min=1,
        max=1000,
        translation_context=LABEL,
    )

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not bpy.app.online_access:
            cls.poll_message_set(tooltip("Allow online access in Blender's preferences first"))
            return False
        return True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def apply(self, context: bpy.types.Context) -> str:
        path = Path(bpy.path.abspath(self.filepath)).absolute()
        job = flamenco.Job(path.stem, {"jobs": str(path), "shards": self.shards})
        if not path.is_file():
            raise BakeError(f"There is no file {str(path)!r}: choose a job file.")
        return f"Sent: {flamenco.submit(flamenco_address(context), job)}"


class IMPRINT_PT_pairs(SettingsPanel, bpy.types.Panel):
    """Bakes many low objects at once: pairs of objects by name."""

    bl_idname = "IMPRINT_PT_pairs"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Pairs by Name"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.imprint
        row = layout.row(align=True)
        for name in ("low_suffix", "high_suffix", "cage_suffix"):
            row.prop(settings, name, text="")
        try:
            found, problems = pairs(tuple(context.view_layer.objects.keys()), settings.suffixes())
        except BakeError as error:
            found, problems = [], [str(error)]
        box = layout.box()
        draw_paragraphs(box, context, [f"{pair.low}: {', '.join(pair.highs)}" for pair in found], "CHECKMARK")
        draw_paragraphs(box, context, problems, "ERROR")
        if not found and not problems:
            draw_paragraphs(box, context, [message("No object name ends with one of these suffixes.")], "INFO")
        layout.prop(settings, "share_image")
        row = layout.row()
        row.enabled = bool(found)
        row.operator("imprint.bake_pairs", icon="RENDER_STILL")
        if flamenco_address(context):
            layout.operator("imprint.send_to_flamenco", icon="EXPORT")


class IMPRINT_PT_sequence(SettingsPanel, bpy.types.Panel):
    """Bakes a map for each frame."""

    bl_idname = "IMPRINT_PT_sequence"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Sequence"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.prop(context.scene, "frame_start", text=label("First"))
        row.prop(context.scene, "frame_end", text=label("Last"))
        row = layout.row()
        row.enabled = context.scene.imprint.storage == Storage.FILE
        row.operator("imprint.bake_sequence", icon="RENDER_ANIMATION")
        if not row.enabled:
            draw_paragraphs(layout, context, [message("Set Store to File to bake a sequence.")], "INFO")


@lru_cache(maxsize=1)
def pairs(names: tuple[str, ...], suffixes: naming.Suffixes) -> tuple[list[naming.Pair], list[str]]:
    """As naming.match. Cached: a redraw matches names only if a name or a suffix has changed."""
    return naming.match(names, suffixes)


CLASSES = (IMPRINT_AP_preferences, IMPRINT_OT_send_to_flamenco, IMPRINT_PT_pairs, IMPRINT_PT_sequence)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
