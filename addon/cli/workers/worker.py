# SPDX-License-Identifier: GPL-3.0-or-later
"""The process of a worker: it bakes what its parent sends, one bake after the other, until the connection closes."""

import argparse
import faulthandler
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from ...core.errors import WrongPlace
from ...core.progress import Progress
from ...core.timings import startup
from .. import interruption, standard_streams
from .messages import Answer, Assignment, FilesFound, Line, Percent, Ready, plain
from .worker_process import CONNECTION

if os.name == "nt":
    from multiprocessing.connection import PipeConnection


def run() -> int:
    """Bake until the parent closes the connection, has gone, or a signal came. Returns the exit code."""
    number = int(os.environ.pop(CONNECTION))
    parent = PipeConnection(number) if os.name == "nt" else Connection(number)
    faulthandler.enable(all_threads=False)
    with startup.spent("imprint"):
        from .. import batch, outside_files  # need Blender, which loads its modules
        from .baker import Baker
    batch.start_gpu()
    with suppress(EOFError, OSError), parent:  # the parent has closed it, or is gone
        parent.send(Ready())
        baker = None
        while not interruption.code():
            assigned: Assignment = parent.recv()
            if assigned.log:
                _print_to(Path(assigned.log))
            if assigned.folders:
                outside_files.forbid_scripts()
            files = _Files(parent)
            of_run = {"needs_all": assigned.needs_all, "is_reported": assigned.is_reported, "folders": assigned.folders}
            baker = baker or Baker(files, _Meter(parent), **of_run)
            done = baker.bake(assigned.plan, assigned.draft)
            standard_streams.flush()
            parent.send(plain(done))
    return 0


def _print_to(path: Path) -> None:
    """Write what this process prints to a new file from now on."""
    standard_streams.flush()
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_CREAT | os.O_TRUNC | os.O_WRONLY, 0o666)
    for number in (1, 2):
        os.dup2(descriptor, number)
    os.close(descriptor)


class _Files:
    """As run_clashes.Run, which only the parent has: it knows the files of all bakes."""

    def __init__(self, parent: Connection):
        self._parent = parent

    def opened(
        self, name: str, options: argparse.Namespace, lows: Sequence[str], used: Iterable[tuple[str, str]]
    ) -> None:
        self._ask(FilesFound(list(lows), list(used)))

    def exported(self, name: str, path: str) -> None:
        self._ask(FilesFound(export=path))

    def _ask(self, found: FilesFound) -> None:
        self._parent.send(found)
        answer: Answer = self._parent.recv()
        if answer.problem:
            raise WrongPlace(answer.problem)


class _Meter:
    """As terminal_progress.Meter, which only the parent has."""

    is_on, place = True, "-"

    def __init__(self, parent: Connection):
        self._parent = parent

    def show(self, name: str, step: Progress) -> None:
        self._parent.send(Percent(name, step.what, step.done))

    def report(self, line: str) -> None:
        self._parent.send(Line(line))

    def clear(self) -> None:
        """There is no line of its own."""
