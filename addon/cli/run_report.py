# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a call as plain data, one shape for one bake, many, pairs or frames, and the exit code that follows from it."""

import json
import platform
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from ..core import versions


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
    def of(cls, words: Sequence[str]) -> "ThisCall":
        """The call that begins now. words: the arguments."""
        now = datetime.now(UTC).replace(microsecond=0, tzinfo=None)
        return cls(f"{now.isoformat()}Z", platform.node(), tuple(words))


_noted: list[ThisCall] = []
"""The call that is going on. A process does one at a time."""


def note(call: ThisCall) -> None:
    """Reports are of this call from now on."""
    _noted[:] = [call]


def noted() -> ThisCall:
    """The call that is going on."""
    return _noted[0] if _noted else ThisCall.of(())


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
    found: list[list[int]] = []
    for number in numbers:
        if found and found[-1][1] == number - 1:
            found[-1][1] = number
        else:
            found.append([number, number])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in found)


def _numbers(text: str, most: int) -> Iterable[int]:
    """The numbers up to `most` that `ranges` has put into words. Raises ValueError."""
    for part in text.split(", "):
        first, _, last = part.partition("-")
        if int(last or first) > most:
            raise ValueError(text)
        yield from range(int(first), int(last or first) + 1)


VERSION = 2
"""The version of the report's keys. It increases when a key is removed or changes its meaning, not for new keys."""


ADDED = frozenset({"chain", "picture"})
"""Keys of an entry that reports of this version may lack: they were added to it."""


class State(StrEnum):
    """What became of a bake."""

    DONE = "done"
    FAILED = "failed"
    STOPPED = "stopped"
    """A signal stopped it. Pairs and frames that were done by then are kept."""
    GATE = "gate"
    """Done, but a figure is over its limit."""
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


@dataclass
class Entry:
    """A bake in the report."""

    number: int
    """Its place among all bakes of the job file or folder, from 1."""
    name: str
    state: State = State.DONE
    error: str = ""
    """One sentence."""
    cause: Cause = Cause.NONE
    signal: str = ""
    """The name of the signal that ended its process, as SIGSEGV."""
    gate: list[str] = field(default_factory=list)
    """The figures over their limits, in sentences."""
    seconds: float = 0.0
    inputs: list[dict[str, Any]] = field(default_factory=list)
    """The files that it read: path, bytes, sha256, and what they are."""
    files: list[dict[str, Any]] = field(default_factory=list)
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

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Entry":
        """The entry of a report. Keys that it does not know are left out. Raises KeyError, TypeError or ValueError."""
        known = {each.name: values[each.name] for each in fields(cls) if each.name not in ADDED or each.name in values}
        return cls(**{**known, "state": State(known["state"]), "cause": Cause(known["cause"])})

    def to_dict(self) -> dict[str, Any]:
        """Plain data for json.dump."""
        return asdict(self)

    @property
    def written(self) -> list[str]:
        """The maps and the files for engines, as absolute paths."""
        return [each["path"] for each in self.files if each["what"] in {MAP, EXPORT}]

    @property
    def maps(self) -> list[str]:
        """The maps, as absolute paths."""
        return [each["path"] for each in self.files if each["what"] == MAP]


MAP, MIP, EXPORT, SCENE = "map", "mip level", "export", "scene"
"""What a file is that a bake wrote."""


def paths(report: dict[str, Any]) -> list[str]:
    """The files that a report of an entry names as written. Raises LookupError, TypeError or AttributeError for what is no
    report."""
    found = [*report["output"], *report["export"].get("files", ())]
    return found + [path for each in report["mip_files"].values() for path in each]


def document(entries: Sequence[Entry], first: dict[str, Any] | None = None) -> dict[str, Any]:
    """The report. first: what comes before the bakes, as `head` returns it; None for that of a single bake."""
    return {**(first or head(1)), "bakes": [entry.to_dict() for entry in entries], "summary": summary(entries)}


def text(entries: Iterable[str], counted: dict[str, float], first: dict[str, Any]) -> Iterator[str]:
    """`document` as the lines of a file, for many entries, which are JSON. counted, first: as `summary` and `head` return
    them."""
    yield json.dumps(first, indent=2).removesuffix("\n}") + ',\n  "bakes": ['
    before = ""
    for entry in entries:
        yield f"{before}\n    {entry}"
        before = ","
    yield f'\n  ],\n  "summary": {json.dumps(counted)}\n}}\n'


def summary(entries: Iterable[Entry]) -> dict[str, float]:
    """How many bakes have each state, and the seconds of all."""
    counted = {**dict.fromkeys(map(str, State), 0), "seconds": 0.0}
    for entry in entries:
        count(counted, entry)
    return counted


def count(counted: dict[str, float], entry: Entry) -> None:
    """Add an entry to a summary."""
    counted[str(entry.state)] += 1
    counted["seconds"] += entry.seconds


def head(planned: int, shard: str = "", only: Only | None = None) -> dict[str, Any]:
    """What comes before the bakes in a report. planned: how many bakes the job has. shard: the part, as K/N; empty for all.
    only: None for all."""
    return {
        "imprint_report": VERSION,
        "imprint": versions.imprint(),
        "blender": versions.blender(),
        "code": versions.code(),
        **asdict(noted()),
        "planned": planned,
        "shard": shard or None,
        "only": only and only.to_dict(),
    }


DONE = 0
FAILED = 1
"""A bake failed. The report has the reason."""
WRONG_USAGE = 2
"""The call or its input is wrong, so that nothing was baked. Another try does not help."""
NO_MACHINE = 3
"""This machine has no GPU for Blender, or too little memory. Another machine may do it."""
GATE = 4
"""All bakes are done, but a figure is over its limit."""


class Tally:
    """Counts results for the exit code of a call."""

    def __init__(self):
        self._causes: set[Cause] = set()
        self._is_over = False

    def add(self, entry: Entry) -> None:
        """Count a result."""
        if entry.state == State.FAILED:
            self._causes.add(entry.cause)
        self._is_over |= entry.state == State.GATE

    @property
    def code(self) -> int:
        """The exit code, if no signal stopped the call."""
        if self._causes:
            return NO_MACHINE if self._causes <= {Cause.GPU, Cause.MEMORY} else FAILED
        return GATE if self._is_over else DONE


def exit_code(entry: Entry) -> int:
    """The exit code of a call that made one bake."""
    tally = Tally()
    tally.add(entry)
    return tally.code
