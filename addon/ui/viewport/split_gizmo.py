# SPDX-License-Identifier: GPL-3.0-or-later
"""The lines of the Split view, which can be dragged."""

import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ...views import view_shading
from ...views.mode_names import Mode
from .view_mode import viewer

LINE = (0.9, 0.9, 0.9, 0.6)
"""Color of the lines."""
REACH = 8.0
"""Distance from a line within which the mouse can drag it, in pixels at a scale of 1."""


class IMPRINT_GT_split(bpy.types.Gizmo):
    """The lines of the split, to be dragged."""

    bl_idname = "IMPRINT_GT_split"

    def draw(self, context: bpy.types.Context) -> None:
        region, view = context.region, context.scene.imprint_view
        _, low, _ = view_shading.zones(region.width, view.split)
        points = [(x, y) for x in (low.start, low.stop) for y in (0, region.height)]
        program = gpu.shader.from_builtin("UNIFORM_COLOR")
        gpu.state.blend_set("ALPHA")
        gpu.state.line_width_set(2.0 if self.is_highlight else 1.0)
        program.uniform_float("color", LINE[:3] + (1.0,) if self.is_highlight else LINE)
        batch_for_shader(program, "LINES", {"pos": points}).draw(program)
        gpu.state.line_width_set(1.0)
        gpu.state.blend_set("NONE")

    def test_select(self, context: bpy.types.Context, location: tuple[int, int]) -> int:
        _, low, _ = view_shading.zones(context.region.width, context.scene.imprint_view.split)
        reach = REACH * context.preferences.system.ui_scale
        return 0 if min(abs(location[0] - low.start), abs(location[0] - low.stop)) < reach else -1

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


class IMPRINT_GGT_split(bpy.types.GizmoGroup):
    """The group of the lines, in 3D viewports with the Split view."""

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


CLASSES = (IMPRINT_GT_split, IMPRINT_GGT_split)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
