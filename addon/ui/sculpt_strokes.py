# SPDX-License-Identifier: GPL-3.0-or-later
"""Strokes in Sculpt Mode. Of these Blender tells no more than that something about an object is new, and some it keeps to
itself until it is asked: who follows them looks at the vertices."""

import time

import bpy

from ..jobs import live_session
from ..scene import bake_objects

ANSWER = 1.0
"""Seconds after Blender was asked in which what it tells of is no more than its own answer."""


class Strokes:
    """Finds out which objects of a session strokes have moved."""

    def __init__(self, session: live_session.Session):
        self._session = session
        self._told: set[int] = set()
        self._held: set[int] = set()
        self._since = self._asked = -ANSWER
        self.is_asking = False
        """Whether what Blender tells of now is its answer."""
        self.look_at_all()

    @property
    def are_open(self) -> bool:
        """Whether something may have moved that was not looked at yet."""
        return bool(self._told or self._held)

    def look_at_all(self) -> None:
        """Anything may have moved: after an undo, and at the start."""
        for obj in filter(None, (ref.find() for ref in self._session.job.refs)):
            self._note(obj)

    def told_of(self, obj: bpy.types.Object) -> None:
        """Something about an object of the session is new."""
        if not bake_objects.holds_strokes(bpy.context, obj) or time.monotonic() - self._asked > ANSWER:
            self._note(obj)

    def moved(self, rest: float) -> set[int]:
        """The session_uid of each object that is not where it was read. Blender is asked for strokes that it holds back when
        the hand has rested for so many seconds."""
        is_drawing = _is_drawing()
        if is_drawing:
            self.look_at_all()
        told, self._told = self._told, set()
        if self._held and not is_drawing and time.monotonic() - self._since > rest:
            told |= self._held
            self._ask()
        return {uid for uid in told if self._session.is_moved(uid)}

    def _note(self, obj: bpy.types.Object) -> None:
        if bake_objects.holds_strokes(bpy.context, obj):
            self._held.add(obj.session_uid)
            self._since = time.monotonic()
        elif obj.mode == "SCULPT":
            self._told.add(obj.session_uid)

    def _ask(self) -> None:
        self._held.clear()
        self.is_asking = True
        try:
            bpy.ops.ed.flush_edits()
            bpy.context.view_layer.update()
        finally:
            self.is_asking, self._asked = False, time.monotonic()


def _is_drawing() -> bool:
    """Whether a stroke is being drawn, or a filter dragged."""
    windows = bpy.context.window_manager.windows
    return any(running.bl_idname.startswith("SCULPT_OT_") for window in windows for running in window.modal_operators)
