# SPDX-License-Identifier: GPL-3.0-or-later
"""The slots of the high and low objects: their list, and the operators that fill, show and remove objects."""

import bpy
from bpy.props import IntProperty, StringProperty

from ..scene import evaluation, object_checks
from . import object_pairs
from .modal import QuickOperator
from .translations import LABEL


class IMPRINT_OT_show_hidden(QuickOperator, bpy.types.Operator):
    """Show the hidden high objects in the viewport. Without others, they are selected"""

    bl_idname = "imprint.show_hidden"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}

    def apply(self, context: bpy.types.Context) -> str:
        chosen = context.scene.imprint.chosen(context)
        for obj in chosen.hidden(context):
            evaluation.show_object(context, obj)
            if not chosen.highs:
                obj.select_set(True)
        return ""


class IMPRINT_OT_remove_missing(bpy.types.Operator):
    """Remove a high object that was deleted from the slots, or from the pair of the low object"""

    bl_idname = "imprint.remove_missing"
    bl_label = "Remove"
    bl_options = {"REGISTER", "UNDO"}

    high: StringProperty(
        name="High",
        description="Name of the high object; empty for all that are missing",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        chosen = settings.chosen(context)
        for name in [self.high] if self.high else chosen.missing:
            obj = bpy.data.objects.get(name)
            for index in reversed([index for index, slot in enumerate(settings.highs) if slot.title == name]):
                settings.highs.remove(index)
            if chosen.pair is not None:
                chosen.pair.remove(name)
            object_pairs.free(obj)
        return {"FINISHED"}


class IMPRINT_OT_use_selection(bpy.types.Operator):
    """Fill the slots: the active object becomes the low object, the other selected objects with a surface the high objects"""

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
        for obj in context.view_layer.objects.selected:
            if obj != settings.low and object_checks.may_show(obj):
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
    """Remove a slot; its object stays in the scene"""

    bl_idname = "imprint.high_remove"
    bl_label = "Remove High Object"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(
        name="Index",
        description="Index of the slot, from 0; below 0 for the active slot",
        default=-1,
        translation_context=LABEL,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return len(context.scene.imprint.highs) > 0

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        settings.highs.remove(self.index if self.index >= 0 else settings.active_high)
        settings.active_high = max(0, min(settings.active_high, len(settings.highs) - 1))
        return {"FINISHED"}


class IMPRINT_UL_highs(bpy.types.UIList):
    """The slots for high objects."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_property) -> None:
        layout.prop(item, "object", text="", emboss=True)
        if item.called and item.find() is None:
            layout.label(text=item.title, icon="ERROR", translate=False)


CLASSES = (
    IMPRINT_UL_highs,
    IMPRINT_OT_show_hidden,
    IMPRINT_OT_remove_missing,
    IMPRINT_OT_use_selection,
    IMPRINT_OT_high_add,
    IMPRINT_OT_high_remove,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
