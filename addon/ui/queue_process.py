# SPDX-License-Identifier: GPL-3.0-or-later
"""The program of the queue's process: bakes sets of a copy of the file, one after the other, as the window does.

What a bake makes goes to the window, which puts it into its file and says whether it has. Messages are lists whose first item
is a word: "ready", "opened", then for each set "share", "folder", "made" and "ended". The window answers each but "share" and
"folder", and may send "pause", "go" and "cancel" at any time.
"""

import faulthandler
import os
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import older_blender
from ..core.errors import BakeError, sentence
from ..core.processes import CONNECTION, end_with_parent
from ..core.progress import Pace, Progress
from ..core.report import Report
from ..jobs.job import Wants
from ..jobs.sets import SetJob
from ..output import atomic_file, datablocks
from ..output.journal import Journal
from . import results, set_operators
from .results import Batch

if os.name == "nt":
    from multiprocessing.connection import PipeConnection

FAILURE = "object_pairs.keep_failure"
SHARE_EVERY = 0.1
"""Seconds between two messages about how far a set is."""
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
        self._next = 0.0
        """When it is told again how far the set is, by time.monotonic."""
        self._sending = threading.Lock()

    def send(self, *message: Any) -> None:
        try:
            with self._sending:
                self._connection.send(list(message))
        except OSError as error:
            raise _Gone from error

    def share(self, done: float) -> None:
        """Tell how far the set is, unless that was told just now."""
        now = time.monotonic()
        if now > self._next:
            self._next = now + SHARE_EVERY
            self.send("share", done)

    def tell_folder(self, folder: Path) -> None:
        """Tell that a folder is about to have temporary files, which the window removes if this process is killed."""
        self.send("folder", str(folder))

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
    atomic_file.before_first = window.tell_folder
    faulthandler.enable(all_threads=False)
    try:
        setup = Setup(**window.ask("ready"))
        _open(setup)
        _, name, changed = window.ask("opened")
        while True:
            window.begin()
            bake = partial(_result, window, setup, name, changed=changed)
            _, name, changed = window.ask("ended", *older_blender.with_gpu(bake))
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


def _result(window: _Window, setup: Setup, name: str, *, changed: bool) -> tuple[str, str, list, list]:
    """Bake a set. Returns how that ended, a sentence, what was left out, and what else changes the file."""
    left_out: list[tuple[str, str]] = []
    journal = Journal(Path(setup.folder), setup.file)
    try:
        with journal.recording():
            reports = _bake(window, setup, journal, left_out, set_operators.chosen(bpy.context, name), changed=changed)
            results.keep_batch(Batch(left_out, sorted({report.low for report in reports})))
        ended, why = "DONE", ""
    except Canceled:
        ended, why = "CANCELED", ""
    except NotTaken as error:
        ended, why = "NOT_TAKEN", str(error)
    except (BakeError, MemoryError) as error:
        ended, why = "FAILED", sentence(error)
    finally:
        rest = [each for each in journal.calls if each[0] == FAILURE]
        journal.close()
    return ended, why, left_out, rest


def _bake(
    window: _Window,
    setup: Setup,
    journal: Journal,
    left_out: list[tuple[str, str]],
    chosen: list[tuple[SetJob, Wants]],
    *,
    changed: bool,
) -> list[Report]:
    """Bake sets, and have the window take each image with all that is shown in it. Adds to what was left out."""
    made: list[Report] = []
    taken: list[Report] = []

    def deliver() -> None:
        lows = {report.refs[0] for report in made}
        own = [each for each in (*taken, *made) if each.refs[0] in lows]  # they replace all that a low object has
        problem = window.ask("made", journal.calls, list(map(_plain, own)))["problem"]
        if problem:
            raise NotTaken(problem)
        journal.taken()
        taken.extend(made)
        made.clear()

    chosen = [(_in_place(set_job, setup), wants) for set_job, wants in chosen]
    baking = set_operators.bake_sets(bpy.context, chosen, Pace(SLICE, has_picture=False), changed=changed)
    try:
        while True:
            step: Progress = next(baking)
            window.share(step.done)
            if step.report:
                made.append(step.report)
                continue  # the reports of a shared image follow each other
            if made:
                deliver()
            window.obey()
    except StopIteration as end:
        done = end.value
    except BakeError:
        if made:  # images before the one that failed stay
            deliver()
        raise
    finally:
        baking.close()
    if made:
        deliver()
    left_out += done.left_out
    return done.reports


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
