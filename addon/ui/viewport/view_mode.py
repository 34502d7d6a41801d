# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows in the 3D viewport what the map does: the low mesh lit with it, beside the high one, and how far the two are off."""

import bpy
import gpu
import numpy as np
from bpy.props import EnumProperty, FloatProperty, PointerProperty
from gpu_extras.batch import batch_for_shader

from ...core import progress
from ...core.errors import BakeError
from ...core.settings import Settings
from ...jobs import live_session as sessions
from ...jobs import several, view_session
from ...scene import bake_objects
from .. import modal
from ..live.live_controller import live
from ..panels.sidebar import SidebarPanel, draw_paragraphs, split_layout
from . import viewport_text
from .object_hiding import hiding
from .progress_display import display

MODES = [
    ("OFF", "Off", "The viewport as it is"),
    ("MAP", "Map", "The low mesh with the map, lit"),
    ("SPLIT", "Split", "The high mesh, the low one, and the low one with the map, from left to right in one place"),
    ("DEVIATION", "Deviation", "By how many degrees the low mesh with the map is off the high surface"),
    ("BARE_DEVIATION", "Without Map", "By how many degrees the low mesh without the map is off the high surface"),
]
HEADLIGHT = np.array((-0.6, 0.7, 1.0, 0.0))
"""Where the view's own light comes from, in view space: from a little above and from the left."""
BAR = (240.0, 12.0)
"""Width and height of the legend, in pixels at a scale of 1."""
EDGE, TEXT = 60.0, viewport_text.SIZE
NOTED = 0.0005
"""Share of texels of another place from which it is said: it is told with one digit."""
DEGREES = "\N{DEGREE SIGN}"
LINE = (0.9, 0.9, 0.9, 0.6)
IN_REACH = 8.0
"""How near to the line of the split the mouse takes hold of it, in pixels at a scale of 1."""
LATER = 0.5
"""Seconds until a view that a bake keeps waiting asks again."""

message = ""
"""Why the view went off, in a sentence; empty when it did not, or on request."""
_mode = "OFF"
_own: sessions.Session | None = None
"""Whose map is shown while live is off."""
_own_settings: Settings | None = None
_shading: view_session.Shading | None = None
_handles: list = []
_keymap: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []


def mode() -> str:
    """What is shown: one of MODES."""
    return _mode


def figures() -> view_session.Figures | None:
    """The deviations of the map that is shown, once one of their modes has been on."""
    return _shading.figures if _shading is not None else None


def switch(context: bpy.types.Context, wanted: str) -> None:
    """All that `switching` does, at once."""
    progress.finish(switching(context, wanted, progress.Pace()))


def switching(
    context: bpy.types.Context, wanted: str, speed: progress.Pace, *, anew: bool = False
) -> progress.Task[None]:
    """Show one of MODES, of a map that is drawn first where there is none, or where it is to be drawn `anew`.

    Raises BakeError when there is nothing to show, and then the view is off; closed on the way, it leaves it as it was.
    """
    global _mode, _own, _own_settings, message  # noqa: PLW0603 - what Blender calls to draw takes no arguments
    message = ""
    if wanted == "OFF":
        off()
        return
    try:
        if anew or _session() is None:
            own, own_settings = yield from _drawn_map(context, speed)
            free()
            _own, _own_settings = own, own_settings
        _mode = wanted
        _take_up()
    except BakeError:
        off()
        raise
    if not _handles:
        for draw, event in ((_draw_view, "POST_VIEW"), (_draw_words, "POST_PIXEL")):
            _handles.append(bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", event))


def off() -> None:
    """Show the viewport as it is. Nothing stays behind."""
    global _mode  # noqa: PLW0603 - see switching
    _mode = "OFF"
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    if bpy.app.timers.is_registered(catch_up):
        bpy.app.timers.unregister(catch_up)
    hiding.stop()
    free()
    _redraw()


def free() -> None:
    """Let go of what is on the GPU."""
    global _own, _own_settings, _shading  # noqa: PLW0603 - see switching
    if _own is not None:
        _own.free()
    _own = _own_settings = _shading = None


def refresh(context: bpy.types.Context) -> None:
    """Show the objects and settings as they are now. Raises BakeError, and then the view is off."""
    progress.finish(switching(context, _mode, progress.Pace(), anew=True))


def catch_up() -> float | None:
    """Show what live has drawn since the last time, or a map of what is there after live has gone."""
    global message  # noqa: PLW0603 - see switching
    if _mode == "OFF":
        return None
    if display.current is not None:
        return LATER
    try:
        if _session() is not None:
            _take_up()
        else:
            _ask_for(_mode)
    except BakeError as error:
        off()
        message = str(error)
    return None


def is_outdated(context: bpy.types.Context) -> bool:
    """Whether the settings are other ones than those of the map that is shown."""
    return _own is not None and _own_settings != context.scene.imprint.to_settings()


def _session() -> sessions.Session | None:
    """Whose map is shown: that of live once it has one."""
    following = live.session
    return following if following is not None and following.texels is not None else _own


def _take_up() -> None:
    """Make ready what is to be shown. Not while a view is being drawn."""
    global _shading  # noqa: PLW0603 - see switching
    if _own is not None and _session() is not _own:
        free()
    if _shading is None or _shading.session is not _session():
        _shading = view_session.Shading(_session())
    _shading.update(is_measured=_mode.endswith("DEVIATION"))
    _redraw()


def _drawn_map(context: bpy.types.Context, speed: progress.Pace) -> progress.Task[tuple[sessions.Session, Settings]]:
    """A map of the objects and settings that there are now, for the views alone."""
    settings = context.scene.imprint
    low, highs = settings.subjects(context)
    if low is None:
        raise BakeError(bake_objects.problem(context, low, highs))
    plain = settings.to_settings()
    job = several.Job(low, highs, settings.cage_for(plain.method))
    session = sessions.Session(context, job, view_session.settings_for(plain), speed)
    yield from session.steps(context)
    return session, plain


def _ask_for(wanted: str) -> None:
    """Show one of MODES: in slices where there is a window. Raises BakeError."""
    windows = bpy.context.window_manager.windows
    if bpy.app.background or wanted == "OFF" or _session() is not None or not windows:
        switch(bpy.context, wanted)
        return
    with bpy.context.temp_override(window=bpy.context.window or windows[0]):
        bpy.ops.imprint.view_show("INVOKE_DEFAULT", mode=wanted)


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _shown(context: bpy.types.Context) -> view_session.Shading | None:
    """What is to be drawn into a view, if the low object is to be seen there."""
    session = _session()
    if _shading is None or _shading.session is not session:
        # Live has come or gone. Nothing is baked while a view is being drawn.
        if not bpy.app.timers.is_registered(catch_up):
            bpy.app.timers.register(catch_up)
        return None
    return _shading if _low_is_seen(context) else None


def _low_is_seen(context: bpy.types.Context) -> bool:
    low = _session().job.refs[0].find()
    return low is not None and low.visible_get(view_layer=context.view_layer, viewport=context.space_data)


def _highs(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The high objects, which the views draw the low one in place of; none where that is not to be seen."""
    session = _session()
    if session is None or not _low_is_seen(context):
        return []
    low, *highs = (ref.find() for ref in (session.job.refs[0], *session.job.high_refs))
    return [obj for obj in highs if obj is not None and obj != low]


def _draw_view() -> None:
    context = bpy.context
    highs = _highs(context)
    # Strokes need the object that they are drawn on.
    hiding.ask(context, [obj for obj in highs if obj.mode == "OBJECT"])
    drawn = _shown(context)
    if drawn is None:
        return
    view = context.scene.imprint_view
    is_alone = hiding.are_out(context.space_data, highs)
    drawn.draw(_mode, _eye(context.region_data, view.light), split=view.split, limit=view.limit, is_alone=is_alone)
    if _mode.endswith("DEVIATION"):
        scale = context.preferences.system.ui_scale
        drawn.draw_legend(_place_of_bar(context.region, scale), (BAR[0] * scale, BAR[1] * scale))


def _draw_words() -> None:
    context = bpy.context
    if _shown(context) is None:
        return
    view, region, scale = context.scene.imprint_view, context.region, context.preferences.system.ui_scale
    if _mode == "SPLIT":
        parts = (("High", 1.0), ("Low", 0.5), ("Low with Map", 0.0))
        for zone, (label, share) in zip(view_session.zones(region.width, view.split), parts, strict=True):
            x = place(zone, viewport_text.width(label, scale), share, uncovered(context), TEXT * scale)
            if x is not None:
                viewport_text.write(label, x, EDGE * scale, scale)
    elif _mode != "MAP":
        x, y = _place_of_bar(region, scale)
        for end, degrees in ((0.0, 0.0), (1.0, view.limit)):
            viewport_text.write(f"{degrees:.3g}{DEGREES}", x + end * BAR[0] * scale, y - 1.5 * TEXT * scale, scale, 0.5)
        for number, line in enumerate(reversed(words())):
            viewport_text.write(line, region.width / 2, y + (BAR[1] + TEXT * (1.5 * number + 0.7)) * scale, scale, 0.5)


def uncovered(context: bpy.types.Context) -> tuple[int, int]:
    """From where to where along x no toolbar and no sidebar lies over the region, in its pixels."""
    region = context.region
    left, right = 0, region.width
    for other in context.area.regions:
        if other.type in {"TOOLS", "UI"} and other.width > 1:  # 1 where it is hidden
            if other.alignment == "LEFT":
                left = max(left, other.x + other.width - region.x)
            elif other.alignment == "RIGHT":
                right = min(right, other.x - region.x)
    return left, right


def place(zone: range, width: float, share: float, free: tuple[int, int], gap: float) -> float | None:
    """Where along x a label of this width begins that has `share` of the room of its zone at its left, as far as the zone
    is free, and a gap at both ends; None where it does not fit."""
    start, stop = max(zone.start, free[0]) + gap, min(zone.stop, free[1]) - gap
    return start + (stop - start - width) * share if stop - start >= width else None


def words() -> list[str]:
    """The deviations in two lines, and in one more what they cannot tell."""
    found = figures()
    if found is None:
        return []
    other = []
    if found.elsewhere >= NOTED:
        other = [f"Purple: {found.elsewhere:.1%} show another place of the high mesh, whatever the degrees: cast rays"]
    if found.elsewhere == 1.0:
        return other
    return other + [
        f"{what}: mean {mean:.2f}{DEGREES}, 99 % below {most:.2f}{DEGREES}"
        for what, mean, most in (
            ("With the map", found.mean, found.percentile_99),
            ("Without", found.bare_mean, found.bare_percentile_99),
        )
    ]


def _place_of_bar(region: bpy.types.Region, scale: float) -> tuple[float, float]:
    return (region.width - BAR[0] * scale) / 2, EDGE * scale


def _eye(region_data: bpy.types.RegionView3D, light: bpy.types.Object | None) -> view_session.Eye:
    view = np.array(region_data.view_matrix, np.float64)
    if light is None:
        towards = view.T @ HEADLIGHT  # a view turns and does not stretch
        towards[3] = 0.0
    elif light.data.type == "SUN":
        towards = np.array(light.matrix_world.col[2])
    else:
        towards = np.array(light.matrix_world.col[3])
    return view_session.Eye(view, np.array(region_data.window_matrix, np.float64), towards)


def _is_light(_view, obj: bpy.types.Object) -> bool:
    return obj.type == "LIGHT"


def _get_mode(_view) -> int:
    return [item[0] for item in MODES].index(_mode)


def _set_mode(_view, number: int) -> None:
    global message  # noqa: PLW0603 - see switching
    if display.current is not None:
        return
    try:
        _ask_for(MODES[number][0])
    except BakeError as error:
        message = str(error)


class ImprintView(bpy.types.PropertyGroup):
    """Scene.imprint_view: what the 3D viewport shows of the map. Its mode is that of the session, and not stored."""

    mode: EnumProperty(
        name="View", description="What the 3D viewport shows", items=MODES, get=_get_mode, set=_set_mode, options=set()
    )
    light: PointerProperty(
        type=bpy.types.Object,
        name="Light",
        description="The light that shines on it; empty for one that follows the view",
        poll=_is_light,
    )
    split: FloatProperty(
        name="Line",
        description="Where the line between high and low is, of the view's width",
        default=0.4,  # left of the middle: the sidebar lies over the right end, and the three parts look alike
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    limit: FloatProperty(
        name="Range",
        description="Degrees at which the colours of deviations end",
        default=5.0,
        min=0.01,
        max=180.0,
        soft_max=45.0,
    )


class _Show(modal.SlicedOperator):
    """Shows a mode; one that needs a map has it drawn in slices."""

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None

    def wanted(self) -> str:
        return _mode

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task[None]:
        yield from switching(context, self.wanted(), pace)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # Without a map to draw there is nothing to wait for.
        is_quick = self.wanted() == "OFF" or _session() is not None
        return self.execute(context) if is_quick else super().invoke(context, event)


class IMPRINT_OT_view_show(_Show, bpy.types.Operator):
    """Show in the 3D viewport what the map does"""

    bl_idname = "imprint.view_show"
    bl_label = "Show View"

    mode: EnumProperty(name="View", description="What the 3D viewport shows", items=MODES)

    def wanted(self) -> str:
        return self.mode


class IMPRINT_OT_view_next(_Show, bpy.types.Operator):
    """Show the next of: nothing, the map, high and low beside it, deviations with it and without"""

    bl_idname = "imprint.view_next"
    bl_label = "Next View"

    def wanted(self) -> str:
        modes = [item[0] for item in MODES]
        return modes[(modes.index(_mode) + 1) % len(modes)]


class IMPRINT_OT_view_refresh(modal.SlicedOperator, bpy.types.Operator):
    """Draw the map that the view shows anew, of the objects and settings as they are now"""

    bl_idname = "imprint.view_refresh"
    bl_label = "Refresh View"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None and _mode != "OFF" and not live.is_on

    def task(self, context: bpy.types.Context, pace: progress.Pace) -> progress.Task[None]:
        yield from switching(context, _mode, pace, anew=True)


class IMPRINT_GT_split(bpy.types.Gizmo):
    """The line of the split, to be dragged."""

    bl_idname = "IMPRINT_GT_split"

    def draw(self, context: bpy.types.Context) -> None:
        region, view = context.region, context.scene.imprint_view
        _, low, _ = view_session.zones(region.width, view.split)
        points = [(x, y) for x in (low.start, low.stop) for y in (0, region.height)]
        program = gpu.shader.from_builtin("UNIFORM_COLOR")
        gpu.state.blend_set("ALPHA")
        gpu.state.line_width_set(2.0 if self.is_highlight else 1.0)
        program.uniform_float("color", LINE[:3] + (1.0,) if self.is_highlight else LINE)
        batch_for_shader(program, "LINES", {"pos": points}).draw(program)
        gpu.state.line_width_set(1.0)
        gpu.state.blend_set("NONE")

    def test_select(self, context: bpy.types.Context, location: tuple[int, int]) -> int:
        _, low, _ = view_session.zones(context.region.width, context.scene.imprint_view.split)
        reach = IN_REACH * context.preferences.system.ui_scale
        return 0 if min(abs(location[0] - low.start), abs(location[0] - low.stop)) < reach else -1

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.before = context.scene.imprint_view.split
        self.away = self.before - event.mouse_region_x / context.region.width
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event, _tweak: set[str]) -> set[str]:
        context.scene.imprint_view.split = event.mouse_region_x / context.region.width + self.away
        context.area.tag_redraw()
        return {"RUNNING_MODAL"}

    def exit(self, context: bpy.types.Context, cancel: bool) -> None:  # noqa: FBT001 - Blender calls it
        if cancel:
            context.scene.imprint_view.split = self.before


class IMPRINT_GGT_split(bpy.types.GizmoGroup):
    """Holds the line of the split in 3D viewports that show it."""

    bl_idname = "IMPRINT_GGT_split"
    bl_label = "Split"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return _mode == "SPLIT"

    def setup(self, _context: bpy.types.Context) -> None:
        self.gizmos.new(IMPRINT_GT_split.bl_idname).use_draw_modal = True


class IMPRINT_PT_view(SidebarPanel, bpy.types.Panel):
    """What the viewport shows."""

    bl_idname = "IMPRINT_PT_view"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "View"

    def draw(self, context: bpy.types.Context) -> None:
        layout, view = split_layout(self.layout), context.scene.imprint_view
        row = layout.row(align=True)
        row.enabled = display.current is None
        row.prop(view, "mode")
        row.operator("imprint.view_refresh", text="", icon="FILE_REFRESH")
        if is_outdated(context):
            draw_paragraphs(layout, context, ["The settings have changed: refresh the view."], "INFO")
        if _mode in {"MAP", "SPLIT"}:
            layout.prop(view, "light")
        if _mode == "SPLIT":
            layout.prop(view, "split")
        if _mode.endswith("DEVIATION"):
            layout.prop(view, "limit")
            draw_paragraphs(layout.box(), context, words(), "DRIVER_ROTATIONAL_DIFFERENCE")
        if message:
            draw_paragraphs(layout.box(), context, [message], "ERROR")


CLASSES = (
    ImprintView,
    IMPRINT_OT_view_show,
    IMPRINT_OT_view_next,
    IMPRINT_OT_view_refresh,
    IMPRINT_GT_split,
    IMPRINT_GGT_split,
    IMPRINT_PT_view,
)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()
    bpy.types.Scene.imprint_view = PointerProperty(type=ImprintView)
    live.on_new.append(catch_up)
    keys = bpy.context.window_manager.keyconfigs.addon
    if keys is not None:  # there is none in the background
        keymap = keys.keymaps.new("3D View", space_type="VIEW_3D")
        item = keymap.keymap_items.new(IMPRINT_OT_view_next.bl_idname, "N", "PRESS", ctrl=True, alt=True)
        _keymap.append((keymap, item))


def unregister() -> None:
    off()
    while _keymap:
        keymap, item = _keymap.pop()
        keymap.keymap_items.remove(item)
    live.on_new.remove(catch_up)
    del bpy.types.Scene.imprint_view
    _unregister()
