# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes one plan after the other: all bakes of a run in this process, or in a worker those that its parent sends."""

import argparse
import ctypes
import faulthandler
import os
import signal
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from io import FileIO
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import BakeError, WrongPlace
from ..core.progress import Progress
from ..output import png_writer
from ..output.atomic_file import make_folder, reason
from . import (
    bake_result,
    batch,
    blender_process,
    clashes,
    interruption,
    records,
    run_report,
    scene_files,
    standard_streams,
)
from .bake_result import Done, Result
from .options import RunOptions
from .plans import Plan
from .records import Contents, Draft
from .run_report import State
from .scene_files import SceneLoader
from .terminal import Meter
from .turns import Chains, Resumed, Turns
from .worker_process import CONNECTION, Answer, Assignment, Begun, FilesFound, Line, Percent, Ready, packed

MOST_PICTURES = 4
"""Pairs or frames of a bake that have pictures."""
TURN_WAIT = 0.1
"""Seconds after which signals are checked again, while other processes do all bakes that are left."""


class Baker:
    """Bakes one plan after the other in this process. A bake that fails does not stop the others."""

    def __init__(
        self,
        files: clashes.RunFiles,
        meter: Meter,
        options: RunOptions,
        *,
        needs_all: bool,
        folders: Sequence[str] = (),
    ):
        """Start without a scene.

        Args:
            files: Must have all plans.
            options: Of the run.
            needs_all: As batch.need_all says of all plans.
            folders: As in SceneLoader.
        """
        self._files, self._meter, self._folders, self._loader = files, meter, folders, SceneLoader(folders)
        self._options, self._contents = options, Contents()
        if needs_all:
            blender_process.complete()  # before a file is opened: Cycles brings its settings in old files up to date

    def bake(self, plan: Plan, draft: Draft | None = None) -> Done:
        """Bake a plan. draft: of the record to write."""
        start, found, not_followed = time.perf_counter(), [], []
        hashes = self._contents if self._options.has_hashes or draft is not None else None
        try:
            interruption.check()
            opened = batch.open_files(
                plan, self._loader, self._files, self._meter, hashes, is_pictured=self._options.has_pictures
            )
            found, not_followed = opened.found, opened.not_followed
            result = batch.run(opened, self._loader, self._files, self._meter)
        except interruption.Stopped:
            result = Result(plan.name, is_stopped=True)
        except (BakeError, MemoryError) as error:
            result = bake_result.failure(plan.name, error)
            self._loader = SceneLoader(self._folders)  # the failed bake may have changed the open scene
        result.seconds = time.perf_counter() - start
        self._meter.clear()
        done = Done.of(result, plan.number, _picture(result))
        return records.finish_record(draft, done, found, self._contents, not_followed)


def _picture(result: Result) -> bytes:
    """The pictures of the first few reports, one above the other, as a PNG file; empty if there are none."""
    found = [report.picture for report in result.reports if report.picture is not None][:MOST_PICTURES]
    return png_writer.small(np.concatenate(found)) if found else b""


def bake_all(turns: Turns, files: clashes.RunFiles, meter: Meter, options: RunOptions) -> Iterator[Done]:
    """Do all that is left of `turns`. The last result may be of a bake that was stopped. files, options: as in Baker."""
    count, place, chains = turns.count, 0, Chains()
    baker = Baker(files, meter, options, needs_all=batch.need_all([turn.plan for turn in turns.left]))
    while turns.count:
        turn = turns.next()
        if turn is None:
            time.sleep(TURN_WAIT)
            if interruption.code():
                turns.stop()
            continue
        place += 1
        if isinstance(turn, Resumed):
            yield Done.resumed(turn.plan, turn.result)
            continue
        meter.begin(turn.plan, f"{place}/{count} ")
        refusal = chains.refusal(turn.plan)
        done = Done.of(refusal, turn.plan.number) if refusal else baker.bake(turn.plan, turn.draft)
        chains.ended(turn.plan, done)
        yield done
        if done.entry.state == State.STOPPED:
            turns.stop()


if os.name == "nt":
    from multiprocessing.connection import PipeConnection

_PR_SET_PDEATHSIG = 1
"""Of Linux's prctl: the signal when the parent process ends."""


SHOW_EVERY = 0.1
"""Seconds between two messages about progress."""


class _Gone(Exception):
    """The parent has closed the connection, or has ended."""


class _Parent:
    """The connection to the parent. Both methods raise _Gone."""

    def __init__(self):
        number = int(os.environ.pop(CONNECTION))
        self._connection = PipeConnection(number) if os.name == "nt" else Connection(number)

    def send(self, message: Any) -> None:
        try:
            self._connection.send_bytes(packed(message))
        except OSError as error:
            raise _Gone from error

    def receive(self) -> Any:
        try:
            return self._connection.recv()
        except (EOFError, OSError) as error:
            raise _Gone from error


def run_worker() -> int:
    """Bake until the parent closes the connection, has gone, or a signal came. Returns the exit code."""
    parent = _Parent()
    _end_with_parent()
    standard_streams.be_patient()
    prints = _Prints()
    batch.start_gpu()
    with suppress(_Gone):
        parent.send(Ready())
        baker = None
        while not interruption.code():
            assigned: Assignment = parent.receive()
            parent.send(Begun())
            problem = prints.to(Path(assigned.log)) if assigned.log else ""
            run_report.note(assigned.options.call)
            if assigned.folders:
                scene_files.forbid_scripts()
            meter, of_all = _Meter(parent, is_on=assigned.is_shown), assigned.options
            own = {"needs_all": assigned.needs_all, "folders": assigned.folders}
            baker = baker or Baker(_Files(parent), meter, of_all, **own)
            done = baker.bake(assigned.plan, assigned.draft)
            standard_streams.flush()
            parent.send(replace(done, warnings=[*done.warnings, problem]) if problem else done)
    return 0


def _end_with_parent() -> None:
    """Have the system kill this process when its parent ends. Elsewhere than on Linux it ends by itself, unless it hangs."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class _Prints:
    """Where this process prints. Python's place in a crash goes there, too, also while Blender's messages are discarded."""

    def __init__(self):
        self._crashes = self._tell_crashes()

    def to(self, path: Path) -> str:
        """Print to a new file from now on. Returns a sentence if that fails."""
        standard_streams.flush()
        try:
            make_folder(path.parent)
            descriptor = os.open(path, os.O_CREAT | os.O_TRUNC | os.O_WRONLY, 0o666)
        except OSError as error:
            return f"Its log {str(path)!r} could not be written: {reason(error)}."
        for number in (1, 2):
            os.dup2(descriptor, number)
        os.close(descriptor)
        former, self._crashes = self._crashes, self._tell_crashes()
        former.close()
        return ""

    def _tell_crashes(self) -> FileIO:
        """A second way to standard error as it is now, which Python writes to in a crash."""
        file = FileIO(os.dup(2), "w")
        faulthandler.enable(file, all_threads=False)
        return file


class _Files:
    """As clashes.RunFiles, which only the parent has: it knows the files of all bakes."""

    def __init__(self, parent: _Parent):
        self._parent = parent

    def opened(
        self, name: str, options: argparse.Namespace, lows: Sequence[str], used: Iterable[tuple[str, str]]
    ) -> None:
        more = list(used)
        if more or not clashes.low_of(options):  # else the parent knows them all, and need not be waited for
            self._ask(FilesFound(list(lows), more))

    def exported(self, name: str, path: str) -> None:
        self._ask(FilesFound(export=path))

    def _ask(self, found: FilesFound) -> None:
        self._parent.send(found)
        answer: Answer = self._parent.receive()
        if answer.problem:
            raise WrongPlace(answer.problem)


class _Meter:
    """As terminal_progress.Meter, which only the parent has."""

    place = "-"

    def __init__(self, parent: _Parent, *, is_on: bool):
        """is_on: whether the parent shows what `show` sends."""
        self.is_on = is_on
        self._parent, self._next, self._name = parent, 0.0, ""

    def show(self, name: str, step: Progress, plan: Plan | None = None) -> None:
        now = time.monotonic()
        if now >= self._next or name != self._name:  # small bakes have a step each millisecond
            self._next, self._name = now + SHOW_EVERY, name
            self._parent.send(Percent(name, step.what, step.done))

    def report(self, line: str) -> None:
        self._parent.send(Line(line))

    def clear(self) -> None:
        """There is no line of its own."""
