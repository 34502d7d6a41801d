# SPDX-License-Identifier: GPL-3.0-or-later
"""What a call prints: lines and progress on a terminal, or events for programs."""

import io
import json
import re
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from enum import StrEnum
from pathlib import Path
from typing import Any, TextIO

from ..core.naming import printable
from ..core.progress import Progress
from . import run_report, standard_streams
from .options import RunOptions
from .plans import Plan
from .run_report import STDOUT, Entry, Totals


class Meter:
    """Writes the progress to `stream` if it is a terminal, else nothing. Events are another one, for programs."""

    def __init__(self, stream: TextIO):
        self.is_on = stream.isatty()
        self.place = ""
        """The start of the line: the number of the bake among many."""
        self.is_quiet = False
        """Whether lines that are no errors are left out."""
        self._stream, self._width = stream, 0

    def __enter__(self) -> "Meter":
        return self

    def __exit__(self, *_) -> None:
        self.clear()

    def be_quiet(self) -> None:
        """Show errors alone from now on."""
        self.is_quiet, self.is_on = True, False

    def planned(self, planned: int, chosen: int, shard: str = "") -> None:
        """So many bakes are planned, of which so many were chosen. shard: as K/N; empty for all."""

    def begin(self, plan: Plan, place: str = "") -> None:
        """A bake begins. place: as the attribute."""
        self.place = place

    def ended(self, entry: Entry) -> None:
        """A bake has ended, or was done before."""

    def finished(self, code: int) -> None:
        """The call ends with this exit code."""

    def show(self, name: str, step: Progress, plan: Plan | None = None) -> None:
        """Show a step of the object or file `name`. plan: the bake; None for the one that began last."""
        what = step.what if name in step.what else f"{name}: {step.what}"
        self._write(f"{self.place}{what}, {min(step.done, 1.0):.0%}")

    def report(self, line: str) -> None:
        """Print a line that is no error to standard error, in place of the progress."""
        self.clear()
        if not self.is_quiet:
            print(printable(line), file=sys.stderr)

    def clear(self) -> None:
        """Erase the line, so that others can be written."""
        if self._width:
            self._write("")
            self._stream.write("\r")
            self._stream.flush()

    def _write(self, line: str) -> None:
        if not self.is_on:
            return
        line = printable(line)[: shutil.get_terminal_size().columns - 1]  # a longer line would wrap
        self._stream.write("\r" + line.ljust(self._width))
        self._stream.flush()
        self._width = len(line)


def saved(entry: Entry) -> Iterator[str]:
    """A line for each map, in Blender's words after a rendering, by which farms find a picture to show."""
    yield from (printable(f"Saved: '{path}'") for path in entry.paths(run_report.MAP))


def wrote(entry: Entry, report: Path | None) -> str:
    """The files that a single bake wrote, as absolute paths: of frames the first and the last one. report: its file."""
    maps = entry.paths(run_report.MAP)
    if entry.are == "frames" and len(maps) > 2:
        maps = [f"{len(maps)} maps from {maps[0]} to {maps[-1]}"]
    others = entry.paths(run_report.EXPORT, run_report.SCENE)
    return f"Wrote {', '.join([*maps, *others, *([str(report)] if report else [])])}"


def out(options: RunOptions) -> TextIO:
    """Where the summary goes: standard output, or standard error if the report goes there, or nowhere."""
    return io.StringIO() if options.quiet else sys.stderr if options.report == STDOUT else sys.stdout


def line(entry: Entry, width: int) -> str:
    """A line of the table of many bakes. width: of the longest name."""
    paths = ", ".join(entry.paths(run_report.MAP, run_report.EXPORT))
    return printable(f"{entry.state:7} {entry.seconds:8.2f} s  {entry.name:{width}}  {paths}".rstrip())


def total(counted: dict[str, float], planned: int) -> str:
    """The last line of the table. counted: from Totals.to_dict. planned: the number of bakes of the call."""
    done, failed, resumed = counted["done"] + counted["gate"], counted["failed"], counted["resumed"]
    left = planned - failed - done - resumed
    parts = [
        f"{done} done",
        *([f"{resumed} done before"] if resumed else []),
        f"{failed} failed",
        *([f"{left} stopped or not begun"] if left else []),
        *([f"{counted['gate']} over a limit"] if counted["gate"] else []),
    ]
    return f"{', '.join(parts)}, {counted['seconds']:.2f} s"


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
        self._totals = Totals()

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
        self._totals.add(entry)
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
        self.write("finished", exit_code=code, **self._totals.to_dict())

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
