# SPDX-License-Identifier: GPL-3.0-or-later
"""What a parent and its workers send each other, and what a parent takes from a worker for files that are not trusted.

A file may have taken such a worker over. So each of its messages is compared with a schema, the bounds here and the bake that
it has, before anything is done with it. What does not fit is `WrongMessage`, whatever it is, and ends the worker.
"""

import functools
import json
import math
import os
import re
from collections import Counter
from dataclasses import dataclass, field, is_dataclass
from enum import StrEnum
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints, is_typeddict

from . import interruption, run_report, sheet, terminal
from .options import RunOptions
from .plans import Plan
from .run_report import Entry, State


@dataclass(frozen=True)
class Setup:
    """To a worker, in a tuple with an Assignment: what all bakes of the run have in common."""

    options: RunOptions
    needs_all: bool
    """As baker.need_all returns it for all plans."""
    is_shown: bool
    """Whether the parent shows how far bakes are."""
    folders: tuple[str, ...] = ()
    """Those that bakes of untrusted files read; none for others."""


@dataclass(frozen=True)
class Answer:
    """To a worker: its files may be used, or the sentence that says why not.

    Attributes:
        problem: The sentence; empty if the files may be used.
    """

    problem: str = ""


@dataclass(frozen=True)
class Ready:
    """To the parent: Blender and its GPU have started.

    Attributes:
        most_bakes: After so many, another worker takes its place; 0 for any number.
    """

    most_bakes: int = 0


@dataclass(frozen=True)
class Accepted:
    """To the parent: the worker has its Assignment. Without that, another worker can have it."""


@dataclass(frozen=True)
class FilesFound:
    """To the parent, which sends an Answer: a bake found more files: see clashes.RunFiles.opened and clashes.RunFiles.exported.

    Attributes:
        lows: Names of low objects.
        used: Paths of files, and what they are.
        export: A path; empty for none.
    """

    lows: list[str] = field(default_factory=list)
    used: list[tuple[str, str]] = field(default_factory=list)
    export: str = ""


@dataclass(frozen=True)
class Percent:
    """To the parent: how far a bake is.

    Attributes:
        done: From 0 to 1.
        subject: What is baked.
        what: The step that it is in.
    """

    subject: str
    what: str
    done: float


@dataclass(frozen=True)
class Line:
    """To the parent: a line to print before a bake, which can take long."""

    line: str


LONGEST_MESSAGE = 1 << 26
"""Of a message from a worker for untrusted files. Others may have long sequences, with a report for each frame."""
MOST_PARTS = 1 << 22
"""Values in such a message, which take memory here however short they are."""
MOST_NESTED = 20
"""Lists and objects in each other. A report has 6."""
LONGEST_TEXT = 1 << 16
"""Characters of a text or a name."""
MOST_LINES = 1000
"""Lines to print before a bake ends."""
MOST_FOUND = 20_000
"""Files and names that a bake finds, each of which its parent looks for on the disk."""
MOST_LISTED = 1_000_000
"""Files, lines and reports in each list of an entry: one for each map that `--untrusted` plans."""
LARGEST_NUMBER = 1 << 53
"""Whole numbers below it are the same in all programs that read JSON."""
_FROM_WORKERS = {each.__name__: each for each in (Entry, FilesFound, Ready, Accepted, Percent, Line)}
_PICTURE = b"\0"
"""Between the JSON of a message, which has no such byte, and the picture of an Entry."""
_NO_TEXT = re.compile("[\ud800-\udc7f\udd00-\udfff]")
"""Halves of characters. The others of them stand for bytes of names that are not UTF-8."""


class WrongMessage(OSError):
    """What a worker has sent is no message, or none that it may send now."""


def packed(message: Any) -> bytes:
    """A message of a worker as JSON."""
    values = dict(vars(message))
    image = values.pop("image", b"")
    text = json.dumps([type(message).__name__, values], default=vars)
    return text.encode() + _PICTURE + image


def unpacked(content: bytes, *, is_trusted: bool = True) -> Any:
    """A message of a worker from its bytes. Raises WrongMessage.

    is_trusted: whether the values in its reports are taken to be of the right types.
    """
    text, _, image = content.partition(_PICTURE)
    try:
        name, values = json.loads(text) if is_trusted else _checked(text)
        if name == Entry.__name__:
            values["image"] = image
        elif image:
            raise ValueError("a picture of none")
        message = _made(values, _FROM_WORKERS[name])
        if not is_trusted:
            _check(message, values)
    except Exception as error:  # noqa: BLE001 - whatever a message does to its reader, it is none
        raise WrongMessage("no message") from error
    return message


def _checked(text: bytes) -> Any:
    """The values in a text of JSON, if they are as short, few and flat as those of messages. Raises ValueError and others."""
    if text.count(b",") + text.count(b"[") + text.count(b"{") > MOST_PARTS:
        raise ValueError("too many values")
    values = json.loads(text.decode(), parse_int=_whole, parse_float=_finite, parse_constant=_finite)
    _check_flat([values])
    return values


def _whole(text: str) -> int:
    value = int(text) if len(text) < 20 else LARGEST_NUMBER
    if abs(value) >= LARGEST_NUMBER:
        raise ValueError("a large number")
    return value


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("no number")
    return value


def _check_flat(values: list[Any]) -> None:
    """Raise ValueError for texts that are long or no text, and for values that are nested too deep."""
    for _ in range(MOST_NESTED):
        inner: list[Any] = []
        for value in values:
            if isinstance(value, dict):
                inner += value
                inner += value.values()
            elif isinstance(value, list):
                inner += value
            elif isinstance(value, str) and (len(value) > LONGEST_TEXT or _NO_TEXT.search(value)):
                raise ValueError("no text")
        if not inner:
            return
        values = inner
    raise ValueError("nested too deep")


def _made(value: Any, hint: Any) -> Any:
    """A value from JSON as the type of an annotation. Raises LookupError, TypeError or ValueError if it is of another."""
    kind, given = get_origin(hint) or hint, get_args(hint)
    if kind is Any:
        return value
    if kind is UnionType:
        return _made(value, next(each for each in given if isinstance(value, each)))
    if is_typeddict(kind):
        return {name: _made(value[name], each) for name, each in _hints(kind).items()}
    if is_dataclass(kind):
        return kind(**{name: _made(value[name], each) for name, each in _hints(kind).items()})
    if issubclass(kind, StrEnum):
        return kind(value)
    if kind is tuple:
        return tuple(_made(each, own) for each, own in zip(value, given, strict=True))
    is_right = isinstance(value, int | float if kind is float else kind)
    if not is_right or (isinstance(value, bool) and kind is not bool):
        raise TypeError(f"{value!r} is no {kind.__name__}")
    return [_made(each, given[0]) for each in value] if kind is list else value


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _check(message: Any, values: dict[str, Any]) -> None:
    """Raise ValueError, TypeError and others unless a message is one that a worker sends."""
    if values.keys() != _hints(type(message)).keys():
        raise ValueError("other keys")
    match message:
        case Ready():
            is_right = message.most_bakes >= 0
        case Percent():
            is_right = 0.0 <= message.done <= 1.0
        case FilesFound():
            is_right = len(message.lows) + len(message.used) <= MOST_FOUND
        case Entry():
            lists = [each for each in vars(message).values() if isinstance(each, list)]
            is_right = message.seconds >= 0.0 and max(map(len, lists)) <= MOST_LISTED
            _check_entry(message)
        case _:
            is_right = True
    if not is_right:
        raise ValueError("out of bounds")


def _check_entry(entry: Entry) -> None:
    """Raise LookupError, TypeError, ValueError and others if an entry cannot be shown as those of bakes are."""
    if not all(os.path.isabs(each["path"]) for each in (*entry.files, *entry.inputs)):
        raise ValueError("a file in no folder")
    written = (paths for each in entry.reports for paths in run_report.written_paths(each).values())
    if not all(isinstance(path, str) for paths in written for path in paths):
        raise TypeError("a path that is no text")
    sheet.row(entry.to_dict(), b"")
    terminal.line(entry, 0)


class Turns:
    """What a worker may send next: that it is ready, and for each bake that it has begun, what it finds, and how it ended."""

    def __init__(self):
        self._is_ready = self._has_accepted = False
        self._sent: Counter[type] = Counter()

    def check(self, message: Any, plan: Plan | None) -> None:
        """Raise WrongMessage unless it is the turn of a message. plan: of its bake."""
        match message:
            case Ready():
                is_right, self._is_ready = not self._is_ready, True
            case Accepted():
                is_right = self._is_ready and plan is not None and not self._has_accepted
                self._has_accepted = True
                self._sent.clear()
            case Entry():
                is_right = self._has_accepted and plan is not None and message.number == plan.number
                is_right = is_right and message.name == plan.name
                # A bake that was not stopped would be missing, and no failure either.
                is_stopped = message.state == State.STOPPED and bool(interruption.code())
                is_right = is_right and (is_stopped or (message.is_listed and message.state != State.STOPPED))
                self._has_accepted = False
            case _:
                self._sent[type(message)] += self._size(message)
                is_right = (
                    self._has_accepted and self._sent[Line] <= MOST_LINES and self._sent[FilesFound] <= MOST_FOUND
                )
        if not is_right:
            raise WrongMessage("not its turn")

    @staticmethod
    def _size(message: Any) -> int:
        return 20 + len(message.lows) + len(message.used) if isinstance(message, FilesFound) else 1
