# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the views, its settings and operators. They do not change the map."""

import bpy
from bpy.props import EnumProperty, FloatProperty, PointerProperty

from ..core.declarations import readers
from ..core.declarations.choices import Space
from ..core.progress import Pace, Task
from ..jobs.live_session import Session
from ..views.view_shading import ITEMS, READERS, Mode
from . import view_mode
from .callbacks import Key
from .live_switch import live
from .modal import SlicedOperator
from .progress_display import display
from .sidebar import SidebarPanel, draw_paragraphs, split_layout
from .translations import LABEL, message
from .view_mode import viewer


def _get_mode(_view: bpy.types.PropertyGroup) -> int:
    return list(Mode).index(viewer.mode)


def _set_mode(_view: bpy.types.PropertyGroup, number: int) -> None:
    viewer.choose(list(Mode)[number])


def _read_again(_view: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    viewer.read_again()


def _is_light(_view: bpy.types.PropertyGroup, obj: bpy.types.Object) -> bool:
    return obj.type == "LIGHT"


class ImprintView(bpy.types.PropertyGroup):
    """Scene.imprint_view: what the 3D viewports show of the map. The mode belongs to the session and is not saved."""

    mode: EnumProperty(
        name="View",
        description="What the 3D viewport shows",
        items=ITEMS,
        get=_get_mode,
        set=_set_mode,
        options=set(),
        translation_context=LABEL,
    )
    reader: EnumProperty(
        name="Target Program",
        description="Program as which the view reads a tangent-space map. It shows what the program would show of this map",
        items=READERS,
        update=_read_again,
        options=set(),
        translation_context=LABEL,
    )
    light: PointerProperty(
        type=bpy.types.Object,
        name="Light",
        description="The light that shines on the mesh; without one, a light that follows the view",
        poll=_is_light,
        translation_context=LABEL,
    )
    split: FloatProperty(
        name="Line",
        description="Position of the line between high and low, as a share of the view's width",
        default=0.4,  # left of the middle, because the sidebar covers the right end
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        translation_context=LABEL,
    )
    limit: FloatProperty(
        name="Range",
        description="Degrees at the end of the color scale",
        default=5.0,
        min=0.01,
        max=180.0,
        soft_max=45.0,
        translation_context=LABEL,
    )


class _Show(SlicedOperator):
    """Shows a mode. If it needs a map, the map is drawn in slices."""

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None

    def wanted(self) -> Mode:
        raise NotImplementedError

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[None]:
        yield from viewer.switching(context, self.wanted(), pace)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # Without a map to draw, there is nothing to wait for.
        is_quick = self.wanted() is Mode.OFF or viewer.session is not None
        return self.execute(context) if is_quick else super().invoke(context, event)


class IMPRINT_OT_view_show(_Show, bpy.types.Operator):
    """Show in the 3D viewport what the map does"""

    bl_idname = "imprint.view_show"
    bl_label = "Show View"

    mode: EnumProperty(name="View", description="What the 3D viewport shows", items=ITEMS, translation_context=LABEL)

    def wanted(self) -> Mode:
        return Mode(self.mode)


class IMPRINT_OT_view_next(_Show, bpy.types.Operator):
    """Show the next view: map, split, deviation, deviation without the map, off"""

    bl_idname = "imprint.view_next"
    bl_label = "Next View"

    def wanted(self) -> Mode:
        return viewer.mode.next


class IMPRINT_OT_view_refresh(SlicedOperator, bpy.types.Operator):
    """Draw the map of the view again, from the current objects and settings"""

    bl_idname = "imprint.view_refresh"
    bl_label = "Refresh View"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None and viewer.mode is not Mode.OFF and not live.is_on

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[None]:
        yield from viewer.switching(context, viewer.mode, pace, redrawn=True)


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
            lines = view_mode.describe_deviations(viewer.deviations)
            draw_paragraphs(layout.box(), context, lines, "DRIVER_ROTATIONAL_DIFFERENCE")
        if viewer.message:
            draw_paragraphs(layout.box(), context, [viewer.message], "ERROR")


def _green_problem(name: str, session: Session | None) -> list[str]:
    """Why the program of this name shows the map with green upside down, in a sentence; empty if it does not."""
    reader = readers.BY_NAME.get(name)
    if reader is None or session is None or session.settings.map.green == reader.green:
        return []
    stored = session.settings.map.green
    return [message(GREEN).format(reader=reader.label, wanted=reader.green, stored=stored, preset=reader.preset)]


CLASSES = (ImprintView, IMPRINT_OT_view_show, IMPRINT_OT_view_next, IMPRINT_OT_view_refresh, IMPRINT_PT_view)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)
_next_key = Key(IMPRINT_OT_view_next.bl_idname, "N", "3D View", "VIEW_3D", ctrl=True, alt=True)


def register() -> None:
    _register()
    bpy.types.Scene.imprint_view = PointerProperty(type=ImprintView)
    _next_key.add()


def unregister() -> None:
    _next_key.remove()
    del bpy.types.Scene.imprint_view
    _unregister()
