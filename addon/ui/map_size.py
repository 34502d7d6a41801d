# SPDX-License-Identifier: GPL-3.0-or-later
"""The size of the map: one number for both sides or one for each, and a menu of common sizes."""

import bpy
from bpy.props import FloatProperty, IntProperty

from ..core.declarations.map_settings import MAX_SIZE
from .translations import LABEL, label

COMMON_SIZES = (512, 1024, 2048, 4096, 8192)


class IMPRINT_OT_resize(bpy.types.Operator):
    """Change the size of the map; a map that is not square keeps its shape"""

    bl_idname = "imprint.resize"
    bl_label = "Resize Map"
    bl_options = {"REGISTER", "UNDO"}

    side: IntProperty(
        name="Side",
        description="Texels along the longer side; 0 to scale",
        default=0,
        min=0,
        max=MAX_SIZE,
        translation_context=LABEL,
    )
    factor: FloatProperty(
        name="Factor",
        description="By how much both sides are scaled",
        default=1.0,
        min=0.0,
        max=64.0,
        translation_context=LABEL,
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        factor = self.side / max(settings.width, settings.height) if self.side else self.factor
        # The properties keep each side within its limits.
        settings.width, settings.height = (round(side * factor) for side in (settings.width, settings.height))
        return {"FINISHED"}


class IMPRINT_MT_size(bpy.types.Menu):
    """Common sizes of maps."""

    bl_idname = "IMPRINT_MT_size"
    bl_label = "Size"
    bl_translation_context = LABEL

    def draw(self, _context: bpy.types.Context) -> None:
        for side in COMMON_SIZES:
            self.layout.operator("imprint.resize", text=str(side), translate=False).side = side
        self.layout.separator()
        for text, factor in ((label("Double"), 2.0), (label("Halve"), 0.5)):
            self.layout.operator("imprint.resize", text=text, translate=False).factor = factor


def draw(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """The size in a panel, with its menu."""
    is_square = settings.square and settings.width == settings.height
    column = layout.column(align=True)
    row = column.row(align=True)
    row.prop(settings, "size" if is_square else "width")
    row.prop(settings, "square", text="", icon="LINKED" if is_square else "UNLINKED")
    row.menu(IMPRINT_MT_size.bl_idname, text="", icon="DOWNARROW_HLT")
    if not is_square:
        column.prop(settings, "height")


CLASSES = (IMPRINT_OT_resize, IMPRINT_MT_size)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
