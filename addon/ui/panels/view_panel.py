# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the views: the mode, its settings, and the measured deviations."""

import bpy

from ...core.declarations import readers
from ...core.declarations.choices import Space
from ...jobs.live_session import Session
from ...views.mode_names import Mode
from ..translations import message
from ..viewport import view_drawing
from ..viewport.progress_display import display
from ..viewport.view_mode import viewer
from .sidebar import SidebarPanel, draw_paragraphs, split_layout

GREEN = "{reader} reads green as {wanted}, and the map stores {stored}: the preset {preset} of the Map panel sets it."


class IMPRINT_PT_view(SidebarPanel, bpy.types.Panel):
    """The view of the map in the 3D viewports."""

    bl_idname = "IMPRINT_PT_view"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "View"

    def draw(self, context: bpy.types.Context) -> None:
        layout, view = split_layout(self.layout), context.scene.imprint_view
        row = layout.row(align=True)
        row.enabled = display.current is None
        row.prop(view, "mode")
        row.operator("imprint.view_refresh", text="", icon="FILE_REFRESH")
        if viewer.is_outdated(context):
            draw_paragraphs(layout, context, [message("The settings have changed: refresh the view.")], "INFO")
        if viewer.mode is not Mode.OFF and context.scene.imprint.space == Space.TANGENT:
            layout.prop(view, "reader")
            draw_paragraphs(layout, context, _green_problem(view.reader, viewer.session), "INFO")
        if viewer.mode in {Mode.MAP, Mode.SPLIT}:
            layout.prop(view, "light")
        if viewer.mode is Mode.SPLIT:
            layout.prop(view, "split")
        if viewer.mode.is_deviation:
            layout.prop(view, "limit")
            lines = view_drawing.description(viewer.figures)
            draw_paragraphs(layout.box(), context, lines, "DRIVER_ROTATIONAL_DIFFERENCE")
        if viewer.message:
            draw_paragraphs(layout.box(), context, [viewer.message], "ERROR")


def _green_problem(name: str, session: Session | None) -> list[str]:
    """Why the program of this name shows the map with green upside down, in a sentence; empty if it does not."""
    reader = readers.BY_NAME.get(name)
    if reader is None or session is None or session.settings.green == reader.green:
        return []
    stored = session.settings.green
    return [message(GREEN).format(reader=reader.label, wanted=reader.green, stored=stored, preset=reader.preset)]


CLASSES = (IMPRINT_PT_view,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
