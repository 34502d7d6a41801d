# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of the views: which mode is on, and which map it shows. The drawing itself is in view_drawing."""

from dataclasses import dataclass

import bpy

from ...core import progress
from ...core.errors import BakeError
from ...core.settings import Settings
from ...jobs import live_session
from ...views import view_shading
from ...views.mode_names import OWN, Mode
from ..callbacks import DrawCallbacks, Timer, redraw
from ..live.live_switch import live
from . import view_drawing
from .object_hiding import hiding
from .progress_display import display

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
    def figures(self) -> view_shading.Figures | None:
        """The deviations of the shown map, after a mode that measures them was on."""
        return self.shading.figures if self.shading is not None else None

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
            view_drawing.draw_mesh(context, shading, self.mode, is_alone=is_alone)

    def _draw_labels(self) -> None:
        context = bpy.context
        if self.shading_for(context) is not None:
            view_drawing.draw_labels(context, self.mode, self.figures)

    def _update_shading(self) -> None:
        """Prepare the shading. Do not call this while a view is being drawn."""
        if self.own is not None and self.session is not self.own.session:
            self.free()
        if self.shading is None or self.shading.session is not self.session:
            self.shading = view_shading.Shading(self.session)
        reader = bpy.context.scene.imprint_view.reader
        self.shading.update(is_measured=self.mode.is_deviation, reader="" if reader == OWN else reader)
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
    job, settings = context.scene.imprint.job(context)
    session = live_session.Session(context, job, view_shading.settings_for(settings), pace)
    yield from session.steps(context)
    return OwnMap(session, settings)


def _is_low_visible(session: live_session.Session, context: bpy.types.Context) -> bool:
    low = session.job.low_ref.find()
    return low is not None and low.visible_get(view_layer=context.view_layer, viewport=context.space_data)


viewer = ViewMode()


def register() -> None:
    live.on_new.append(viewer.catch_up)


def unregister() -> None:
    viewer.off()
    live.on_new.remove(viewer.catch_up)
