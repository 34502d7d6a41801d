# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that makes levels of detail."""

from functools import partial

import bpy

from ... import older_blender
from ...core import progress
from ...core.errors import BakeError
from ...core.levels import level_report
from ...core.levels.level_report import ChainReport
from ...jobs.lod import level_chain
from .. import modal
from ..live.live_switch import live
from ..translations.lookup import tooltip
from ..viewport.progress_display import display


class IMPRINT_OT_make_levels(modal.SlicedOperator, bpy.types.Operator):
    """Make coarser copies of the active mesh with the same UV layout, each with its own map, as coarse as the limits allow"""

    bl_idname = "imprint.make_levels"
    bl_label = "Make Levels of Detail"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if live.is_on:
            cls.poll_message_set(tooltip("Stop Live first: it writes to the same image"))
            return False
        return display.current is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        return older_blender.with_gpu(partial(super().execute, context))

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task[ChainReport]:
        settings = context.scene.imprint
        if context.active_object is None:
            raise BakeError("No object is active: select the mesh to make levels of.")
        limits = level_report.limits(settings.level_degrees, settings.level_distance)
        return (yield from level_chain.work(context, context.active_object, limits, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ChainReport) -> None:
        for warning in result.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, ". ".join(result.summary()))
        manager = context.window_manager
        manager.imprint_summary, manager.imprint_warnings = "\n".join(result.summary()), "\n".join(result.warnings)


CLASSES = (IMPRINT_OT_make_levels,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
