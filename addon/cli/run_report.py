# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a run: an entry for each bake, the exit code that follows from them, and the files that hold it."""

import json
import os
import platform
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import IO, Any, TypedDict

from ..core import versions
from ..core.errors import BakeError, NoGpu, NoGpuMemory, WrongPlace, reason, sentence
from ..output.atomic_file import check_writable, make_folder, replacing

VERSION = 2
"""The version of the report's keys. It increases when a key is removed or changes its meaning, not for new keys."""
ADDED = frozenset({"chain", "picture"})
"""Keys of an entry that reports of this version may lack: they were added to it."""
NOT_REPORTED = frozenset({"warnings", "summary", "image", "is_listed"})
"""Fields of an entry that are no keys: they are for the terminal, and for pages of results."""
MAP, MIP, EXPORT, SCENE = "map", "mip level", "export", "scene"
"""What a file is that a bake wrote."""


class State(StrEnum):
    """The state of a bake."""

    DONE = "done"
    FAILED = "failed"
    STOPPED = "stopped"
    """A signal stopped it. Pairs and frames that were done by then are kept."""
    GATE = "gate"
    """Done, but a metric is over its limit."""
    RESUMED = "resumed"
    """Done by an earlier call, or by another one at the same time, and still true."""


class Cause(StrEnum):
    """Why a bake failed, for programs."""

    NONE = ""
    INPUT = "input"
    """Its input or its settings, as the error says."""
    GPU = "gpu"
    """Blender's gpu module does not start on this machine."""
    MEMORY = "memory"
    """There was not enough memory, or the limit was reached."""
    TIMEOUT = "timeout"
    CRASH = "crash"

    @classmethod
    def of(cls, error: BakeError | MemoryError) -> "Cause":
        """The cause that an exception stands for."""
        if isinstance(error, MemoryError | NoGpuMemory):
            return cls.MEMORY
        return cls.GPU if isinstance(error, NoGpu) else cls.INPUT


class FileNote(TypedDict):
    """A file that a bake read or wrote."""

    path: str
    bytes: int | None
    sha256: str | None
    what: str


@dataclass
class Entry:
    """A bake in the report."""

    number: int
    """Its place among all bakes of the job file or folder, from 1."""
    name: str
    """The low object or file, with the number of the set."""
    state: State = State.DONE
    """How it ended: stopped by a signal, gate with a metric over its limit, resumed if another call did it."""
    error: str = ""
    """Why it is not done, in a sentence."""
    cause: Cause = Cause.NONE
    """Of a bake that failed."""
    signal: str = ""
    """The name of the signal that ended its process, as SIGSEGV."""
    gate: list[str] = field(default_factory=list)
    """The metrics over their limits, in sentences."""
    seconds: float = 0.0
    """What it took, with opening its files."""
    inputs: list[FileNote] = field(default_factory=list)
    """The files that it read: path, bytes, sha256, and what they are."""
    files: list[FileNote] = field(default_factory=list)
    """The files that it wrote: path, bytes, sha256, and what they are."""
    are: str = ""
    """What several reports are of: "pairs", "frames" or "levels"."""
    reports: list[dict[str, Any]] = field(default_factory=list)
    """As Report.to_dict returns them."""
    chain: dict[str, Any] = field(default_factory=dict)
    """The levels of detail that lod has measured, as ChainReport.to_dict returns them; empty for other bakes."""
    problems: list[str] = field(default_factory=list)
    """What is wrong with names, in sentences."""
    log: str = ""
    """The file with all that its process printed; empty if none was kept."""
    picture: str = ""
    """The file with its picture: the map, the low mesh with it, and its deviations; empty if none was kept."""
    warnings: list[str] = field(default_factory=list)
    """Warnings to print now that the bake has ended. Those that were printed before it are not among them."""
    summary: list[str] = field(default_factory=list)
    """What was baked, in lines for the terminal."""
    image: bytes = b""
    """The picture as a PNG file; empty if it has none."""
    is_listed: bool = True
    """Whether the report has it: not if a signal stopped it before anything was done."""

    @classmethod
    def failed(cls, number: int, name: str, error: BakeError | MemoryError) -> "Entry":
        """The entry of a bake that raised an exception."""
        return cls(number, name, State.FAILED, sentence(error), Cause.of(error))

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Entry":
        """The entry of a report. Keys that it does not know are left out. Raises KeyError, TypeError or ValueError."""
        needed = {each.name for each in fields(cls)} - NOT_REPORTED
        known = {name: values[name] for name in needed if name not in ADDED or name in values}
        return cls(**{**known, "state": State(known["state"]), "cause": Cause(known["cause"])})

    def to_dict(self) -> dict[str, Any]:
        """Plain data for json.dump."""
        return {name: value for name, value in vars(self).items() if name not in NOT_REPORTED}

    def paths(self, *kinds: str) -> list[str]:
        """The files that it wrote, as absolute paths. kinds: of MAP, MIP, EXPORT and SCENE."""
        return [each["path"] for each in self.files if each["what"] in kinds]


def written_paths(report: dict[str, Any]) -> dict[str, list[str]]:
    """The files that a report of an entry names as written, by what they are.

    Raises LookupError, TypeError or AttributeError for what is no report.
    """
    mips = [path for each in report["mip_files"].values() for path in each]
    return {MAP: report["output"], MIP: mips, EXPORT: report["export"].get("files", [])}


DONE = 0
FAILED = 1
"""A bake failed. The report has the reason."""
WRONG_USAGE = 2
"""The call or its input is wrong, so that nothing was baked. Another try does not help."""
NO_MACHINE = 3
"""This machine has no GPU for Blender, or too little memory. Another machine may do it."""
GATE = 4
"""All bakes are done, but a metric is over its limit."""


class Totals:
    """Counts the bakes of a run."""

    def __init__(self, entries: Iterable[Entry] = ()):
        self._seconds, self._states, self._causes = 0.0, Counter(), set()
        for entry in entries:
            self.add(entry)

    def add(self, entry: Entry) -> None:
        """Count a bake."""
        self._states[entry.state] += 1
        self._seconds += entry.seconds
        if entry.state == State.FAILED:
            self._causes.add(entry.cause)

    def to_dict(self) -> dict[str, float]:
        """How many bakes have each state, and the seconds of all."""
        return {**{str(state): self._states[state] for state in State}, "seconds": self._seconds}

    @property
    def exit_code(self) -> int:
        """The exit code of the run, if no signal stopped it."""
        if self._causes:
            return NO_MACHINE if self._causes <= {Cause.GPU, Cause.MEMORY} else FAILED
        return GATE if self._states[State.GATE] else DONE


@dataclass(frozen=True)
class ThisCall:
    """A call. Worker processes have that of their parent."""

    started: str
    """The time in UTC, as 2026-01-31T23:59:59Z."""
    host: str
    """The name of the machine in its network."""
    call: tuple[str, ...]
    """The arguments."""

    @classmethod
    def of(cls, words: Sequence[str] = ()) -> "ThisCall":
        """The call that begins now. words: the arguments."""
        now = datetime.now(UTC).replace(microsecond=0, tzinfo=None)
        return cls(f"{now.isoformat()}Z", platform.node(), tuple(words))


@dataclass(frozen=True)
class Only:
    """The patterns of --only, and the numbers of the bakes whose names match, in all parts of the job."""

    patterns: tuple[str, ...]
    numbers: frozenset[int]

    @classmethod
    def of(cls, patterns: Sequence[str], numbers: Iterable[int]) -> "Only | None":
        """None without patterns, where all bakes are meant."""
        return cls(tuple(patterns), frozenset(numbers)) if patterns else None

    @classmethod
    def from_dict(cls, values: dict[str, Any] | None, planned: int) -> "Only | None":
        """From a report of so many planned bakes. Raises KeyError, TypeError or ValueError."""
        return values and cls.of(list(map(str, values["patterns"])), _numbers(str(values["bakes"]), planned))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for json.dump."""
        return {"patterns": list(self.patterns), "bakes": ranges(sorted(self.numbers))}

    @staticmethod
    def union(parts: Sequence["Only | None"]) -> "Only | None":
        """What several calls chose together; None if one of them meant all."""
        if None in parts:
            return None
        patterns = dict.fromkeys(pattern for part in parts for pattern in part.patterns)
        return Only.of(tuple(patterns), (number for part in parts for number in part.numbers))


def ranges(numbers: Iterable[int]) -> str:
    """Increasing numbers in words: "1, 3-7"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][1] == number - 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)


def _numbers(text: str, most: int) -> Iterable[int]:
    """The numbers up to `most` that `ranges` has put into words. Raises ValueError."""
    for part in text.split(", "):
        first, _, last = part.partition("-")
        if int(last or first) > most:
            raise ValueError(text)
        yield from range(int(first), int(last or first) + 1)


def head(
    planned: int = 1, shard: str = "", only: Only | None = None, *, call: ThisCall | None = None
) -> dict[str, Any]:
    """What comes before the bakes in a report.

    Args:
        planned: How many bakes the job has.
        shard: The part, as K/N; empty for all.
        only: None for all.
        call: None for one that begins now.
    """
    return {
        "imprint_report": VERSION,
        "imprint": versions.imprint(),
        "blender": versions.blender(),
        "code": versions.code(),
        **asdict(call or ThisCall.of()),
        "planned": planned,
        "shard": shard or None,
        "only": only and only.to_dict(),
    }


def document(entries: Sequence[Entry], head: dict[str, Any]) -> dict[str, Any]:
    """The report. head: as `head` returns it."""
    return {**head, "bakes": [entry.to_dict() for entry in entries], "summary": Totals(entries).to_dict()}


STDOUT = "-"
"""A report's path that stands for standard output."""
LINES = ".lines"
"""Added to the path of a report for the file that holds it while the bakes go on: its head, then an entry a line."""
READ = 1024
"""Bytes of the beginning of a file, which may have blanks."""
_BLANK = b" \t\r\n\0"
"""Bytes that are nothing. File systems leave zeros of a file that was written when the power failed."""
LONGEST = 80
"""Characters of a bake's name in the name of its file."""


def plain_name(name: str) -> str:
    """The name of a bake for the name of a file."""
    return re.sub(r"[^\w.-]+", "_", name).strip("_")[:LONGEST]


def report_path(report: str | None) -> Path | None:
    """The absolute path of a report, or None where it goes to standard output, or nowhere."""
    return Path(report).absolute() if report not in (None, STDOUT) else None


def check_report(path: str, title: str) -> None:
    """Raise WrongPlace if `path` is a file that is not JSON. title: of the report, for the message."""
    _check_kind(path, title, (b"{", b"["), "JSON")


def check_page(path: str, title: str) -> None:
    """Raise WrongPlace if `path` is a file that is not HTML. title: of the page, for the message."""
    _check_kind(path, title, (b"<!doctype html", b"<html"), "HTML")


def _check_kind(path: str, title: str, starts: tuple[bytes, ...], kind: str) -> None:
    if not os.path.isfile(path):  # a pipe would wait for a writer
        return
    try:
        with open(path, "rb") as file:
            start = file.read(READ)
    except OSError:  # the bake reports it
        return
    start = start.removeprefix(b"\xef\xbb\xbf").lstrip(_BLANK).lower()
    if start and not start.startswith(starts):
        raise WrongPlace(
            f"{title[:1].upper()}{title[1:]} would overwrite {path!r}, which is not {kind}: choose another path for it."
        )


def as_text(value: Any) -> str:
    """Plain data as JSON."""
    return json.dumps(value, indent=2)


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write a report to a file. Raises BakeError."""
    with replacing(path) as partial:
        partial.write_text(as_text(report) + "\n", encoding="utf-8")


def write_failure(path: Path, report: dict[str, Any]) -> None:
    """Write the report of a single bake that failed, if it can be written.

    A file that holds no JSON is left alone: it may be an input that was not known to be one when the bake failed.
    """
    with suppress(BakeError, OSError, ValueError):
        if path.exists():
            json.loads(path.read_bytes())
        write_report(path, report)


class RowFile:
    """A file of rows, which are written as bakes end, and read in the order of their numbers.

    A row that cannot be written does not stop the bakes: `in_order` raises its error.
    """

    def __init__(self, name: str, start: Callable[[], IO[bytes]]):
        """name: for the message. start: opens the file, at the first row."""
        self._name, self._start = name, start
        self._file: IO[bytes] | None = None
        self._places: list[tuple[int, int, int]] = []
        """The number of each bake, where its row begins, and its bytes."""
        self._error: OSError | None = None

    def add(self, number: int, row: bytes, *, is_lasting: bool = False) -> None:
        """Append a row. is_lasting: whether to wait until it is on the disk."""
        if self._error is not None:
            return
        try:
            self._file = self._file or self._start()
            place = self._file.tell()
            self._places.append((number, place, self._file.write(row)))
            self._file.flush()
            if is_lasting:
                os.fsync(self._file.fileno())
        except OSError as error:
            self._error = error

    def in_order(self) -> Iterator[bytes]:
        """All rows. Raises BakeError."""
        if self._error is not None:
            raise BakeError(f"{self._name!r} could not be written: {reason(self._error)}.") from self._error
        for _, place, size in sorted(self._places):
            self._file.seek(place)
            yield self._file.read(size)

    def begin(self) -> None:
        """Open the file now, with nothing in it but what it begins with."""
        with suppress(OSError):  # the first row tells it
            self._file = self._start()
            self._file.flush()

    def close(self) -> None:
        """Close the file. Can be called more than once."""
        if self._file is not None:
            with suppress(OSError):  # it writes what is left once more, which has failed before
                self._file.close()


class ReportFile:
    """The report of many bakes. While they go on, their entries are in another file, which a crash leaves."""

    def __init__(self, path: Path, head: dict[str, Any]):
        """Raises BakeError if the file cannot be written. head: what comes before the bakes, as `head` returns it."""
        check_writable(path)
        self.path, self._head, self._totals = path, head, Totals()
        self.lines = path.with_name(path.name + LINES)
        self._rows = RowFile(str(self.lines), self._start)
        self._rows.begin()  # so that what an earlier call has left there is not taken for this one's

    def _start(self) -> IO[bytes]:
        make_folder(self.lines.parent)
        file = self.lines.open("w+b")
        file.write(_line(self._head))
        return file

    def close(self) -> None:
        """Close the file with the lines, which stays unless `finish` came before."""
        self._rows.close()

    def add(self, entry: Entry) -> None:
        """Append an entry, and wait until it is on the disk. `finish` reports a failure: the bakes go on."""
        self._totals.add(entry)
        is_resumed = entry.state == State.RESUMED  # its record has it
        self._rows.add(entry.number, _line(entry.to_dict()), is_lasting=not is_resumed)

    def finish(self) -> None:
        """Write the report from all entries, in the order of their numbers, and remove the other file. Raises BakeError."""
        rows = self._rows.in_order()
        with replacing(self.path) as partial, partial.open("w", encoding="utf-8") as file:
            file.write(as_text(self._head).removesuffix("\n}") + ',\n  "bakes": [')
            before = "\n    "
            for row in rows:
                file.write(before + row.decode().removesuffix("\n"))
                before = ",\n    "
            file.write(f'\n  ],\n  "summary": {json.dumps(self._totals.to_dict())}\n}}\n')
        self.close()
        self.lines.unlink(missing_ok=True)


def _line(values: dict[str, Any]) -> bytes:
    return json.dumps(values).encode() + b"\n"
