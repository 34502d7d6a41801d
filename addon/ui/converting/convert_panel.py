# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the conversion: the map, and what its colors mean."""

import bpy

from ...core.declarations.choices import Space
from ..panels.sidebar import SettingsPanel, split_layout
from ..translations import label


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


CLASSES = (IMPRINT_PT_convert,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
