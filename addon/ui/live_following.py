# SPDX-License-Identifier: GPL-3.0-or-later
"""What Live follows: strokes, objects and settings of a session, and the maps that it draws of them, a slice at a time."""

import time

import bpy

from ..core.errors import BakeError
from ..core.progress import Pace, Task, run_for
from ..core.settings import Settings
from ..jobs import live_session
from ..scene import evaluation
from ..scene.object_checks import scene_by_uid
from ..scene.updates import Shapes
from . import object_pairs

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
        if not evaluation.holds_strokes(bpy.context, obj) or time.monotonic() - self._asked > ANSWER:
            self._note(obj)

    def moved(self, rest: float) -> set[int]:
        """The session_uid of each object whose vertices have moved since they were read. Delayed strokes are applied after
        `rest` seconds without a stroke."""
        is_busy = is_stroke_drawn()
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
        if evaluation.holds_strokes(bpy.context, obj):
            self._held.add(obj.session_uid)
            self._since = time.monotonic()
        elif obj.mode == "SCULPT":
            self._noted.add(obj.session_uid)


def is_stroke_drawn() -> bool:
    """Whether a stroke is being drawn, or a filter dragged."""
    windows = bpy.context.window_manager.windows
    return any(running.bl_idname.startswith("SCULPT_OT_") for window in windows for running in window.modal_operators)


SLICE = 0.02
"""Seconds of rays between two checks of the clock."""
PAUSES = 2.0
"""How many times longer the other maps wait for a pause than the normal map."""


def uids_in_scenes() -> set[int]:
    """The session_uid of all objects in scenes. One pass over all objects: Blender would make one for each object asked for."""
    return {obj.session_uid for scene in bpy.data.scenes for obj in scene.objects}


class Following:
    """A session whose objects and settings are followed, with the settings of the panel in `scene`.

    session: another one after each change of the settings.
    """

    def __init__(self, session: live_session.Session, settings: Settings, scene: bpy.types.Scene):
        self.session = session
        self._settings = settings
        """The settings of the session."""
        self._refused: tuple[Settings | None, str] | None = None
        """Settings of the panel that cannot be baked, and why."""
        self._scene = scene.session_uid
        self._strokes, self._shapes = Strokes(session), Shapes()
        self._task: Task[None] | None = None
        """The normal map that is being drawn."""
        self._other_task: Task[None] | None = None
        """The other maps that are being drawn."""
        self._are_others_old = True
        self._changed: set[int] = set()
        """session_uid of the objects that have changed since the last map began."""
        self._unread: set[int] = set()
        """session_uid of the objects that the map in progress has to read."""
        self._all_changed = False
        self._is_stored, self._drawn_at = True, time.monotonic()
        self._may_be_gone, self._is_one_gone = True, False

    @property
    def panel(self) -> bpy.types.PropertyGroup | None:
        """The settings of the scene in which Live was switched on, whichever scene is shown; None if it was deleted."""
        scene = scene_by_uid(self._scene)
        return scene and scene.imprint

    @property
    def is_drawing(self) -> bool:
        return self._task is not None

    @property
    def draws_others(self) -> bool:
        return self._other_task is not None

    @property
    def is_resting(self) -> bool:
        """Whether there is nothing to do: the image shows all changes that Blender has reported."""
        is_changed = self._changed or self._all_changed or self._strokes.are_open
        return self._task is None and self._is_stored and not is_changed and not self._needs_others

    @property
    def _needs_others(self) -> bool:
        """Whether the other maps do not show the last change."""
        return self._are_others_old and self.session.others.are_any

    def note_update(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Note the objects of the session that Blender reports as changed."""
        self._may_be_gone = True
        if self._strokes.is_asking:
            return
        followed, shaped = self.session.uids, self._shapes.changed(depsgraph)
        for update in depsgraph.updates:
            obj = update.id.original
            if self.session.shows(obj):
                self._all_changed = True
            if not isinstance(obj, bpy.types.Object) or obj.session_uid not in followed:
                continue
            if obj.session_uid in shaped or update.is_updated_transform:
                self._changed.add(obj.session_uid)
            else:
                self._strokes.note(obj)

    def keep(self, *, is_reported: bool = False) -> None:
        """Store the maps as a bake does, and the pair with the low object. Raises BakeError. is_reported: whether their report
        replaces that of the last bake."""
        stored = self.session.commit()
        objects = [ref.find() for ref in self.session.job.refs]
        if None in objects:  # a pair of which an object was deleted stays as it was
            return
        job = self.session.job
        object_pairs.remember_objects(job.low, job.highs, job.cage, self._settings.flat(), {})
        if is_reported and stored is not None:
            object_pairs.keep_reports(job.low, [self.session.report(bpy.context, stored)])

    def note_undo(self) -> None:
        """Note that any object may have changed, or been deleted or restored."""
        self._all_changed = self._may_be_gone = True
        self._strokes.note_all()

    def check_objects(self) -> None:
        """Raise BakeError while an object is deleted. After Undo restores it, all objects are read again."""
        if not (self._may_be_gone or self._is_one_gone):
            return
        was_one_gone, self._is_one_gone, self._may_be_gone = self._is_one_gone, True, False
        uids, job = uids_in_scenes(), self.session.job
        if not uids.issuperset(ref.uid for ref in job.refs):
            self.session.job = job.but()  # a library was reloaded
            self._all_changed |= self.session.job != job
            job = self.session.job
            lost = next((ref for ref in job.refs if ref.uid not in uids), None)
            if lost is not None:  # a slot of the panel keeps a deleted object in the file
                raise BakeError(
                    f"{lost.name!r} was deleted from the scene: bring it back with Undo, or switch Live off."
                )
        self._is_one_gone = False
        self._all_changed |= was_one_gone

    def follow_settings(self) -> bool:
        """Start a new session with the same objects if the settings of the panel have changed. Raises BakeError while they
        cannot be baked. Returns whether they are back to the session's settings after that."""
        try:
            wanted = self.panel.settings_of(self.session.job)
        except BakeError as error:
            self._refused = None, str(error)
            raise
        if wanted == self._settings:
            was_refused, self._refused = self._refused is not None, None
            return was_refused
        if self._refused is not None and self._refused[0] == wanted:
            raise BakeError(self._refused[1])
        try:
            session = live_session.Session(bpy.context, self.session.job, wanted, Pace(SLICE, has_picture=False))
            if wanted.map.modifiers == self._settings.map.modifiers:
                session.differences = self.session.differences
            else:
                session.note_differences(bpy.context)
            self.session.commit()  # the new session may store into another image
        except BakeError as error:
            self._refused = wanted, str(error)
            raise
        self.free()
        self.session, self._settings, self._refused = session, wanted, None
        self._strokes, self._all_changed = Strokes(session), True
        return False

    def advance(self, seconds: float, rest: float) -> bool:
        """Draw for about `seconds` if anything has changed. Store the normal map after `rest` seconds without a change, and
        draw the other maps after a longer pause. Returns whether there is a new map. Raises BakeError."""
        self._changed |= self._strokes.moved(rest)
        if self._changed or self._all_changed:
            self._begin()
        if self._task is None:
            if not self._is_stored and (self.panel.live_every_time or time.monotonic() - self._drawn_at > rest):
                self._store()
            is_pause = self._is_stored and not self._strokes.are_open
            is_pause &= time.monotonic() - self._drawn_at > PAUSES * rest
            return is_pause and self._needs_others and self._advance_others(seconds)
        try:
            self.session.advance(self._task, seconds)
        except StopIteration:
            self._task, self._is_stored, self._drawn_at = None, False, time.monotonic()
            self._unread.clear()
            if self.panel.live_every_time:
                self._store()
        return True

    def complete(self) -> Task[None]:
        """Draw and store the other maps at once if they do not show the last change. Raises BakeError."""
        if self._needs_others and self.session.drawn:
            self._cancel_others()
            yield from self.session.other_steps()
            self.session.store_others()
            self._are_others_old = False

    def interrupt(self) -> None:
        """Cancel the maps that are being drawn. The objects that they had to read count as changed for the next map."""
        self._cancel_others()
        if self._task is not None:
            self._task.close()
        self._task = None

    def _advance_others(self, seconds: float) -> bool:
        """Draw the other maps for about `seconds`, and store them at the end. Returns whether they are done. What cannot be
        drawn is not tried again before the next change. Raises BakeError."""
        if self._other_task is None:
            self._other_task = self.session.other_steps()
        is_tried = True
        try:
            run_for(self._other_task, seconds)
            is_tried = False
        except StopIteration:
            self.session.store_others()
        finally:
            if is_tried:
                self._are_others_old, self._other_task = False, None
        return is_tried

    def _cancel_others(self) -> None:
        if self._other_task is not None:
            self._other_task.close()
        self._other_task = None

    def free(self) -> None:
        """Cancel the maps that are being drawn, and free the session's GPU memory."""
        self.interrupt()
        self.session.free()

    def _begin(self) -> None:
        self.interrupt()
        self._unread |= self._changed
        if self._all_changed:
            self._unread |= self.session.uids
        self._changed.clear()
        self._all_changed, self._are_others_old = False, True
        self._task = self.session.work(bpy.context, set(self._unread))

    def _store(self) -> None:
        self.session.store()
        self._is_stored = True
