# SPDX-License-Identifier: GPL-3.0-or-later
"""What a parent and its workers send each other, pickled, over a connection of multiprocessing.

A worker that has ended a bake sends a bake_result.Done.
"""

import io
import json
import pickle
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from typing import Any

from ..done.bake_record import Draft
from ..plan.plans import Plan
from ..results.bake_result import Done, Wanted
from ..results.run_report import Cause, Entry, State


@dataclass(frozen=True)
class Call:
    """What all bakes of a call have in common."""

    needs_all: bool
    """As batch.need_all says of all plans."""
    wanted: Wanted
    is_shown: bool
    """Whether the parent shows how far bakes are."""
    folders: tuple[str, ...] = ()
    """Those that bakes of untrusted files read; none for others."""


@dataclass(frozen=True)
class Assignment:
    """To a worker: a bake to do. draft: of its record, or None for a bake without one. log: the file for all that its process
    prints; empty for none."""

    plan: Plan
    call: Call
    log: str = ""
    draft: Draft | None = None


@dataclass(frozen=True)
class Answer:
    """To a worker: its files may be used, or the sentence that says why not."""

    problem: str = ""


@dataclass(frozen=True)
class Ready:
    """To the parent: Blender and its GPU have started."""


@dataclass(frozen=True)
class Begun:
    """To the parent: the worker has its Assignment. Without that, another one can have it."""


@dataclass(frozen=True)
class FilesFound:
    """To the parent, which sends an Answer: a bake found more files, as the arguments of run_clashes.Run.opened, or an export,
    that of run_clashes.Run.exported."""

    lows: list[str] = field(default_factory=list)
    used: list[tuple[str, str]] = field(default_factory=list)
    export: str = ""


@dataclass(frozen=True)
class Percent:
    """To the parent: how far a bake is. done: from 0 to 1."""

    subject: str
    what: str
    done: float


@dataclass(frozen=True)
class Line:
    """To the parent: a line to print before a bake, which can take long."""

    line: str


def plain(done: Done) -> Done:
    """A result whose values are those that the report will have: text, numbers, lists and tables."""
    return replace(done, entry=Entry.from_dict(json.loads(json.dumps(vars(done.entry)))))


MOST_BYTES = 1 << 26
"""Of a message from a worker."""
_FROM_WORKERS = {
    (each.__module__, each.__qualname__): each
    for each in (Done, Entry, State, Cause, FilesFound, Ready, Begun, Percent, Line)
}


class _Reader(pickle.Unpickler):
    """Makes no objects but messages: a worker that a file has taken over must not run code in its parent."""

    def find_class(self, module: str, name: str) -> type:
        try:
            return _FROM_WORKERS[module, name]
        except KeyError as error:
            raise pickle.UnpicklingError(f"{module}.{name} is no message") from error


def received(connection: Connection) -> Any:
    """The next message of a worker. Raises EOFError if it is gone, and OSError for what is no message."""
    content = connection.recv_bytes(MOST_BYTES)
    try:
        return _Reader(io.BytesIO(content)).load()
    except (pickle.UnpicklingError, EOFError, LookupError, ValueError, TypeError, AttributeError, MemoryError) as error:
        raise OSError("no message") from error
