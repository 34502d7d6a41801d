# SPDX-License-Identifier: GPL-3.0-or-later
"""What a parent and its workers send each other, pickled, over a connection of multiprocessing.

A worker that has ended a bake sends a bake_result.Done.
"""

import io
import json
import pickle
from dataclasses import dataclass, field, is_dataclass, replace
from multiprocessing.connection import Connection
from typing import Any, get_args, get_origin, get_type_hints

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


_NO_MESSAGE = (
    *(pickle.UnpicklingError, EOFError, LookupError, ValueError, TypeError, AttributeError),
    *(MemoryError, RecursionError),
)
"""What reading other bytes, or values of other types, raises."""


class _Reader(pickle.Unpickler):
    """Makes no objects but messages: a worker that a file has taken over must not run code in its parent."""

    def find_class(self, module: str, name: str) -> type:
        try:
            return _FROM_WORKERS[module, name]
        except KeyError as error:
            raise pickle.UnpicklingError(f"{module}.{name} is no message") from error


def received(connection: Connection, *, is_trusted: bool = True) -> Any:
    """The next message of a worker. Raises EOFError if it is gone, and OSError for what is no message.

    is_trusted: whether the values in it are taken to be of their types.
    """
    content = connection.recv_bytes(MOST_BYTES)
    try:
        message = _Reader(io.BytesIO(content)).load()
        return message if is_trusted else _checked(message)
    except _NO_MESSAGE as error:
        raise OSError("no message") from error


def _checked(message: Any) -> Any:
    """A message whose values are all of their types. Raises TypeError and what `plain` raises."""
    kind = type(message)
    if kind not in _FROM_WORKERS.values() or not is_dataclass(kind) or not _fits(message, kind):
        raise TypeError(f"{kind} is no message")
    if not isinstance(message, Done):
        return message
    done = plain(message)
    for each in (*done.entry.files, *done.entry.inputs):
        if not all(isinstance(each[name], str) for name in ("path", "what")):
            raise TypeError("a file without a path")
    return done


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is of the type of an annotation."""
    kind, given = get_origin(hint) or hint, get_args(hint)
    if kind is Any:
        return True
    if kind is float:
        return isinstance(value, int | float)
    if not isinstance(value, kind):
        return False
    if is_dataclass(kind):
        return all(_fits(getattr(value, name), each) for name, each in get_type_hints(kind).items())
    if kind is tuple:
        return len(value) == len(given) and all(map(_fits, value, given))
    return kind is not list or all(_fits(each, given[0]) for each in value)
