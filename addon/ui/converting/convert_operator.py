# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that converts an existing map with the settings of the panels."""

from dataclasses import fields

import bpy

from ...core.conversion.conversion_report import ConversionReport
from ...core.conversion.stored_normals import StoredNormals
from ...core.errors import BakeError
from ...core.progress import Pace, Task
from ...jobs import convert
from ...jobs.convert import Conversion
from .. import modal


class IMPRINT_OT_convert(modal.MapOperator, bpy.types.Operator):
    """Make a new normal map for the low-poly object of the chosen one, in the space and the basis of the panel Map"""

    bl_idname = "imprint.convert"
    bl_label = "Convert"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[ConversionReport]:
        settings = context.scene.imprint
        low, highs = settings.chosen_objects(context)
        if low is None:
            raise BakeError("No low object: select it, or fill the slot.")
        if settings.convert_image is None:
            raise BakeError("No map to convert: choose an image.")
        before = StoredNormals(**{field.name: getattr(settings, field.name) for field in fields(StoredNormals)})
        conversion = Conversion(low, settings.convert_image, before, is_own_base=low in highs)
        return (yield from convert.work(context, conversion, settings.to_settings(), pace))

    def finish(self, context: bpy.types.Context, result: ConversionReport) -> None:
        self.show(context, result.summary(), result.warnings)


CLASSES = (IMPRINT_OT_convert,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
