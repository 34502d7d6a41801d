# SPDX-License-Identifier: GPL-3.0-or-later
"""The conversion of an existing map: its operator and panel."""

from dataclasses import fields

import bpy

from ..core.conversion import ConversionReport, StoredNormals
from ..core.declarations.choices import Space
from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..jobs import convert
from ..jobs.convert import Conversion
from . import modal
from .sidebar import SettingsPanel, split_layout
from .translations import label


class IMPRINT_OT_convert(modal.MapOperator, bpy.types.Operator):
    """Make a new normal map for the low-poly object of the chosen one, in the space and the basis of the panel Map"""

    bl_idname = "imprint.convert"
    bl_label = "Convert"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[ConversionReport]:
        settings = context.scene.imprint
        chosen = settings.chosen(context)
        if chosen.low is None:
            raise BakeError("No low object: select it, or fill the slot.")
        if settings.convert_image is None:
            raise BakeError("No map to convert: choose an image.")
        before = StoredNormals(**{field.name: getattr(settings, field.name) for field in fields(StoredNormals)})
        conversion = Conversion(chosen.low, settings.convert_image, before, is_own_base=chosen.low in chosen.highs)
        return (yield from convert.work(context, conversion, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ConversionReport) -> None:
        self.show(context, result.summary(), result.warnings)


class IMPRINT_PT_convert(SettingsPanel, bpy.types.Panel):
    """Converts an existing map into the space and the basis of the panel Map."""

    bl_idname = "IMPRINT_PT_convert"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Convert Map"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = split_layout(self.layout)
        settings = context.scene.imprint
        layout.template_ID(settings, "convert_image", open="image.open", text=label("Map"), translate=False)
        layout.prop(settings, "from_space")
        if settings.from_space == Space.TANGENT:
            layout.prop(settings, "from_basis")
        column = layout.column(align=True)
        for name in ("from_red", "from_green", "from_blue"):
            column.prop(settings, name)
        row = layout.row()
        row.enabled = settings.convert_image is not None
        row.operator("imprint.convert", icon="FILE_REFRESH")


CLASSES = (IMPRINT_OT_convert, IMPRINT_PT_convert)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
