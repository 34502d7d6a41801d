# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons: context in, bake called, report out."""

import bpy
from bpy.props import CollectionProperty, IntProperty, StringProperty

from .bake import pipeline, subjects
from .bake.errors import BakeError
from .properties import Options


class IMPRINT_OT_bake(bpy.types.Operator, Options):
    """Bake the detail of the high objects into a normal map for the low one"""

    bl_idname = "imprint.bake"
    bl_label = "Bake Normal Map"
    bl_options = {"REGISTER", "UNDO"}

    low: StringProperty(name="Low", description="Name of the low object; empty for the slot or the active object")
    high: CollectionProperty(
        type=bpy.types.OperatorFileListElement,
        name="High",
        description='Names of the high objects, as [{"name": "sculpt"}]; empty for the slots or the selection',
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene_settings = context.scene.imprint
        try:
            low, highs = scene_settings.subjects(context, subjects.named(self.low) if self.low else None)
            if self.high:
                highs = [subjects.named(item.name) for item in self.high]
            if low is None:
                raise BakeError(subjects.problem(context, low, highs))
            report = pipeline.bake(context, low, highs, self.to_settings(fallback=scene_settings))
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for warning in report.warnings:
            self.report({"WARNING"}, warning)
        lines = report.summary()
        self.report({"INFO"}, ". ".join(lines))
        context.window_manager.imprint_summary = "\n".join(lines + report.warnings)
        return {"FINISHED"}


class IMPRINT_OT_use_selection(bpy.types.Operator):
    """Fill the slots: the active object is the low one, the other selected meshes are the high ones"""

    bl_idname = "imprint.use_selection"
    bl_label = "Fill from Selection"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.active_object is not None and context.active_object.type == "MESH"

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        settings.low = context.active_object
        settings.highs.clear()
        for obj in context.selected_objects:
            if obj.type == "MESH" and obj != settings.low:
                settings.highs.add().object = obj
        return {"FINISHED"}


class IMPRINT_OT_high_add(bpy.types.Operator):
    """Add a slot for a high object"""

    bl_idname = "imprint.high_add"
    bl_label = "Add High Object"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        settings.highs.add()
        settings.active_high = len(settings.highs) - 1
        return {"FINISHED"}


class IMPRINT_OT_high_remove(bpy.types.Operator):
    """Remove a slot; the object stays"""

    bl_idname = "imprint.high_remove"
    bl_label = "Remove High Object"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Index", description="Which slot, from 0; below 0 for the active one", default=-1)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return len(context.scene.imprint.highs) > 0

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        settings.highs.remove(self.index if self.index >= 0 else settings.active_high)
        settings.active_high = max(0, min(settings.active_high, len(settings.highs) - 1))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory(
    (IMPRINT_OT_bake, IMPRINT_OT_use_selection, IMPRINT_OT_high_add, IMPRINT_OT_high_remove)
)
