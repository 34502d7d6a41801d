# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of the panels that do not bake: slots, measured distances, materials, images, and visibility in the viewport."""

import bpy
from bpy.props import IntProperty, StringProperty

from ..core.errors import BakeError
from ..output import map_images, materials, outputs
from ..scene import instances, visibility
from . import object_pairs
from .bake_results import distances, high_objects, results
from .callbacks import redraw
from .translations import LABEL, tooltip
from .viewport import show_result
from .viewport.cage_overlay import overlay


class IMPRINT_OT_freeze_distances(bpy.types.Operator):
    """Set Extrusion and Max Distance to what the last bake of this low object measured"""

    bl_idname = "imprint.freeze_distances"
    bl_label = "Freeze Distances"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not distances(results.of(context)):
            cls.poll_message_set(tooltip("Bake this low object first, with Measure Distances on"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings, found = context.scene.imprint, distances(results.of(context))
        rays = settings.rays_of(*settings.chosen_objects(context))
        rays.extrusion, rays.max_distance = found["extrusion"], found["max_distance"]
        rays.measure = False
        return {"FINISHED"}


class IMPRINT_OT_connect_maps(bpy.types.Operator):
    """Put the maps of the last bake into the low object's material: colors, roughness, metallic, occlusion and height"""

    bl_idname = "imprint.connect_maps"
    bl_label = "Connect Maps"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not any(map_images.are_any(report.maps) for report in results.all_of(context)):
            cls.poll_message_set(tooltip("Bake a map first that a material takes, such as base color"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        reports, warnings = results.all_of(context), []
        try:
            low = reports[0].refs[0].resolve()
            materials.check(low, can_be_off=False)
            for report in reports:
                warnings += outputs.connect_maps(
                    low,
                    report.maps,
                    report.uv_layer,
                    space=report.space,
                    single_user=context.scene.imprint.single_user,
                    slots=report.slots or None,
                )
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for warning in dict.fromkeys(warnings):
            self.report({"WARNING"}, warning)
        return {"FINISHED"}


class IMPRINT_OT_show_map(bpy.types.Operator):
    """Show an image of the last bake in an open Image Editor, or else in a new window"""

    bl_idname = "imprint.show_map"
    bl_label = "Show Map"

    image: StringProperty(
        name="Image", description="Name of the image; empty for the first one", translation_context=LABEL
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.of(context) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        name = self.image or results.of(context).image
        shown = bpy.data.images.get(name)
        if shown is None:
            self.report({"ERROR"}, f"The image {name!r} was undone, renamed or deleted: bake again.")
            return {"CANCELLED"}
        is_pressed = self.options.is_invoke and context.window is not None
        show = show_result.image_in_window if is_pressed else show_result.image
        show(context, shown)
        redraw()
        return {"FINISHED"}


class IMPRINT_OT_show_high(bpy.types.Operator):
    """Hide the high objects of the last bake to see the low object with its map, or show them again"""

    bl_idname = "imprint.show_high"
    bl_label = "Show High"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        report = results.of(context)
        return report is not None and bool(high_objects(report))

    def execute(self, context: bpy.types.Context) -> set[str]:
        report = results.of(context)
        show_result.hide_high(context, report, hide=not show_result.hides_high(report))
        return {"FINISHED"}


class IMPRINT_OT_show_hidden(bpy.types.Operator):
    """Show the hidden high objects in the viewport. Without others, they are selected"""

    bl_idname = "imprint.show_hidden"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        low, highs = context.scene.imprint.chosen_objects(context)
        for obj in context.scene.imprint.hidden(context, low, highs):
            try:
                visibility.show(context, obj)
            except BakeError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            if not highs:
                obj.select_set(True)
        return {"FINISHED"}


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
        low, highs = settings.chosen_objects(context)
        pair, missing = settings.pair_of(low, highs), settings.missing(context, low, highs)
        for name in [self.high] if self.high else missing:
            obj = bpy.data.objects.get(name)
            for index in reversed([index for index, slot in enumerate(settings.highs) if slot.title == name]):
                settings.highs.remove(index)
            if pair is not None:
                pair.remove(name)
            object_pairs.free(obj)
        return {"FINISHED"}


class IMPRINT_OT_show_cage(bpy.types.Operator):
    """Show or hide two shells around the low mesh: where rays start (blue) and where they end (orange)"""

    bl_idname = "imprint.show_cage"
    bl_label = "Show Cage"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if overlay.is_on:
            overlay.hide()
        else:
            overlay.show()
            try:
                overlay.measure(context)
            except BakeError as error:  # the shells are drawn as far as they are known
                self.report({"WARNING"}, str(error))
        redraw()
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
            if obj != settings.low and instances.may_show(obj):
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


CLASSES = (
    IMPRINT_OT_freeze_distances,
    IMPRINT_OT_connect_maps,
    IMPRINT_OT_show_map,
    IMPRINT_OT_show_high,
    IMPRINT_OT_show_hidden,
    IMPRINT_OT_remove_missing,
    IMPRINT_OT_show_cage,
    IMPRINT_OT_use_selection,
    IMPRINT_OT_high_add,
    IMPRINT_OT_high_remove,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
