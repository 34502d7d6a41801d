# SPDX-License-Identifier: GPL-3.0-or-later
"""The program of the queue's process: bakes sets of a copy of the file, one after the other, as the window does.

What a bake makes goes to the window, which puts it into its file and says whether it has. Messages are lists whose first item
is a word: "ready", "opened", then for each set "share", "made" and "ended". The window answers each but "share", and may send
"pause", "go" and "cancel" at any time.
"""

import faulthandler
import os
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import older_blender
from ..core.errors import BakeError, sentence
from ..core.processes import CONNECTION, end_with_parent
from ..core.progress import Pace, Progress, Task
from ..core.report import Report
from ..jobs import sets as set_jobs
from ..jobs.sets import SetJob
from ..output import atomic_file, datablocks
from ..output.journal import Journal
from . import set_operators

if os.name == "nt":
    from multiprocessing.connection import PipeConnection

SLICE = 0.25
"""Seconds of work between two looks at what the window has sent."""


class Canceled(Exception):
    """The window wants the set no more."""


class NotTaken(Exception):
    """The window has not taken what was made: the copy has it, and the file has not."""


class _Gone(Exception):
    """The window has closed the connection, or has ended."""


@dataclass(frozen=True)
class Setup:
    """What the process opens.

    Attributes:
        copy: The path of the copy of the file.
        beside: Whether it lies beside the file, whose relative paths are then those of the copy.
        file: The path of the file; empty for one that was never saved.
        folder: For large data that the window reads.
        scene, view_layer: Names.
        images: The files with the pixels of images that are not saved, by their names.
        addons: That are enabled besides Blender's own.
        runs_scripts: Whether the file may run its scripts, as drivers do.
    """

    copy: str
    beside: bool
    file: str
    folder: str
    scene: str
    view_layer: str
    images: dict[str, str] = field(default_factory=dict)
    addons: list[str] = field(default_factory=list)
    runs_scripts: bool = False


class _Window:
    """The connection to the window. Its methods raise _Gone."""

    def __init__(self):
        number = int(os.environ.pop(CONNECTION))
        self._connection = PipeConnection(number) if os.name == "nt" else Connection(number)
        self._is_paused = self._is_canceled = False

    def send(self, *message: Any) -> None:
        try:
            self._connection.send(list(message))
        except OSError as error:
            raise _Gone from error

    def ask(self, *message: Any) -> Any:
        """Send a message, and return its answer."""
        self.send(*message)
        while isinstance(answer := self._receive(), str):
            self._note(answer)
        return answer

    def obey(self) -> None:
        """Take what the window has sent meanwhile, and wait while it wants that. Raises Canceled."""
        with suppress(OSError):
            while self._is_paused or self._connection.poll():
                self._note(self._receive())
                if self._is_canceled:
                    break
        if self._is_canceled:
            raise Canceled

    def begin(self) -> None:
        """What was canceled was another set."""
        self._is_canceled = False

    def _note(self, word: str) -> None:
        self._is_canceled |= word == "cancel"
        self._is_paused = word == "pause" or (self._is_paused and word != "go")

    def _receive(self) -> Any:
        try:
            return self._connection.recv()
        except (EOFError, OSError) as error:
            raise _Gone from error


def run() -> None:
    """Bake what the window names, until it closes the connection."""
    window = _Window()
    end_with_parent()
    faulthandler.enable(all_threads=False)
    try:
        setup = Setup(**window.ask("ready"))
        _open(setup)
        _, name = window.ask("opened")
        while True:
            window.begin()
            _, name = window.ask("ended", *older_blender.with_gpu(lambda name=name: _result(window, setup, name)))
    except _Gone:
        atomic_file.remove_all()


def _open(setup: Setup) -> None:
    import addon_utils

    for name in setup.addons:
        addon_utils.enable(name)
    bpy.ops.wm.open_mainfile(filepath=setup.copy, load_ui=True, use_scripts=setup.runs_scripts)
    window = bpy.context.window_manager.windows[0]
    window.scene = bpy.data.scenes[setup.scene]
    window.view_layer = window.scene.view_layers[setup.view_layer]
    for name, path in setup.images.items():
        image, texels = bpy.data.images[name], np.load(path)
        if texels.dtype == np.uint8:
            texels = texels.astype(np.float32) / np.float32(255.0)
        if image.source == "GENERATED":
            datablocks.refill(image, texels, is_float=image.is_float)
        elif tuple(image.size) == texels.shape[1::-1]:
            image.pixels.foreach_set(texels.reshape(-1))
            image.update()


def _result(window: _Window, setup: Setup, name: str) -> tuple[str, str, list]:
    """Bake a set. Returns how that ended, a sentence, and what was left out."""
    left_out: list[tuple[str, str]] = []
    try:
        _bake(window, setup, name, left_out)
    except Canceled:
        return "CANCELED", "", left_out
    except NotTaken as error:
        return "NOT_TAKEN", str(error), left_out
    except (BakeError, MemoryError) as error:
        return "FAILED", sentence(error), left_out
    return "DONE", "", left_out


def _bake(window: _Window, setup: Setup, name: str, left_out: list[tuple[str, str]]) -> None:
    ((set_job, wants),) = set_operators.chosen(bpy.context, name)
    set_job = _in_place(set_job, setup)
    left_out.extend(set_job.left_out)
    journal, sent = Journal(Path(setup.folder), setup.file), []

    def deliver(reports: list[Report]) -> None:
        problem = window.ask("made", journal.calls, [_plain(each) for each in reports])["problem"]
        if problem:
            raise NotTaken(problem)
        journal.taken()
        sent.extend(map(id, reports))

    baking = set_jobs.work(bpy.context, set_job, Pace(SLICE, has_picture=False), wants=wants)
    try:
        with journal.recording():
            reports = _finish(baking, window, deliver, left_out)
        rest = [each for each in reports if id(each) not in sent]
        if rest:
            deliver(rest)
    finally:
        baking.close()
        journal.close()


def _finish(baking: Task[list[Report]], window: _Window, deliver: Any, left_out: list[tuple[str, str]]) -> list[Report]:
    """Take all steps of a bake, and deliver the reports that come with them."""
    made: list[Report] = []
    try:
        while True:
            step: Progress = next(baking)
            window.send("share", step.done, step.what, list(map(str, atomic_file.folders())))
            if step.failure:
                left_out.append(step.failure)
            if step.report:
                made.append(step.report)
            elif made:  # the reports of a shared image follow each other
                deliver(made)
                made = []
            if not made:
                window.obey()
    except StopIteration as end:
        return end.value
    except BakeError:
        if made:  # images before the one that failed stay
            deliver(made)
        raise


def _in_place(set_job: SetJob, setup: Setup) -> SetJob:
    """The set with files where the window would write them, if the copy lies elsewhere. Raises BakeError for a path beside a
    file that was never saved."""
    output = set_job.settings.storing.output
    if setup.beside or not output.startswith("//"):
        return set_job
    if not setup.file:
        raise BakeError(f"{output!r} is relative to a .blend file that was never saved: save it first.")
    output = bpy.path.abspath(output, start=os.path.dirname(setup.file))
    return replace(set_job, settings=set_job.settings.stored(output=output))


def _plain(report: Report) -> dict:
    """A report as plain data, with the names of its objects."""
    refs = [[ref.name, ref.library] for ref in report.refs]
    return {"values": report.to_dict(), "refs": refs, "state": report.state.to_json() if report.state else ""}
