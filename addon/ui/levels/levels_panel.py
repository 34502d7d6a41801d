# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of levels of detail."""

import bpy

from ..panels.sidebar import SettingsPanel, split_layout


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


CLASSES = (IMPRINT_PT_levels,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
