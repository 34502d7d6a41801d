# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds changes by strokes in Sculpt Mode. Blender only reports that an object has changed, and it delays some strokes until
a script asks for them. Vertices are therefore compared."""

import time

import bpy

from ...jobs import live_session
from ...scene import object_modes

ANSWER = 1.0
"""Seconds after `apply_delayed` in which updates of objects with delayed strokes are Blender's answer, and not new strokes."""


class Strokes:
    """Finds the objects of a session that strokes have moved."""

    def __init__(self, session: live_session.Session):
        self._session = session
        self._noted: set[int] = set()
        """session_uid of the objects whose vertices are to be compared."""
        self._held: set[int] = set()
        """session_uid of the objects whose strokes Blender may delay."""
        self._since = self._asked = -ANSWER
        self.is_asking = False
        """Whether updates that Blender reports now are its answer to `apply_delayed`."""
        self.note_all()

    @property
    def are_open(self) -> bool:
        """Whether vertices may have moved that were not compared yet."""
        return bool(self._noted or self._held)

    def note_all(self) -> None:
        """Note that any object may have moved: after Undo, and at the start."""
        for obj in filter(None, (ref.find() for ref in self._session.job.refs)):
            self._note(obj)

    def note(self, obj: bpy.types.Object) -> None:
        """Note that an object of the session has changed."""
        if not object_modes.holds_strokes(bpy.context, obj) or time.monotonic() - self._asked > ANSWER:
            self._note(obj)

    def moved(self, rest: float) -> set[int]:
        """The session_uid of each object whose vertices have moved since they were read. Delayed strokes are applied after
        `rest` seconds without a stroke."""
        is_busy = is_drawing()
        if is_busy:
            self.note_all()
        noted, self._noted = self._noted, set()
        if self._held and not is_busy and time.monotonic() - self._since > rest:
            noted |= self._held
            self._held.clear()
            self.apply_delayed()
        return {uid for uid in noted if self._session.is_moved(uid)}

    def apply_delayed(self) -> None:
        """Make Blender apply the strokes that it delays."""
        self.is_asking = True
        try:
            bpy.ops.ed.flush_edits()
            bpy.context.view_layer.update()
        finally:
            self.is_asking, self._asked = False, time.monotonic()

    def _note(self, obj: bpy.types.Object) -> None:
        if object_modes.holds_strokes(bpy.context, obj):
            self._held.add(obj.session_uid)
            self._since = time.monotonic()
        elif obj.mode == "SCULPT":
            self._noted.add(obj.session_uid)


def is_drawing() -> bool:
    """Whether a stroke is being drawn, or a filter dragged."""
    windows = bpy.context.window_manager.windows
    return any(running.bl_idname.startswith("SCULPT_OT_") for window in windows for running in window.modal_operators)
