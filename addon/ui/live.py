# SPDX-License-Identifier: GPL-3.0-or-later
"""Live: turns on and off, gets all changes while it is on, and draws a few milliseconds at a time."""

from enum import Enum

import bpy

from ..core import progress
from ..core.errors import BakeError
from ..core.settings import Settings
from ..jobs import live_session, map_contents
from ..jobs.job import Job
from ..scene import object_checks
from .callbacks import Timer, events
from .live_following import SLICE, Following
from .progress_display import display
from .texts import message

TICK = 0.02
"""Seconds between two checks for changes."""
BUDGET = 0.05
"""Seconds of work at a tick; the rest waits for the next tick. One draw is not divided."""
REST = 0.4
"""Seconds without a change after which the map goes into the image."""


class LiveState(Enum):
    """The state of Live."""

    OFF = "off"
    STARTING = "starting"
    """It draws its first map."""
    DRAWING = "drawing"
    REFUSED = "refused"
    """The objects or settings cannot be baked at present; `message` says why."""
    IDLE = "idle"


class LiveController:
    """Turns Live on and off, and gets all changes while it is on.

    message: why the last map was not drawn, in a sentence; empty if it was. rest, budget: seconds, as REST and
    BUDGET.
    """

    def __init__(self):
        self.message = ""
        self.rest, self.budget = REST, BUDGET
        self.timer = Timer(self.tick)
        events.hear(
            depsgraph_update_post=self._on_update,
            frame_change_post=self._on_update,
            save_pre=self._on_save,
            undo_post=self.on_undo,
            redo_post=self.on_undo,
            end=self.stop,
            free=self.free,
        )
        self._following: Following | None = None

    @property
    def state(self) -> LiveState:
        if self._following is None:
            return LiveState.OFF
        if self._following.is_drawing:
            return LiveState.DRAWING
        if self.message:
            return LiveState.REFUSED
        return LiveState.IDLE if self._following.session.drawn else LiveState.STARTING

    @property
    def is_on(self) -> bool:
        return self._following is not None

    @property
    def draws_others(self) -> bool:
        """Whether maps other than the normal map are being drawn."""
        return self._following is not None and self._following.draws_others

    @property
    def is_resting(self) -> bool:
        """Whether Live is on and has nothing to do: the image shows all changes that Blender has reported."""
        return self._following is not None and self._following.is_resting

    @property
    def session(self) -> live_session.Session | None:
        """The session of Live, or None while Live is off."""
        return self._following.session if self._following is not None else None

    @property
    def description(self) -> str:
        """The objects that Live follows, in a sentence; empty while Live is off."""
        if self._following is None:
            return ""
        refs = self._following.session.job.refs
        low, *others = (obj.name if (obj := ref.find()) else ref.name for ref in refs)
        others = [name for name in dict.fromkeys(others) if name != low]
        followed = ", ".join(map(repr, others)) or self._own_of(refs[0].find())
        return message("Live: {} follows {}.").format(repr(low), followed)

    @staticmethod
    def _own_of(low: bpy.types.Object | None) -> str:
        """What Live follows of a low object without high ones."""
        return message("its own modifiers") if low is not None and object_checks.is_added(low) else message("its mesh")

    def start(self, context: bpy.types.Context, job: Job, settings: Settings) -> None:
        """Do the whole task of `starting` at once."""
        progress.finish(self.starting(context, job, settings, progress.Pace(has_picture=False)))

    def starting(
        self, context: bpy.types.Context, job: Job, settings: Settings, pace: progress.Pace
    ) -> progress.Task[None]:
        """Follow the objects of a job: draw and store a first map, then start the timer. If that fails with BakeError, or
        the task is closed, Live is off."""
        self.stop()
        session = live_session.Session(context, job, settings, pace)
        following = self._following = Following(session, settings, context.scene)
        self.message = ""
        is_done = False
        try:
            yield from session.steps(context)
            session.note_differences(context)
            session.store()
            is_done = True
        finally:
            if not is_done and self._following is following:
                self.stop()
        session.pace = progress.Pace(SLICE, has_picture=False)
        if not bpy.app.background:
            self.timer.start(TICK)

    def finishing(self) -> progress.Task[None]:
        """Draw the other maps if they do not show the last change, then finish. If the task is closed, Live stays on."""
        if self._following is not None:
            yield from self._following.complete()
        self.finish()

    def finish(self) -> None:
        """Store the last maps as a bake does, in their files or packed, and stop. Raises BakeError if they cannot be stored."""
        try:
            if self._following is not None:
                self._following.keep(is_reported=True)
        finally:
            self.stop()

    def stop(self) -> None:
        """Stop following. No timer remains; the image keeps what it has."""
        self.timer.stop()
        following, self._following = self._following, None
        if following is not None:
            following.free()

    def free(self) -> None:
        """Free the GPU memory of the session. The next map uses new memory."""
        if self._following is not None:
            self._following.session.free()

    def tick(self) -> float | None:
        """Do the pending work for one tick. Returns the seconds until the next tick, None if Live is off."""
        following = self._following
        if following is None:
            return None
        if display.current is not None:  # a bake is in progress
            return TICK
        goes_on = False
        try:
            goes_on = self._follow(following)
        except BakeError as error:
            following.interrupt()
            goes_on = self._following is not None
            self._show_message(str(error))
        finally:  # an unexpected error switches Live off, too
            if not goes_on:
                self.stop()
        return TICK if goes_on else None

    def on_undo(self, *_) -> None:
        """Called by Blender after Undo and Redo."""
        if self._following is not None:
            self._following.note_undo()

    def _follow(self, following: Following) -> bool:
        """Look for changes and draw them. Returns whether Live stays on. Raises BakeError."""
        if following.panel is None:
            self.finish()
            self._announce()
            return False
        following.check_objects()
        if following.follow_settings():
            self._show_message("")
        if following.advance(self.budget, self.rest):
            if not following.is_drawing:
                self.message = ""
            self._announce()
        return True

    def _on_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if self._following is not None:
            self._following.note_update(depsgraph)

    def _on_save(self, *_) -> None:
        """Store the map, so that the saved file has it."""
        if self._following is not None:
            try:
                self._following.keep()
            except BakeError as error:
                self._show_message(str(error))
            map_contents.pack_unpacked()  # what is kept in memory, or could not be written to its files

    def _show_message(self, text: str) -> None:
        """Change the message, and redraw if it is different."""
        if text != self.message:
            self.message = text
            self._announce()

    def _announce(self) -> None:
        events.tell("live")


live = LiveController()
