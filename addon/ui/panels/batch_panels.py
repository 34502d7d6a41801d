# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels of bakes that make many maps: pairs by name, and sequences."""

from functools import lru_cache

import bpy

from ...core.declarations.choices import Storage
from ...core.errors import BakeError
from ...core.names import name_matching
from ..sending import farm_preferences
from ..translations import label, message
from .sidebar import SettingsPanel, draw_paragraphs


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
        if farm_preferences.flamenco_address(context):
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
def pairs(names: tuple[str, ...], suffixes: name_matching.Suffixes) -> tuple[list[name_matching.Pair], list[str]]:
    """As name_matching.match. Cached: a redraw matches names only if a name or a suffix has changed."""
    return name_matching.match(names, suffixes)


CLASSES = (IMPRINT_PT_pairs, IMPRINT_PT_sequence)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
