# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail: their operator and panel."""

import bpy

from ..core import levels, progress
from ..core.errors import BakeError
from ..core.levels import ChainReport
from ..export import engine_files
from ..jobs import lod
from . import modal
from .sidebar import SettingsPanel, split_layout


class IMPRINT_OT_make_levels(modal.MapOperator, bpy.types.Operator):
    """Make coarser copies of the active mesh with the same UV layout, each with its own map, as coarse as the limits allow"""

    bl_idname = "imprint.make_levels"
    bl_label = "Make Levels of Detail"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task[ChainReport]:
        settings = context.scene.imprint
        if context.active_object is None:
            raise BakeError("No object is active: select the mesh to make levels of.")
        limits = levels.limits(settings.level_degrees, settings.level_distance)
        if settings.export:
            engine_files.check_levels(settings.export, len(limits))
        return (yield from lod.work(context, context.active_object, limits, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ChainReport) -> None:
        lines, warnings = result.summary(), list(result.warnings)
        if context.scene.imprint.export:
            try:
                done = engine_files.export_levels(
                    context, [level.bake for level in result.levels], context.scene.imprint.export
                )
            except BakeError as error:  # the levels are made
                warnings.append(str(error))
            else:
                warnings += dict.fromkeys(text for each in done for text in each.warnings)
                paths = dict.fromkeys(path for each in done for path in each.paths)
                lines.append(f"Wrote {', '.join(paths)}")
        self.show(context, lines, warnings)


class IMPRINT_PT_levels(SettingsPanel, bpy.types.Panel):
    """Makes coarser meshes with the UV layout of the active one."""

    bl_idname = "IMPRINT_PT_levels"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Levels of Detail"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        column = split_layout(layout.column())
        for name in ("level_degrees", "level_distance", "export"):
            column.prop(context.scene.imprint, name)
        layout.operator("imprint.make_levels", icon="MOD_DECIM")


CLASSES = (IMPRINT_OT_make_levels, IMPRINT_PT_levels)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
