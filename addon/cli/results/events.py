# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens in a call, for programs that read it while it goes on: an object of JSON a line, on standard error."""

import io
import json
import re
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from enum import StrEnum
from typing import Any, TextIO

from ...core.progress import Progress
from .. import standard_streams
from ..plan.plans import Plan
from ..terminal_progress import Meter
from . import run_report
from .run_report import Entry

OPTION, JSON = "--progress", "json"
EVERY = 0.25
"""Seconds between two events with the percentage of a bake."""


def are_wanted(words: Sequence[str]) -> bool:
    """Whether the arguments ask for events. Mistakes in the arguments become events as well."""
    return f"{OPTION}={JSON}" in words or (OPTION, JSON) in zip(words, words[1:], strict=False)


@contextmanager
def meter(words: Sequence[str]) -> Iterator[Meter]:
    """What shows the progress of a call with these arguments. With events, nothing else is on standard error meanwhile."""
    if not are_wanted(words):
        with Meter(sys.stderr) as shown:
            yield shown
        return
    out, events = sys.stdout, Events(sys.stderr)
    with (
        standard_streams.silence(),  # of Blender, in C
        redirect_stdout(out),
        redirect_stderr(_Messages(events)) as messages,
    ):
        yield events
        messages.end()


class Severity(StrEnum):
    """What a line on standard error is."""

    INFO = "info"
    """Such as the summary of a bake whose report is on standard output."""
    WARNING = "warning"
    ERROR = "error"

    @classmethod
    def of(cls, line: str) -> "Severity":
        """From the start of a line: the program's name, perhaps that of a bake, and "warning"."""
        if not re.match(r"imprint[\w ]*: ", line):
            return cls.INFO
        return cls.WARNING if ": warning: " in line else cls.ERROR


class Events(Meter):
    """Writes events to `stream`. The keys of each are in the manual."""

    def __init__(self, stream: TextIO):
        super().__init__(stream)
        self.is_on = True
        self._plan: Plan | None = None
        """The bake that began last, which is the only one if there is one process."""
        self._times: dict[int, float] = {}
        """When each bake's percentage was written last, by time.monotonic."""
        self._counted = run_report.summary(())

    def be_quiet(self) -> None:
        self.is_quiet = True

    def planned(self, planned: int, chosen: int, shard: str = "") -> None:
        self.write("planned", planned=planned, chosen=chosen, shard=shard or None)

    def begin(self, plan: Plan, place: str = "") -> None:
        super().begin(plan, place)
        self._plan = plan
        self.write("started", number=plan.number, name=plan.name)

    def show(self, name: str, step: Progress, plan: Plan | None = None) -> None:
        of, now = plan or self._plan, time.monotonic()
        if of is None or now - self._times.get(of.number, -EVERY) < EVERY:
            return
        self._times[of.number] = now
        percent = round(100.0 * min(step.done, 1.0), 1)
        self.write("percent", number=of.number, name=of.name, percent=percent, what=step.what)

    def ended(self, entry: Entry) -> None:
        self._plan = None
        self._times.pop(entry.number, None)
        run_report.count(self._counted, entry)
        self.write(
            str(entry.state),
            number=entry.number,
            name=entry.name,
            seconds=entry.seconds,
            files=[each["path"] for each in entry.files],
            error=entry.error,
            cause=str(entry.cause),
            signal=entry.signal,
            gate=entry.gate,
        )

    def report(self, line: str) -> None:
        if not self.is_quiet:
            severity = Severity.of(line)
            self.message(Severity.INFO if severity == Severity.ERROR else severity, line)

    def message(self, severity: "Severity", text: str) -> None:
        """Write a line as an event."""
        self.write("message", severity=str(severity), text=text)

    def finished(self, code: int) -> None:
        self.write("finished", exit_code=code, **self._counted)

    def clear(self) -> None:
        """There is no line to erase."""

    def write(self, event: str, **values: Any) -> None:
        """Write an event."""
        self._stream.write(json.dumps({"event": event, **values}) + "\n")
        self._stream.flush()


class _Messages(io.TextIOBase):
    """Standard error, each line of which becomes an event."""

    def __init__(self, events: Events):
        self._events, self._rest = events, ""

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
        *lines, self._rest = (self._rest + text).split("\n")
        for line in filter(None, lines):
            self._events.message(Severity.of(line), line)
        return len(text)

    def end(self) -> None:
        """Write a line that has no end yet."""
        self.write("\n")
