# SPDX-License-Identifier: GPL-3.0-or-later
"""Base classes and functions of the panels in the sidebar: their place, and text that wraps."""

import textwrap

import bpy

from .translations import LABEL, message


class SidebarPanel:
    """A panel in the "Imprint" tab of the 3D viewport's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Imprint"
    bl_translation_context = LABEL


class SettingsPanel(SidebarPanel):
    """A panel of settings, below the panels about the last bake."""

    bl_order = 1


def split_layout(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """The same layout, which draws properties as a name on the left and a field on the right."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout


def draw_paragraphs(layout: bpy.types.UILayout, context: bpy.types.Context, lines: list[str], icon: str) -> None:
    """Draw lines, translated and wrapped to the width of the sidebar; Blender's labels do not wrap by themselves."""
    width = max(20, int(context.region.width / (7.0 * context.preferences.system.ui_scale)) - 6)
    column = layout.column(align=True)
    for line in lines:
        for number, part in enumerate(textwrap.wrap(message(line), width)):
            column.label(text=part, icon="BLANK1" if number else icon, translate=False)
