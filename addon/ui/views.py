# SPDX-License-Identifier: GPL-3.0-or-later
"""The views of the 3D viewports: which mode is on, which low objects and maps it shows, and the callbacks that draw it.

What is shown follows the panel: its low object, Live's map while Live is on, the images of the last bake, or else a map that is
drawn for the views alone.
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

import bpy
import numpy as np

from ..core import foreach, progress
from ..core.errors import BakeError
from ..core.map_types import NORMAL
from ..core.settings import Settings
from ..engine.bands import BAND_TEXELS
from ..jobs import live_session
from ..jobs.job import PastBake
from ..scene.object_checks import ObjectRef
from ..scene.updates import Shapes
from . import object_pairs, progress_display, stored_maps, view_labels, view_shading
from .callbacks import DrawCallbacks, Timer, events, redraw
from .live import live
from .local_view import hiding
from .progress_display import display
from .stored_maps import StoredShading, maps_of
from .view_scene import Eye
from .view_shading import OWN, Drawing, Mode

RETRY = 0.5
"""Seconds until a view that waits for a bake checks again."""
REST = 0.5
"""Seconds without a drawing until a view has all texels of a large image."""


@dataclass(frozen=True)
class OwnMap:
    """A normal map that was drawn, or taken from the file, only for the views.

    Attributes:
        settings: Those of the panel that it was drawn with; None for one from the file.
        baked: The time of the last bake of its low object, after which it is out of date.
    """

    session: live_session.Session
    settings: Settings | None
    baked: str

    def is_of(self, low: bpy.types.Object) -> bool:
        """Whether it is a map of this low object, and newer than its last bake."""
        return self.session.job.low_ref.uid == low.session_uid and self.baked == _time_of_bake(low)


class ViewMode:
    """Shows one of the modes for the low object of the panel.

    mode: the one that is on. map: the name of the chosen map. message: why the view was turned off, in a sentence; empty if it
    was not, or if the user turned it off. low: the object that is shown. shading: draws a session, or None. own: the map for
    the views, or None. stored: what draws the images of low objects, by session_uid.
    """

    def __init__(self):
        self.mode = Mode.OFF
        self.map = NORMAL.name
        self.message = ""
        self.low: ObjectRef | None = None
        self.shading: view_shading.Shading | None = None
        self.own: OwnMap | None = None
        self.stored: dict[int, StoredShading] = {}
        self._shapes = Shapes()
        self.timer = Timer(self.catch_up)
        self.sharpening = Timer(self.sharpen)
        self._drawings: list[Drawing] = []
        self._shown: tuple = ()
        """What was prepared: see `_wanted`."""
        self._asked: tuple = ()
        """What a viewport has asked for. It asks once: two windows may show different scenes."""
        self._draw_callbacks = DrawCallbacks(
            (bpy.types.SpaceView3D, self.draw, "POST_VIEW"), (bpy.types.SpaceView3D, self._draw_labels, "POST_PIXEL")
        )
        events.hear(
            depsgraph_update_post=self._after_update,
            undo_post=self._after_undo,
            redo_post=self._after_undo,
            live=self.catch_up,
            end=self.off,
            free=self.free,
        )

    @property
    def is_idle(self) -> bool:
        """Whether the view is off, and no map, draw callback or timer remains."""
        is_waiting = self.timer.is_running or self.sharpening.is_running
        is_used = self.own or self.shading or self.stored or self._draw_callbacks.are_added or is_waiting
        return self.mode is Mode.OFF and not is_used

    @property
    def session(self) -> live_session.Session | None:
        """The session that has a normal map to show: Live's as soon as it has one, or that of the view's own map."""
        if live.is_on and live.session.drawn:
            return live.session
        return self.own.session if self.own is not None else None

    @property
    def deviations(self) -> view_shading.Deviations | view_shading.FormatLoss | None:
        """The deviations of the shown map, after a mode that measures them was on, or what its format loses in that mode."""
        if self.shading is None:
            return None
        return self.shading.loss if self.mode is Mode.FORMAT else self.shading.deviations

    @property
    def settings(self) -> Settings | None:
        """The settings of the bake that is shown, or None."""
        return self._drawings[0].subject.settings if self._drawings else None

    def shows_session(self, maps: dict) -> bool:
        """Whether the session's map is drawn, rather than images of the low object, which are in `maps`."""
        if self.session is None:
            return False
        return self.mode.is_deviation or not maps or (self.map == NORMAL.name and not self._is_from_file)

    @property
    def _is_from_file(self) -> bool:
        return self.own is not None and self.own.session is self.session and self.own.settings is None

    # What to show

    def low_of(self, context: bpy.types.Context) -> bpy.types.Object | None:
        """The low object to show: Live's, that of the panel if it has a map, or else the one before, or that of the panel."""
        if live.is_on:
            return live.session.job.low_ref.find()
        chosen = context.scene.imprint.low or context.active_object
        if chosen is not None and (maps_of(chosen) or (self.own is not None and self.own.is_of(chosen))):
            return chosen
        return (self.low and self.low.find()) or chosen

    def lows_of(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The low objects to show: that of `low_of`, and all others of the view layer that have images, if they are wanted."""
        low = self.low_of(context)
        if low is None or self.mode.is_deviation or not context.scene.imprint_view.all_lows:
            return [low] if low is not None else []
        return [low, *(obj for obj in context.view_layer.objects if obj not in {low, None} and maps_of(obj))]

    def is_ready(self, context: bpy.types.Context, wanted: Mode) -> bool:
        """Whether a mode needs no map that is yet to be drawn."""
        low = self.low_of(context)
        if live.is_on or wanted is Mode.OFF:
            return wanted is Mode.OFF or self.session is not None
        has_own = low is not None and self.own is not None and self.own.is_of(low)
        if wanted is Mode.FORMAT:  # what the file has is stored already
            return has_own and not self._is_from_file
        return has_own or (not wanted.is_deviation and bool(maps_of(low)))

    def _wanted(self, context: bpy.types.Context) -> tuple:
        """What there is to show, to be compared with what was prepared."""
        lows = [(low.session_uid, _time_of_bake(low), *maps_of(low)) for low in self.lows_of(context)]
        session = self.session
        stored = context.scene.imprint.settings_of(session.job) if session and self.mode is Mode.FORMAT else None
        return self.mode, self.map, lows, session and session.job.low_ref.uid, live.is_on, stored

    # Turning on and off

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
            if redrawn or not self.is_ready(context, wanted):
                own = None if redrawn or wanted is Mode.FORMAT else _map_of_file(context, self.low_of(context), pace)
                own = own or (yield from _drawn_map(context, pace))
                self._free_own()
                self.own = own
                self.low = own.session.job.low_ref
            self.mode = wanted
            self._prepare(context)
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

    def choose_map(self, context: bpy.types.Context, name: str) -> None:
        """Show a map of the low object, by its name. Raises BakeError if there is nothing to show."""
        self.map = name
        keeps_mode = self.mode in {Mode.MAP, Mode.SPLIT, Mode.SIDES}
        self.switch(context, self.mode if keeps_mode else Mode.MAP)

    def show_mask(self, context: bpy.types.Context, low: bpy.types.Object, mask: stored_maps.Mask | None) -> None:
        """Show a mask over the map of a low object that was baked, or none. Raises BakeError if there is nothing to show."""
        if mask is not None:
            self._free_own()
            self.switch(context, self.mode if self.mode in {Mode.SPLIT, Mode.SIDES} else Mode.MAP)
        self._stored_of(context, low).mask = mask
        redraw()

    def off(self) -> None:
        """Turn the view off. No draw callback, timer or map remains."""
        self.mode, self.low = Mode.OFF, None
        self._draw_callbacks.remove()
        self.timer.stop()
        self.sharpening.stop()
        hiding.stop()
        self.free()
        redraw()

    def free(self) -> None:
        """Free the view's GPU memory."""
        self._free_own()
        self.stored.clear()
        self._drawings = []
        self._shown = self._asked = ()

    def _free_own(self) -> None:
        if self.own is not None:
            self.own.session.free()
        self._drawings = [drawing for drawing in self._drawings if drawing is not self.shading]
        self.own = self.shading = None

    # Following

    def catch_up(self) -> float | None:
        """Show what the panel and Live have now. A map is drawn if there is none."""
        if self.mode is Mode.OFF:
            return None
        if display.current is not None:
            return RETRY
        try:
            if self.is_ready(bpy.context, self.mode):
                asked = self._asked
                self._prepare(bpy.context)
                self._asked = asked
            elif self.stored and not self.mode.is_deviation:
                name = self.low.name if self.low is not None else ""
                raise BakeError(f"The maps of {name!r} were undone or deleted: bake it again.")
            else:
                self._ask_for(self.mode)
        except BakeError as error:
            self.off()
            self.message = str(error)
        return None

    def sharpen(self) -> float | None:
        """Show a large image with all its texels. The next drawing asks for the next one."""
        if display.current is not None:
            return RETRY
        coarse = next((drawing for drawing in self._drawings if not drawing.is_whole), None)
        if coarse is not None:
            coarse.load_whole()
            redraw()
        return None

    def read_again(self) -> None:
        """Show what the settings of the view say now."""
        if display.current is None:
            self.catch_up()

    def is_outdated(self, context: bpy.types.Context) -> bool:
        """Whether the settings have changed since the map that is shown was drawn."""
        if self.own is None or self.own.settings is None:
            return False
        return self.own.settings != context.scene.imprint.settings_of(self.own.session.job)

    def _prepare(self, context: bpy.types.Context) -> None:
        """Prepare what draws the mode. Do not call this while a view is being drawn. Raises BakeError."""
        low = self.low_of(context)
        if low is None:
            raise BakeError("No low object: select it, or fill the slot.")
        self.low = ObjectRef.of(low)
        if self.own is not None and (self.session is not self.own.session or not self.own.is_of(low)):
            self._free_own()
        target = context.scene.imprint_view.target
        target = "" if target == OWN else target
        if self.shows_session(maps_of(low)):
            if self.shading is None or self.shading.session is not self.session:
                self.shading = view_shading.Shading(self.session)
            if self.mode is Mode.FORMAT:
                self.shading.update_loss(context.scene.imprint.settings_of(self.session.job))
            is_measured = self.mode.is_deviation and self.mode is not Mode.FORMAT
            self.shading.update(is_measured=is_measured, target_engine=target)
            self._drawings = [self.shading]
        else:
            self._drawings = [self._prepared(context, low, target)]
            for other in self.lows_of(context)[1:]:
                with suppress(BakeError):  # one that cannot be read is left out
                    self._drawings.append(self._prepared(context, other, target))
        self._shown, self._asked = self._wanted(context), ()
        redraw()

    def _prepared(self, context: bpy.types.Context, low: bpy.types.Object, target: str) -> StoredShading:
        """What draws the images of a low object in the mode that is on. target: as StoredShading.target_engine."""
        shading = self._stored_of(context, low)
        shading.name, shading.target_engine = self.map, target
        if self.mode.has_high:
            shading.bake.read_highs(context)
        return shading

    def _stored_of(self, context: bpy.types.Context, low: bpy.types.Object) -> StoredShading:
        """What draws the images of a low object, made again after a bake."""
        known = self.stored.get(low.session_uid)
        if known is None or known.bake.baked != _time_of_bake(low):
            known = self.stored[low.session_uid] = StoredShading(context, low)
        return known

    def _after_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Forget the meshes that have changed."""
        if self.mode is not Mode.OFF and (changed := self._shapes.changed(depsgraph)):
            self._forget(
                uid for uid, one in self.stored.items() if not changed.isdisjoint(r.uid for r in one.bake.job.refs)
            )

    def _after_undo(self, *_) -> None:
        self._forget(self.stored)

    def _forget(self, uids: Iterable[int]) -> None:
        for uid in list(uids):
            del self.stored[uid]
            self._shown = self._asked = ()

    def _ask_for(self, wanted: Mode) -> None:
        """Show a mode, with a progress bar if there is a window and a map has to be drawn. Raises BakeError."""
        windows = bpy.context.window_manager.windows
        if bpy.app.background or not windows or self.is_ready(bpy.context, wanted):
            self.switch(bpy.context, wanted)
            return
        with bpy.context.temp_override(window=bpy.context.window or windows[0]):
            bpy.ops.imprint.view_show("INVOKE_DEFAULT", mode=wanted.value)

    # Drawing

    def drawings(self, context: bpy.types.Context) -> list[Drawing]:
        """What draws the low objects that are visible in the viewport that Blender is drawing."""
        wanted = self._wanted(context)
        if wanted not in (self._shown, self._asked):
            self._asked = wanted
            self.timer.start()  # nothing is read or baked while a view is being drawn
        if self.shading in self._drawings and self.shading.session is not self.session:
            return []  # Live was switched on or off
        lows = (drawing.subject.job.low_ref.find() for drawing in self._drawings)
        return [
            drawing
            for drawing, low in zip(self._drawings, lows, strict=True)
            if low is not None and _is_visible(low, context)
        ]

    def draw(self) -> None:
        """Called by Blender for each 3D viewport that it draws."""
        context = bpy.context
        drawings = self.drawings(context)
        jobs = [drawing.subject.job for drawing in drawings]
        lows = {job.low_ref.uid for job in jobs}
        highs = [ref.find() for job in jobs for ref in job.high_refs if ref.uid not in lows]
        highs = [obj for obj in highs if obj is not None]
        # Strokes need the object that they are drawn on.
        hiding.ask(context, [obj for obj in highs if obj.mode == "OBJECT"])
        if not drawings:
            return
        view = context.scene.imprint_view
        view_shading.draw(
            drawings,
            self.mode,
            eye(context.region_data, view.light, np.array(view.direction)),
            split=view.split,
            visible=progress_display.visible_columns(context.area, context.region) if context.area else None,
            limit=view.limit,
            is_alone=hiding.are_out(context.space_data, highs),
        )
        self.sharpening.stop()
        if self.mode is not Mode.HIGH and not all(drawing.is_whole for drawing in drawings):
            self.sharpening.start(REST)
        if self.mode.is_deviation:
            view_labels.draw_legend(context)

    def _draw_labels(self) -> None:
        context = bpy.context
        drawings = self.drawings(context)
        if drawings:
            view_labels.draw(context, self.mode, self.title(drawings), self.deviations)

    def title(self, drawings: list[Drawing]) -> str:
        """The low objects and the map that are drawn, in a few words."""
        names = [ref.find().name for ref in (drawing.subject.job.low_ref for drawing in drawings)]
        shown = getattr(drawings[0], "shown", list)()
        return view_labels.title(names, shown[0].name if shown else NORMAL.name)


def eye(region_data: bpy.types.RegionView3D, light: bpy.types.Object | None, direction: np.ndarray) -> Eye:
    """The camera of a view, and its light: an object, or for None one from a direction (3,) in view space."""
    view = np.array(region_data.view_matrix, np.float64)
    if light is None:
        towards = view.T @ np.append(direction, 0.0)  # a view matrix rotates and does not scale
        towards[3] = 0.0
    elif light.data.type == "SUN":
        towards = np.array(light.matrix_world.col[2])
    else:
        towards = np.array(light.matrix_world.col[3])
    return Eye(view, np.array(region_data.window_matrix, np.float64), towards)


def _time_of_bake(low: bpy.types.Object) -> str:
    pair = object_pairs.of(low)
    return pair.baked if pair is not None else ""


def _drawn_map(context: bpy.types.Context, pace: progress.Pace) -> progress.Task[OwnMap]:
    """A map of the current objects and settings."""
    job, settings = context.scene.imprint.chosen(context).job(context)
    session = live_session.Session(context, job, view_shading.settings_for(settings), pace, is_followed=False)
    yield from session.steps(context)
    return OwnMap(session, settings, _time_of_bake(job.low))


def _map_of_file(context: bpy.types.Context, low: bpy.types.Object | None, pace: progress.Pace) -> OwnMap | None:
    """The normal map of the last bake of a low object, as it is in its image; None if it is not one image that is whole on the
    GPU, or if objects of the bake are missing."""
    stored = maps_of(low).get(NORMAL.name, [])
    if len(stored) != 1 or stored[0].part != stored_maps.WHOLE or np.prod(stored[0].image.size) > BAND_TEXELS:
        return None
    (width, height), report = stored[0].image.size, stored[0].report
    try:
        past = PastBake.of(report)
    except BakeError:
        return None
    settings = view_shading.settings_for(past.settings).mapped(uv_layer=report.uv_layer)
    settings = settings.sampled(width=width, height=height).traced(**past.distances)
    session = live_session.Session(context, past.job, settings, pace, is_followed=False)
    session.adopt(context, foreach.pixels(stored[0].image))
    return OwnMap(session, None, _time_of_bake(low))


def _is_visible(obj: bpy.types.Object, context: bpy.types.Context) -> bool:
    return obj.visible_get(view_layer=context.view_layer, viewport=context.space_data)


viewer = ViewMode()
