# SPDX-License-Identifier: GPL-3.0-or-later
"""Base classes of operators: they run tasks in slices in the window, with a progress bar, view navigation, and Esc.

Scripts run tasks at once. Memory of the GPU is freed if there was no bake for a while.
"""

import textwrap
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from .. import older_blender
from ..core import progress
from ..core.errors import BakeError, in_window, sentence
from ..core.progress import Pace, Progress, Task
from ..core.sentences import NOTE, by_harm
from ..engine import gpu_memory
from .callbacks import Key, Timer, events
from .held_files import held_files
from .held_maps import held
from .live import live
from .progress_display import MAIN, display
from .texts import labeled, tooltip

SLICE = 0.06
"""Seconds of rays between two checks of the clock."""
TICK = 0.12
"""Seconds of work between two events of the window: with a slice, less than 0.2, so that Esc acts at once."""
NAVIGATION = {
    "MOUSEMOVE",
    "MIDDLEMOUSE",
    "WHEELUPMOUSE",
    "WHEELDOWNMOUSE",
    "TRACKPADPAN",
    "TRACKPADZOOM",
    "NDOF_MOTION",
}
"""Events that viewports get while a task runs. All others could change the objects of the bake."""
LAST_OPERATION = 40
"""Characters in a line of Adjust Last Operation, a box that Blender makes no wider for its text."""


@dataclass(frozen=True, eq=False)
class Run:
    """A task that is running, and the timer of the window that advances it."""

    task: Task
    timer: bpy.types.Timer


class Runner:
    """Runs one task at a time.

    run: the one that is running, or None. It outlives the operator, which Blender may free.
    """

    def __init__(self):
        self.run: Run | None = None
        events.hear(end=lambda: self.stop(bpy.context))

    def start(self, context: bpy.types.Context, task: Task, operator: str = MAIN) -> Run:
        """Begin a task, without doing its first step. operator: whose button becomes the bar."""
        self.run = Run(task, context.window_manager.event_timer_add(0.01, window=context.window))
        display.operator = operator
        display.show(context, Progress("Starting", 0.0))
        return self.run

    def advance(self, context: bpy.types.Context) -> None:
        """Do as much of the task as one tick allows. Raises StopIteration with its result at the end, and what the task
        raises."""
        display.note_drawn()
        display.show(context, progress.run_for(self.run.task, TICK))

    def stop(self, context: bpy.types.Context) -> str:
        """Cancel the task, and remove its progress bar. Returns a sentence about the maps that remain.

        Unfinished work changes nothing. Without a task, nothing happens.
        """
        if self.run is None:
            return ""
        finished = display.current.finished if display.current is not None else 0
        run, self.run = self.run, None
        try:
            run.task.close()
        finally:
            held_files.end()
            context.window_manager.event_timer_remove(run.timer)
            display.hide(context)
        return "Stopped." + (f" Finished before, and kept: {finished}." if finished else " Nothing was changed.")


runner = Runner()


class SlicedOperator:
    """An operator that runs a task: at once in scripts, in slices in the window."""

    _own: Run | None = None

    @property
    def _is_undone(self) -> bool:
        """Whether Blender makes a step of Undo of it."""
        return "UNDO" in getattr(type(self), "bl_options", ())

    def task(self, context: bpy.types.Context, pace: Pace) -> Task:
        """The task of the operator. It may raise BakeError."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, result) -> None:
        """Called with the task's result when it is done."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        with held_files.step() if self._is_undone else nullcontext():
            try:
                result = progress.finish(self.task(context, Pace()))
            except (BakeError, MemoryError) as error:
                self.report({"ERROR"}, in_window(sentence(error))[0])
                return {"CANCELLED"}
            self.finish(context, result)
            held.hold()
            return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if context.window is None:
            return self.execute(context)
        operator = getattr(type(self), "bl_idname", MAIN)
        self._own = runner.start(context, self.task(context, Pace(SLICE)), operator)
        if self._is_undone:
            held_files.begin()
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if runner.run is None or runner.run is not self._own:  # it was stopped by another operator or by Blender
            return {"CANCELLED"}
        if event.type == "ESC":
            self.report({"WARNING"}, runner.stop(context))
            return {"CANCELLED"}
        if event.type in NAVIGATION:
            return {"PASS_THROUGH"}
        if event.type == "TIMER":
            return self._advance(context)
        return {"RUNNING_MODAL"}

    def _advance(self, context: bpy.types.Context) -> set[str]:
        goes_on = False
        try:
            runner.advance(context)
            goes_on = True
        except StopIteration as end:
            self.finish(context, end.value)
            held.hold()
            return {"FINISHED"}
        except (BakeError, MemoryError) as error:
            self.report({"ERROR"}, in_window(sentence(error))[0])
            return {"CANCELLED"}
        finally:  # after an unexpected error too: the next bake would wait for this one
            if not goes_on:
                runner.stop(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender if the file is closed while the task runs."""
        if runner.run is self._own:
            runner.stop(context)


class QuickOperator:
    """An operator that does its work at once."""

    def apply(self, context: bpy.types.Context) -> str:
        """Do the work. Returns a message for the status bar, or "" for none. It may raise BakeError."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            done = self.apply(context)
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if done:
            self.report({"INFO"}, done)
        return {"FINISHED"}


class FileOperator(QuickOperator):
    """An operator on a file, for which it asks where it is a button."""

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


def file_filter(pattern: str) -> Any:
    """The property by which Blender's file browser lists files with such names alone."""
    text = "Names of the files that the file browser lists"
    return labeled(StringProperty, "File Filter", text, default=pattern, options={"HIDDEN", "SKIP_SAVE"})


def warning_of_files() -> Any:
    """The property by which Blender's file browser warns before a file is replaced."""
    text = "Warn before a file is replaced"
    return labeled(BoolProperty, "Check Existing", text, default=True, options={"HIDDEN", "SKIP_SAVE"})


class WaitingOperator:
    """An operator that is off while a task runs. It stands before SlicedOperator and QuickOperator among the bases."""

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None


class MapOperator(SlicedOperator):
    """An operator whose task makes maps."""

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if live.is_on:
            cls.poll_message_set(tooltip("Stop Live first: it writes to the same image"))
            return False
        return display.current is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        return older_blender.with_gpu(partial(super().execute, context))

    def draw(self, context: bpy.types.Context) -> None:
        """Show the summary in Adjust Last Operation. Only the panel has settings, with a progress bar and Esc."""
        column = self.layout.column(align=True)
        for line in context.window_manager.imprint_summary.split("\n"):
            for part in textwrap.wrap(line, LAST_OPERATION):
                column.label(text=part, translate=False)

    def show(
        self,
        context: bpy.types.Context,
        lines: Iterable[str],
        warnings: Iterable[str],
        *,
        head: str = "",
        left_out: Iterable[str] = (),
    ) -> None:
        """Show the lines of a summary and warnings in the status bar, the Info editor and the panel.

        head: what was done, with which the summary and the last report begin. left_out: why something was left out.
        """
        manager, lines = context.window_manager, [*filter(None, [head]), *lines]
        self.report({"INFO"}, ". ".join(lines))
        rated = by_harm(warnings)
        told = [("INFO" if one.harm is NOTE else "WARNING", in_window(one)[0]) for one in reversed(rated)]
        told += [("WARNING", in_window(reason)[0]) for reason in left_out]
        for number, (kind, text) in enumerate(told, 1):  # the status bar shows the last report
            self.report({kind}, f"{head}. {text}" if head and number == len(told) else text)
        warnings = [in_window(warning)[0] for warning in rated]
        manager.imprint_summary, manager.imprint_warnings = "\n".join(lines), "\n".join(warnings)


class IMPRINT_OT_stop(bpy.types.Operator):
    """Stop the running bake; maps that are done are kept"""

    bl_idname = "imprint.stop"
    bl_label = "Stop"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return runner.run is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.report({"WARNING"}, runner.stop(context))
        return {"FINISHED"}


EVERY = 15.0
"""Seconds between two checks."""


def free_if_idle() -> float:
    """Free what bakes cache on the GPU if they are idle. Returns the seconds until the next check."""
    if display.current is None and not live.is_on:
        gpu_memory.free_if_idle()
    return EVERY


idle_timer = Timer(free_if_idle, is_lasting=True)


# A modal operator gets the keys of its own window only; this one gets Esc in the others.
_stop_key = Key(IMPRINT_OT_stop.bl_idname, "ESC", "Window")
CLASSES = (IMPRINT_OT_stop,)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()
    _stop_key.add()
    if not bpy.app.background:  # there the next bake of a batch starts soon
        idle_timer.start(EVERY)


def unregister() -> None:
    idle_timer.stop()
    _stop_key.remove()
    _unregister()
