# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators of the views, and the key that shows the next one."""

import bpy
from bpy.props import EnumProperty

from ...core.progress import Pace, Task
from ...views.mode_names import ITEMS, Mode
from ..callbacks import Key
from ..live.live_switch import live
from ..modal import SlicedOperator
from ..translations import LABEL
from .progress_display import display
from .view_mode import viewer


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


CLASSES = (IMPRINT_OT_view_show, IMPRINT_OT_view_next, IMPRINT_OT_view_refresh)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)
_next_key = Key(IMPRINT_OT_view_next.bl_idname, "N", "3D View", "VIEW_3D", ctrl=True, alt=True)


def register() -> None:
    _register()
    _next_key.add()


def unregister() -> None:
    _next_key.remove()
    _unregister()
