# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in the window: in slices, with a bar, the views to look around in, and Esc. Scripts get it at once."""

import bpy

from ..core import progress
from ..core.errors import BakeError, sentence
from .viewport import progress_display

SLICE = 0.03
"""Seconds of rays between two looks at the clock."""
TICK = 0.08
"""Seconds of work between two events of the window."""
LOOKING_AROUND = {
    "MOUSEMOVE",
    "MIDDLEMOUSE",
    "WHEELUPMOUSE",
    "WHEELDOWNMOUSE",
    "TRACKPADPAN",
    "TRACKPADZOOM",
    "NDOF_MOTION",
}
"""Events that go on to the views while work is going on. All others could change what is being baked."""


class _Run:
    """What is going on: its steps, and the timer that makes them. Blender may free the operator, and not this."""

    def __init__(self, context: bpy.types.Context, steps: progress.Task):
        self.steps = steps
        self.timer = context.window_manager.event_timer_add(0.01, window=context.window)


_run: _Run | None = None


def stop(context: bpy.types.Context) -> None:
    """End what is going on where it is, and take its bar off the screen. What was not done changes nothing."""
    global _run  # noqa: PLW0603 - there is one at a time, and an extension that is switched off must find it
    if _run is None:
        return
    run, _run = _run, None
    try:
        run.steps.close()
    finally:
        context.window_manager.event_timer_remove(run.timer)
        progress_display.hide(context)


def _stopped(context: bpy.types.Context) -> str:
    """Stop, and return what is left of it, in words."""
    finished = progress_display.current().finished
    stop(context)
    return "Stopped." + (f" {finished} maps were done before and are kept." if finished else " Nothing was changed.")


class InSlices:
    """An operator that works: all at once for scripts, in slices from the window.

    What it does comes from `_work`, a generator that may raise BakeError; `_finish` gets what it returns.
    """

    _own: _Run | None = None

    def _work(self, context: bpy.types.Context, speed: progress.Pace) -> progress.Task:
        raise NotImplementedError

    def _finish(self, context: bpy.types.Context, result) -> None:
        """Called when all is done."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            result = progress.finish(self._work(context, progress.Pace()))
        except (BakeError, MemoryError) as error:
            self.report({"ERROR"}, sentence(error))
            return {"CANCELLED"}
        self._finish(context, result)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _run  # noqa: PLW0603 - see stop
        if context.window is None:
            return self.execute(context)
        self._own = _run = _Run(context, self._work(context, progress.Pace(SLICE)))
        context.window_manager.modal_handler_add(self)
        progress_display.show(context, progress.Progress("Starting", 0.0))
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if _run is None or _run is not self._own:  # it was ended from outside
            return {"CANCELLED"}
        if event.type == "ESC":
            self.report({"WARNING"}, _stopped(context))
            return {"CANCELLED"}
        if event.type in LOOKING_AROUND:
            return {"PASS_THROUGH"}
        if event.type == "TIMER":
            return self._go_on(context)
        return {"RUNNING_MODAL"}

    def _go_on(self, context: bpy.types.Context) -> set[str]:
        goes_on = False
        try:
            progress_display.show(context, progress.run_for(_run.steps, TICK))
            goes_on = True
        except StopIteration as end:
            self._finish(context, end.value)
            return {"FINISHED"}
        except (BakeError, MemoryError) as error:
            self.report({"ERROR"}, sentence(error))
            return {"CANCELLED"}
        finally:  # after an error that nobody has thought of as well: else the next bake would wait for this one
            if not goes_on:
                stop(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender calls this when the file is closed in the middle."""
        if _run is self._own:
            stop(context)


class IMPRINT_OT_stop(bpy.types.Operator):
    """Stop what Imprint is doing; maps that are done are kept"""

    bl_idname = "imprint.stop"
    bl_label = "Stop"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return _run is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.report({"WARNING"}, _stopped(context))
        return {"FINISHED"}


_keymap: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []
CLASSES = (IMPRINT_OT_stop,)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()
    keys = bpy.context.window_manager.keyconfigs.addon
    if keys is not None:  # there is none in the background
        # A modal operator hears its own window alone; this one hears Esc in the others.
        keymap = keys.keymaps.new("Window")
        _keymap.append((keymap, keymap.keymap_items.new(IMPRINT_OT_stop.bl_idname, "ESC", "PRESS")))


def unregister() -> None:
    while _keymap:
        keymap, item = _keymap.pop()
        keymap.keymap_items.remove(item)
    _unregister()
