# SPDX-License-Identifier: GPL-3.0-or-later
"""Live: the map follows the objects. Blender tells what changed; a timer bakes it, a few milliseconds at a time."""

import time
from collections.abc import Callable

import bpy

from ..core import progress
from ..core.errors import BakeError
from ..core.settings import Settings
from ..jobs import live_session
from ..jobs.several import Job
from ..scene import bake_objects
from . import sculpt_strokes
from .viewport.progress_display import display

TICK = 0.02
"""Seconds between two looks at what has changed."""
BUDGET = 0.05
"""Seconds of work at a tick; what does not fit waits for the next. One draw is not cut in pieces."""
SLICE = 0.02
"""Seconds of rays between two looks at the clock."""
REST = 0.4
"""Seconds without a change after which the image gets the map."""

_session: live_session.Session | None = None
_work: progress.Task[None] | None = None
_asked: Settings | None = None
_refused: Settings | None = None
"""What the panel asks for and cannot be done."""
_scene = 0
"""session_uid of the scene in which live was switched on."""
_changed: set[int] = set()
"""session_uid of the objects that are not as they were read."""
_unread: set[int] = set()
_all_changed = False
_since = 0.0
_is_stored = True
_is_short = False
"""Whether an object is gone, for now."""
_is_told = True
"""Whether Blender has told of anything since it was last looked whether all objects are there."""
_strokes: sculpt_strokes.Strokes | None = None
message = ""
"""What kept the last map from being drawn, in a sentence; empty when it was drawn."""
on_new: list[Callable[[], None]] = []
"""Called when there is something new to see."""


def session() -> live_session.Session | None:
    """What is being followed, or None while live is off."""
    return _session


def is_resting() -> bool:
    """Whether there is nothing to do: the image shows the objects as they are, as far as Blender tells."""
    return _work is None and not _changed and not _all_changed and _is_stored and not (_strokes and _strokes.are_open)


def start(context: bpy.types.Context, job: Job, settings: Settings) -> None:
    """All that `starting` does, at once."""
    progress.finish(starting(context, job, settings, progress.Pace(looks=False)))


def starting(context: bpy.types.Context, job: Job, settings: Settings, speed: progress.Pace) -> progress.Task[None]:
    """Follow the objects of a job; its first map is drawn and stored first. Raises BakeError, and then live is off, as when
    the generator is closed."""
    global _session, _asked, _refused, _scene, _strokes, _work, message  # noqa: PLW0603 - see tick
    global _all_changed, _is_stored, _is_short, _is_told  # noqa: PLW0603 - see tick
    stop()
    following = live_session.Session(context, job, settings, speed)
    _session, _asked, _work, message = following, settings, None, ""
    _all_changed, _is_stored, _is_short, _is_told = False, True, False, True
    _refused, _scene, _strokes = None, context.scene.session_uid, sculpt_strokes.Strokes(following)
    for handlers, handler in _handlers():
        handlers.append(handler)  # what changes from now on counts
    is_well = False
    try:
        yield from following.steps(context)
        following.store()
        is_well = True
    finally:
        if not is_well and _session is following:
            stop()
    following.pace = progress.Pace(SLICE, looks=False)
    if not bpy.app.background:
        bpy.app.timers.register(tick, first_interval=TICK)


def finish() -> None:
    """Store the last map for good, in its file or packed, and stop. Raises BakeError if it cannot be stored."""
    try:
        if _session is not None:
            _session.commit()
    finally:
        stop()


def stop() -> None:
    """Stop following. No handler and no timer remains; the image keeps what it has."""
    global _session, _strokes, _work  # noqa: PLW0603 - see start
    if _session is None:
        return
    for handlers, handler in _handlers():
        if handler in handlers:
            handlers.remove(handler)
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    if _work is not None:
        _work.close()
    _session.free()
    _session = _work = _strokes = None
    _changed.clear()
    _unread.clear()


def free() -> None:
    """Free what is kept on the GPU, which the next map makes anew."""
    if _session is not None:
        _session.free()


def tick() -> float | None:
    """Go on with what there is to do. Returns the seconds until the next time, None when live is off."""
    global _work, _is_stored  # noqa: PLW0603 - Blender calls plain functions, and there is one session
    if _session is None:
        return None
    if display.current is not None:  # a bake is going on
        return TICK
    is_well = False
    try:
        if _settings() is None:
            finish()
            _announce()
            return None
        _look_for_objects()
        _look_at_settings()
        _changed.update(_strokes.moved(REST))
        if _changed or _all_changed:
            _begin()
        if _work is not None:
            _advance()
        elif not _is_stored and (every_time() or time.monotonic() - _since > REST):
            _session.store()
            _is_stored = True
        is_well = True
    except BakeError as error:
        _work, is_well = None, _session is not None
        _say(str(error))
    finally:
        if not is_well:
            stop()
    return TICK if is_well else None


def words() -> str:
    """What is being followed, in a sentence; empty while live is off."""
    if _session is None:
        return ""
    low, *others = (found.name if (found := ref.find()) else ref.name for ref in _session.job.refs)
    others = [name for name in dict.fromkeys(others) if name != low]
    return f"Live: {low!r} follows {', '.join(map(repr, others)) or 'its own modifiers'}."


def _look_for_objects() -> None:
    """Raise BakeError while an object is gone: Undo may bring it back, and then all is drawn anew."""
    global _is_told, _is_short, _all_changed  # noqa: PLW0603 - see start
    if not (_is_told or _is_short):
        return
    was_short, _is_short, _is_told = _is_short, True, False
    there = _in_scenes()
    if not there.issuperset(ref.uid for ref in _session.job.refs):
        _all_changed |= _session.job.renew()  # a library was reloaded
        lost = next((ref for ref in _session.job.refs if ref.uid not in there), None)
        if lost is not None:  # a slot of the panel keeps it in the file
            raise BakeError(f"{lost.name!r} was deleted from the scene: bring it back with Undo, or switch Live off.")
    _is_short = False
    _all_changed |= was_short


def _in_scenes() -> set[int]:
    """The session_uid of all objects in scenes: Blender looks through all of them for each that it is asked for."""
    return {obj.session_uid for scene in bpy.data.scenes for obj in scene.objects}


def every_time() -> bool:
    """Whether the image gets each map, and not only the last one when the hand rests."""
    return _settings().live_every_time


def _settings():
    """The settings of the scene in which live was switched on, whichever is shown; None where it is gone."""
    scene = bake_objects.scene_of(_scene)
    return scene and scene.imprint


def _look_at_settings() -> None:
    """Start anew with the same objects where the panel says something else."""
    global _session, _asked, _refused, _strokes, _work, _all_changed  # noqa: PLW0603 - see start
    wanted = _settings().to_settings()
    if wanted == _asked:
        if _refused is not None:
            _refused = None
            _say("")
        return
    if wanted == _refused:
        raise BakeError(message)
    _refused = wanted
    following = live_session.Session(bpy.context, _session.job, wanted, progress.Pace(SLICE, looks=False))
    _session.commit()  # the image need not be the same from now on
    if _work is not None:
        _work.close()
    _session.free()
    _session, _asked, _refused, _work, _all_changed = following, wanted, None, None, True
    _strokes = sculpt_strokes.Strokes(following)


def _begin() -> None:
    global _work, _all_changed  # noqa: PLW0603 - see start
    if _work is not None:
        _work.close()
    # Until a map is done, what it was to show counts as changed.
    _unread.update(_changed)
    if _all_changed:
        _unread.update(_session.uids)
    _changed.clear()
    _all_changed = False
    _work = _session.work(bpy.context, set(_unread))


def _advance() -> None:
    global _work, _since, _is_stored, message  # noqa: PLW0603 - see start
    try:
        _session.advance(_work, BUDGET)
    except StopIteration:
        _work, _since, _is_stored, message = None, time.monotonic(), False, ""
        _unread.clear()
        if every_time():
            _session.store()
            _is_stored = True
    _announce()


def _say(what: str) -> None:
    """Change the message; it is drawn only when it is another one."""
    global message  # noqa: PLW0603 - see start
    if what != message:
        message = what
        _announce()


def _on_save(*_) -> None:
    """What is in memory alone would not be in the file."""
    if _session is not None:
        try:
            _session.commit()
        except BakeError as error:
            _say(str(error))


def _announce() -> None:
    for told in on_new:
        told()


def _handlers() -> list[tuple[list, Callable]]:
    handlers = bpy.app.handlers
    return [
        (handlers.depsgraph_update_post, _on_update),
        (handlers.frame_change_post, _on_update),
        (handlers.save_pre, _on_save),
        (handlers.undo_post, _on_undo),
        (handlers.redo_post, _on_undo),
    ]


def _on_update(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    global _is_told  # noqa: PLW0603 - see start
    _is_told = True
    if _session is None or _strokes.is_asking:
        return
    followed = _session.uids
    for update in depsgraph.updates:
        obj = update.id.original
        if not isinstance(obj, bpy.types.Object) or obj.session_uid not in followed:
            continue
        if update.is_updated_geometry or update.is_updated_transform:
            _changed.add(obj.session_uid)
        else:
            _strokes.told_of(obj)


def _on_undo(*_) -> None:
    global _all_changed, _is_told  # noqa: PLW0603 - see start
    _all_changed = _is_told = True
    if _strokes is not None:
        _strokes.look_at_all()
