# SPDX-License-Identifier: GPL-3.0-or-later
"""The program of a worker: bakes one plan after the other as its parent sends them."""

import argparse
import faulthandler
import os
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from io import FileIO
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ..core.errors import WrongPlace, reason
from ..core.processes import CONNECTION, end_with_parent
from ..core.progress import Progress
from ..jobs.job import uses_vulkan
from ..output.atomic_file import make_folder
from . import clashes, interruption, scene_files, standard_streams
from .baker import Baker, start_gpu
from .plans import Plan
from .worker_messages import Accepted, Answer, FilesFound, Line, Percent, Ready, packed
from .worker_process import log_path

if os.name == "nt":
    from multiprocessing.connection import PipeConnection

MOST_ON_VULKAN = 100
"""Bakes of one process: each leaves mappings of memory behind in Blender's Vulkan backend, of which Linux grants 65,530.

A normal map leaves 7, one with three other maps and 4 samples 80, and one with 14 other maps 210."""
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
    end_with_parent()
    standard_streams.ignore_errors()
    prints = _Prints()
    start_gpu()
    with suppress(_Gone):
        parent.send(Ready(MOST_ON_VULKAN if uses_vulkan() else 0))
        baker = None
        while not interruption.code():
            setup, assigned = parent.receive()
            parent.send(Accepted())
            log = log_path(setup.options.log, assigned.plan)
            problem = prints.to(Path(log)) if log else ""
            if setup.folders:
                scene_files.forbid_scripts()
            meter = _Meter(parent, is_on=setup.is_shown)
            baker = baker or Baker(
                _Files(parent), meter, setup.options, needs_all=setup.needs_all, folders=setup.folders
            )
            entry = baker.bake(assigned)
            entry.warnings += [problem] if problem else []
            standard_streams.flush()
            parent.send(entry)
    return 0


class _Prints:
    """Where this process prints. Python's place in a crash goes there, too, also while Blender's messages are discarded."""

    def __init__(self):
        self._crashes = self._report_crashes()

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
        former, self._crashes = self._crashes, self._report_crashes()
        former.close()
        return ""

    def _report_crashes(self) -> FileIO:
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

    def _ask(self, message: FilesFound) -> None:
        self._parent.send(message)
        answer: Answer = self._parent.receive()
        if answer.problem:
            raise WrongPlace(answer.problem)


class _Meter:
    """As terminal.Meter, which only the parent has."""

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
