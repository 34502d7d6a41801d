# SPDX-License-Identifier: GPL-3.0-or-later
"""The views of the map in the 3D viewports: which mode is on, which map it shows, and how it is drawn."""

from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from bpy.props import EnumProperty, FloatProperty, PointerProperty
from gpu_extras.batch import batch_for_shader

from ..core import progress
from ..core.declarations import targets
from ..core.declarations.choices import Space
from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..core.settings import Settings
from ..jobs import live_session
from ..jobs.live_session import Session
from . import progress_display, view_shading
from .callbacks import DrawCallbacks, Key, Timer, redraw
from .declared_properties import passed_on
from .live import live
from .local_view import hiding
from .modal import SlicedOperator
from .progress_display import display
from .texts import SidebarPanel, draw_paragraphs, label, labeled, message, split_layout
from .view_shading import ITEMS, OWN, TARGETS, Mode

HEADLIGHT = np.array((-0.6, 0.7, 1.0, 0.0))
"""Direction to the view's own light, in view space: slightly from above and from the left."""
BAR = (240.0, 12.0)
"""Width and height of the legend, in pixels at a scale of 1."""
EDGE, TEXT = 60.0, progress_display.TEXT_SIZE
"""Height of the labels above the lower edge, and their size, in pixels at a scale of 1."""
SHOWN_SHARE = 0.0005
"""The share of texels that are not measured is shown from this value: the text has one decimal of a percent."""
DEGREES = "\N{DEGREE SIGN}"


def draw_mesh(context: bpy.types.Context, shading: view_shading.Shading, mode: Mode, *, is_alone: bool) -> None:
    """Draw the meshes into a view, and the legend of the deviations. is_alone: whether the high objects are hidden there."""
    view = context.scene.imprint_view
    shading.draw(mode, eye(context.region_data, view.light), split=view.split, limit=view.limit, is_alone=is_alone)
    if mode.is_deviation:
        scale = context.preferences.system.ui_scale
        shading.draw_legend(_bar_position(context.region, scale), (BAR[0] * scale, BAR[1] * scale))


def draw_labels(context: bpy.types.Context, mode: Mode, deviations: view_shading.Deviations | None) -> None:
    """Write the names of a view's parts over it, or the measured deviations."""
    view, region, scale = context.scene.imprint_view, context.region, context.preferences.system.ui_scale
    if mode is Mode.SPLIT:
        parts = ((label("High"), 1.0), (label("Low"), 0.5), (label("Low with Map"), 0.0))
        for zone, (text, share) in zip(view_shading.zones(region.width, view.split), parts, strict=True):
            width = progress_display.text_width(text, scale)
            x = label_position(zone, width, share, visible_columns(context), TEXT * scale)
            if x is not None:
                progress_display.write_text(text, x, EDGE * scale, scale)
    elif mode.is_deviation:
        x, y = _bar_position(region, scale)
        for end, degrees in ((0.0, 0.0), (1.0, view.limit)):
            progress_display.write_text(
                f"{degrees:.3g}{DEGREES}", x + end * BAR[0] * scale, y - 1.5 * TEXT * scale, scale, 0.5
            )
        for number, line in enumerate(reversed(describe_deviations(deviations))):
            progress_display.write_text(
                line, region.width / 2, y + (BAR[1] + TEXT * (1.5 * number + 0.7)) * scale, scale, 0.5
            )


def describe_deviations(deviations: view_shading.Deviations | None) -> list[str]:
    """The deviations in two lines, and the share that was not measured in a third; empty without deviations."""
    if deviations is None:
        return []
    elsewhere = []
    if deviations.elsewhere >= SHOWN_SHARE:
        text = message("Purple: {} shows another place of the high mesh and is not measured: cast rays")
        elsewhere = [text.format(f"{deviations.elsewhere:.1%}")]
    if deviations.elsewhere == 1.0:
        return elsewhere
    return elsewhere + [
        text.format(f"{mean:.2f}{DEGREES}", f"{most:.2f}{DEGREES}")
        for text, mean, most in (
            (message("With the map: mean {}, 99 % below {}"), deviations.mean, deviations.percentile_99),
            (message("Without: mean {}, 99 % below {}"), deviations.bare_mean, deviations.bare_percentile_99),
        )
    ]


def visible_columns(context: bpy.types.Context) -> tuple[int, int]:
    """The first and last x, in pixels of the region, between the toolbar and the sidebar that lie over it."""
    region = context.region
    left, right = 0, region.width
    for other in context.area.regions:
        if other.type in {"TOOLS", "UI"} and other.width > 1:  # 1 where it is hidden
            if other.alignment == "LEFT":
                left = max(left, other.x + other.width - region.x)
            elif other.alignment == "RIGHT":
                right = min(right, other.x - region.x)
    return left, right


def label_position(zone: range, width: float, share: float, visible: tuple[int, int], gap: float) -> float | None:
    """The x where a label of this width begins, in the visible part of its zone with a gap at both ends. `share` of the free
    room is on its left. None if it does not fit."""
    start, stop = max(zone.start, visible[0]) + gap, min(zone.stop, visible[1]) - gap
    return start + (stop - start - width) * share if stop - start >= width else None


def eye(region_data: bpy.types.RegionView3D, light: bpy.types.Object | None) -> view_shading.Eye:
    """The camera of a view, and its light: an object, or the view's own for None."""
    view = np.array(region_data.view_matrix, np.float64)
    if light is None:
        towards = view.T @ HEADLIGHT  # a view matrix rotates and does not scale
        towards[3] = 0.0
    elif light.data.type == "SUN":
        towards = np.array(light.matrix_world.col[2])
    else:
        towards = np.array(light.matrix_world.col[3])
    return view_shading.Eye(view, np.array(region_data.window_matrix, np.float64), towards)


def _bar_position(region: bpy.types.Region, scale: float) -> tuple[float, float]:
    return (region.width - BAR[0] * scale) / 2, EDGE * scale


RETRY = 0.5
"""Seconds until a view that waits for a bake checks again."""


@dataclass(frozen=True)
class OwnMap:
    """A map that was drawn only for the views, and the settings of the panel that it was drawn with."""

    session: live_session.Session
    settings: Settings


class ViewMode:
    """Shows one of the modes for Live's map, or for a map drawn for the views.

    mode: the one that is on. message: why the view was turned off, in a sentence; empty if it was not, or if the user turned
    it off. shading: the object that draws, or None. own: the map for the views while Live is off, or None.
    """

    def __init__(self):
        self.mode = Mode.OFF
        self.message = ""
        self.shading: view_shading.Shading | None = None
        self.own: OwnMap | None = None
        self.timer = Timer(self.catch_up)
        self._draw_callbacks = DrawCallbacks(
            (bpy.types.SpaceView3D, self.draw, "POST_VIEW"), (bpy.types.SpaceView3D, self._draw_labels, "POST_PIXEL")
        )

    @property
    def is_idle(self) -> bool:
        """Whether the view is off, and no map, draw callback or timer remains."""
        is_used = self.own or self.shading or self._draw_callbacks.are_added or self.timer.is_running
        return self.mode is Mode.OFF and not is_used

    @property
    def session(self) -> live_session.Session | None:
        """The session whose map is shown: Live's as soon as it has a map."""
        if live.is_on and live.session.drawn:
            return live.session
        return self.own.session if self.own is not None else None

    @property
    def deviations(self) -> view_shading.Deviations | None:
        """The deviations of the shown map, after a mode that measures them was on."""
        return self.shading.deviations if self.shading is not None else None

    def switch(self, context: bpy.types.Context, wanted: Mode) -> None:
        """Do the whole task of `switching` at once."""
        progress.finish(self.switching(context, wanted, progress.Pace()))

    def switching(
        self, context: bpy.types.Context, wanted: Mode, pace: progress.Pace, *, redrawn: bool = False
    ) -> progress.Task[None]:
        """Show a mode. A map is drawn first if there is none, or if it is to be `redrawn`.

        Raises BakeError if there is nothing to show, and then the view is off. A task that is closed changes nothing.
        """
        self.message = ""
        if wanted is Mode.OFF:
            self.off()
            return
        try:
            if redrawn or self.session is None:
                own = yield from _drawn_map(context, pace)
                self.free()
                self.own = own
            self.mode = wanted
            self._update_shading()
        except BakeError:
            self.off()
            raise
        self._draw_callbacks.add()

    def choose(self, wanted: Mode) -> None:
        """Show a mode, in slices if there is a window. Problems are in `message`. A running bake finishes first."""
        if display.current is not None:
            return
        try:
            self._ask_for(wanted)
        except BakeError as error:
            self.message = str(error)

    def off(self) -> None:
        """Turn the view off. No draw callback, timer or map remains."""
        self.mode = Mode.OFF
        self._draw_callbacks.remove()
        self.timer.stop()
        hiding.stop()
        self.free()
        redraw()

    def free(self) -> None:
        """Free the view's GPU memory."""
        if self.own is not None:
            self.own.session.free()
        self.own = self.shading = None

    def catch_up(self) -> float | None:
        """Show the map that Live has drawn since the last time, or draw a map for the view after Live was turned off."""
        if self.mode is Mode.OFF:
            return None
        if display.current is not None:
            return RETRY
        try:
            if self.session is not None:
                self._update_shading()
            else:
                self._ask_for(self.mode)
        except BakeError as error:
            self.off()
            self.message = str(error)
        return None

    def read_again(self) -> None:
        """Show the same map as another program reads it."""
        if self.mode is not Mode.OFF and self.shading is not None and display.current is None:
            self._update_shading()

    def is_outdated(self, context: bpy.types.Context) -> bool:
        """Whether the settings have changed since the map that is shown was drawn."""
        if self.own is None:
            return False
        return self.own.settings != context.scene.imprint.settings_of(self.own.session.job)

    def shading_for(self, context: bpy.types.Context) -> view_shading.Shading | None:
        """The shading for the viewport that Blender is drawing; None if the low object is not visible there."""
        session = self.session
        if self.shading is None or self.shading.session is not session:
            self.timer.start()  # Live was switched on or off; nothing is baked while a view is being drawn
            return None
        return self.shading if _is_low_visible(session, context) else None

    def high_objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The high objects to hide, because the view draws the low object in their place; none if the low object is not
        visible."""
        session = self.session
        if session is None or not _is_low_visible(session, context):
            return []
        low, *highs = (ref.find() for ref in (session.job.low_ref, *session.job.high_refs))
        return [obj for obj in highs if obj is not None and obj != low]

    def draw(self) -> None:
        """Called by Blender for each 3D viewport that it draws."""
        context = bpy.context
        highs = self.high_objects(context)
        # Strokes need the object that they are drawn on.
        hiding.ask(context, [obj for obj in highs if obj.mode == "OBJECT"])
        shading = self.shading_for(context)
        if shading is not None:
            is_alone = hiding.are_out(context.space_data, highs)
            draw_mesh(context, shading, self.mode, is_alone=is_alone)

    def _draw_labels(self) -> None:
        context = bpy.context
        if self.shading_for(context) is not None:
            draw_labels(context, self.mode, self.deviations)

    def _update_shading(self) -> None:
        """Prepare the shading. Do not call this while a view is being drawn."""
        if self.own is not None and self.session is not self.own.session:
            self.free()
        if self.shading is None or self.shading.session is not self.session:
            self.shading = view_shading.Shading(self.session)
        target = bpy.context.scene.imprint_view.target
        self.shading.update(is_measured=self.mode.is_deviation, target_engine="" if target == OWN else target)
        redraw()

    def _ask_for(self, wanted: Mode) -> None:
        """Show a mode, with a progress bar if there is a window. Raises BakeError."""
        windows = bpy.context.window_manager.windows
        if bpy.app.background or wanted is Mode.OFF or self.session is not None or not windows:
            self.switch(bpy.context, wanted)
            return
        with bpy.context.temp_override(window=bpy.context.window or windows[0]):
            bpy.ops.imprint.view_show("INVOKE_DEFAULT", mode=wanted.value)


def _drawn_map(context: bpy.types.Context, pace: progress.Pace) -> progress.Task[OwnMap]:
    """A map of the current objects and settings."""
    job, settings = context.scene.imprint.chosen(context).job(context)
    session = live_session.Session(context, job, view_shading.settings_for(settings), pace)
    yield from session.steps(context)
    return OwnMap(session, settings)


def _is_low_visible(session: live_session.Session, context: bpy.types.Context) -> bool:
    low = session.job.low_ref.find()
    return low is not None and low.visible_get(view_layer=context.view_layer, viewport=context.space_data)


viewer = ViewMode()


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

    mode: labeled(
        EnumProperty, "View", "What the 3D viewport shows", items=ITEMS, get=_get_mode, set=_set_mode, options=set()
    )
    target: labeled(
        EnumProperty,
        "Target Engine",
        "Program as which the view reads a tangent-space map. It shows what the program would show of this map",
        items=TARGETS,
        update=_read_again,
        options=set(),
    )
    reader: labeled(
        EnumProperty,
        "Target Engine",
        "Program as which the view reads a tangent-space map. It shows what the program would show of this map",
        items=TARGETS,
        update=passed_on("reader", "target"),
        options={"HIDDEN"},
    )
    light: labeled(
        PointerProperty,
        "Light",
        "The light that shines on the mesh; without one, a light that follows the view",
        type=bpy.types.Object,
        poll=_is_light,
    )
    split: labeled(
        FloatProperty,
        "Line",
        "Position of the line between high and low, as a share of the view's width",
        default=0.4,  # left of the middle, because the sidebar covers the right end
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    limit: labeled(
        FloatProperty, "Range", "Degrees at the end of the color scale", default=5.0, min=0.01, max=180.0, soft_max=45.0
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

    mode: labeled(EnumProperty, "View", "What the 3D viewport shows", items=ITEMS)

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


GREEN = "{target} reads green as {wanted}, and the map stores {stored}: the preset {preset} of the Map panel sets it."


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
            layout.prop(view, "target")
            draw_paragraphs(layout, context, _green_problem(view.target, viewer.session), "INFO")
        if viewer.mode in {Mode.MAP, Mode.SPLIT}:
            layout.prop(view, "light")
        if viewer.mode is Mode.SPLIT:
            layout.prop(view, "split")
        if viewer.mode.is_deviation:
            layout.prop(view, "limit")
            lines = describe_deviations(viewer.deviations)
            draw_paragraphs(layout.box(), context, lines, "DRIVER_ROTATIONAL_DIFFERENCE")
        if viewer.message:
            draw_paragraphs(layout.box(), context, [viewer.message], "ERROR")


def _green_problem(name: str, session: Session | None) -> list[str]:
    """Why the program of this name shows the map with green upside down, in a sentence; empty if it does not."""
    target = targets.BY_NAME.get(name)
    if target is None or session is None or session.settings.map.green == target.green:
        return []
    stored = session.settings.map.green
    return [message(GREEN).format(target=target.label, wanted=target.green, stored=stored, preset=target.preset)]


CLASSES = (
    ImprintView,
    IMPRINT_OT_view_show,
    IMPRINT_OT_view_next,
    IMPRINT_OT_view_refresh,
    IMPRINT_PT_view,
    IMPRINT_GT_split,
    IMPRINT_GGT_split,
)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)
_next_key = Key(IMPRINT_OT_view_next.bl_idname, "N", "3D View", "VIEW_3D", ctrl=True, alt=True)


def register() -> None:
    _register()
    bpy.types.Scene.imprint_view = PointerProperty(type=ImprintView)
    _next_key.add()
    live.on_new.append(viewer.catch_up)


def unregister() -> None:
    viewer.off()
    live.on_new.remove(viewer.catch_up)
    _next_key.remove()
    del bpy.types.Scene.imprint_view
    _unregister()
