# SPDX-License-Identifier: GPL-3.0-or-later
"""What is dragged in a view: the line of the split, and the light."""

import bpy
import gpu
from gpu_extras.batch import batch_for_shader
from mathutils import Euler, Vector

from . import view_shading
from .callbacks import Key, registering
from .view_shading import Mode
from .views import viewer

LINE = (0.9, 0.9, 0.9, 0.6)
"""Color of the line."""
REACH = 8.0
"""Distance from the line within which the mouse can drag it, in pixels at a scale of 1."""
TURN = 0.01
"""Radians by which the light turns for a pixel, at a scale of 1."""


class IMPRINT_GT_split(bpy.types.Gizmo):
    """The line of the split, to be dragged."""

    bl_idname = "IMPRINT_GT_split"

    def draw(self, context: bpy.types.Context) -> None:
        x = _line(context)
        program = gpu.shader.from_builtin("UNIFORM_COLOR")
        gpu.state.blend_set("ALPHA")
        gpu.state.line_width_set(2.0 if self.is_highlight else 1.0)
        program.uniform_float("color", LINE[:3] + (1.0,) if self.is_highlight else LINE)
        batch_for_shader(program, "LINES", {"pos": [(x, 0), (x, context.region.height)]}).draw(program)
        gpu.state.line_width_set(1.0)
        gpu.state.blend_set("NONE")

    def test_select(self, context: bpy.types.Context, location: tuple[int, int]) -> int:
        return 0 if abs(location[0] - _line(context)) < REACH * context.preferences.system.ui_scale else -1

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.before = context.scene.imprint_view.split
        self.offset = self.before - event.mouse_region_x / context.region.width
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event, _tweak: set[str]) -> set[str]:
        context.scene.imprint_view.split = event.mouse_region_x / context.region.width + self.offset
        context.area.tag_redraw()
        return {"RUNNING_MODAL"}

    def exit(self, context: bpy.types.Context, cancel: bool) -> None:  # noqa: FBT001 - Blender calls it
        if cancel:
            context.scene.imprint_view.split = self.before


def _line(context: bpy.types.Context) -> int:
    """The x of the line, in pixels of the region."""
    size = context.region.width, context.region.height
    return view_shading.panes(Mode.SPLIT, size, context.scene.imprint_view.split)[1].columns.start


class IMPRINT_GGT_split(bpy.types.GizmoGroup):
    """The group of the line, in 3D viewports with the Split view."""

    bl_idname = "IMPRINT_GGT_split"
    bl_label = "Split"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return viewer.mode is Mode.SPLIT

    def setup(self, _context: bpy.types.Context) -> None:
        self.gizmos.new(IMPRINT_GT_split.bl_idname).use_draw_modal = True


class IMPRINT_OT_view_light(bpy.types.Operator):
    """Turn the light of the view with the mouse"""

    bl_idname = "imprint.view_light"
    bl_label = "Turn Light"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_lit = viewer.mode is not Mode.OFF and not viewer.mode.is_deviation
        return is_lit and context.scene.imprint_view.light is None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.before = tuple(context.scene.imprint_view.direction)
        self.key, self.start = event.type, (event.mouse_x, event.mouse_y)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        view = context.scene.imprint_view
        if event.type in {"ESC", "RIGHTMOUSE"} and event.type != self.key:
            view.direction = self.before
            return {"CANCELLED"}
        if event.type == "MOUSEMOVE":
            turn = TURN / context.preferences.system.ui_scale
            view.direction = turned(
                self.before, (event.mouse_x - self.start[0]) * turn, (event.mouse_y - self.start[1]) * turn
            )
        is_released = event.type == self.key and event.value == "RELEASE"
        return {"FINISHED"} if is_released or event.type == "LEFTMOUSE" else {"RUNNING_MODAL"}


def turned(direction: tuple[float, float, float], right: float, up: float) -> Vector:
    """A direction in view space after a turn to the right and one upwards, in radians, as a ball turns under the mouse."""
    return Euler((-up, right, 0.0), "XYZ").to_matrix() @ Vector(direction)


CLASSES = (IMPRINT_GT_split, IMPRINT_GGT_split, IMPRINT_OT_view_light)
_light_key = Key(IMPRINT_OT_view_light.bl_idname, "RIGHTMOUSE", "3D View", "VIEW_3D", ctrl=True, alt=True)
register, unregister = registering(CLASSES, keys=[_light_key])
