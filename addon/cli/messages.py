# SPDX-License-Identifier: GPL-3.0-or-later
"""What a parent and its workers send each other over a connection of multiprocessing.

A worker that has ended a bake sends a bake_result.Done. Parents send pickles. Workers send JSON: a worker that a file has taken
over must not run code in its parent, or change its classes.
"""

import functools
import json
from dataclasses import dataclass, field, is_dataclass
from enum import StrEnum
from typing import Any, get_args, get_origin, get_type_hints

from . import run_report, sheet
from .bake_result import Done
from .plans import Plan
from .records import Draft
from .run_options import RunOptions


@dataclass(frozen=True)
class Assignment:
    """To a worker: a bake to do."""

    plan: Plan
    options: RunOptions
    """Of the run, as the next three."""
    needs_all: bool
    """As batch.need_all says of all plans."""
    is_shown: bool
    """Whether the parent shows how far bakes are."""
    folders: tuple[str, ...] = ()
    """Those that bakes of untrusted files read; none for others."""
    log: str = ""
    """The file for all that the process prints; empty for none."""
    draft: Draft | None = None
    """Of the record; None for a bake without one."""


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
    """To the parent, which sends an Answer: a bake found more files, as the arguments of clashes.RunFiles.opened, or an export,
    that of clashes.RunFiles.exported."""

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


MOST_BYTES = 1 << 26
"""Of a message from a worker for untrusted files. Others may have long sequences, with a report for each frame."""
_FROM_WORKERS = {each.__name__: each for each in (Done, FilesFound, Ready, Begun, Percent, Line)}
_PICTURE = b"\0"
"""Between the JSON of a message, which has no such byte, and the picture of a Done."""


def packed(message: Any) -> bytes:
    """A message of a worker as JSON."""
    values = dict(vars(message))
    picture = values.pop("picture", b"")
    text = json.dumps([type(message).__name__, values], default=vars)
    return text.encode() + _PICTURE + picture


def unpacked(content: bytes, *, is_trusted: bool = True) -> Any:
    """A message of a worker from its bytes. Raises OSError for what is no message.

    is_trusted: whether the figures in its reports are taken to be such.
    """
    text, _, picture = content.partition(_PICTURE)
    try:
        name, values = json.loads(text)
        if name == Done.__name__:
            values["picture"] = picture
        message = _made(values, _FROM_WORKERS[name])
        if not is_trusted and isinstance(message, Done):
            _check_figures(message)
    except (LookupError, ValueError, TypeError, AttributeError, MemoryError, RecursionError) as error:
        raise OSError("no message") from error
    return message


def _made(value: Any, hint: Any) -> Any:
    """A value from JSON as the type of an annotation. Raises LookupError, TypeError or ValueError if it is of another."""
    kind, given = get_origin(hint) or hint, get_args(hint)
    if kind is Any:
        return value
    if is_dataclass(kind):
        return kind(**{name: _made(value[name], each) for name, each in _hints(kind).items()})
    if issubclass(kind, StrEnum):
        return kind(value)
    if kind is tuple:
        return tuple(_made(each, own) for each, own in zip(value, given, strict=True))
    if not isinstance(value, int | float if kind is float else kind):
        raise TypeError(f"{value!r} is no {kind.__name__}")
    return [_made(each, given[0]) for each in value] if kind is list else value


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _check_figures(done: Done) -> None:
    """Raise LookupError, TypeError, ValueError or AttributeError if a result cannot be shown as those of bakes are."""
    for each in (*done.entry.files, *done.entry.inputs):
        if not all(isinstance(each[name], str) for name in ("path", "what")):
            raise TypeError("a file without a path")
    if not all(isinstance(path, str) for each in done.entry.reports for path in run_report.paths(each)):
        raise TypeError("a path that is no text")
    sheet.row(done.entry.to_dict(), b"")
