# SPDX-License-Identifier: GPL-3.0-or-later
"""The results of bakes: in lines for a terminal, as JSON, and in the report's file."""

import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import indent

from ..core.errors import BakeError
from ..core.report import Report
from ..output.files.atomic_file import check_writable, replacing
from .usage.options import STDOUT


@dataclass
class Result:
    """The reports of a bake, or the error that ended it."""

    name: str
    reports: list[Report] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    """What is wrong with names, in sentences."""
    error: str = ""
    seconds: float = 0.0
    are: str = ""
    """What several reports are of: "pairs" or "frames"."""
    is_stopped: bool = False
    """Whether a signal stopped it. Pairs and frames that were done by then are kept."""
    said: list[str] = field(default_factory=list)
    """The warnings that were printed before the bake."""

    @property
    def maps(self) -> list[str]:
        """The maps that were written, each once, as absolute paths."""
        return list(dict.fromkeys(path for report in self.reports for path in report.output))

    @property
    def exports(self) -> list[str]:
        """The files for engines that were written, each once, as absolute paths."""
        return list(dict.fromkeys(path for report in self.reports for path in report.export.get("files", ())))

    @property
    def warnings(self) -> list[str]:
        """Sentences."""
        return [*self.problems, *(warning for report in self.reports for warning in report.warnings)]

    @property
    def unsaid(self) -> list[str]:
        """The warnings to print after the bake."""
        return [warning for warning in self.warnings if warning not in self.said]

    def to_json(self) -> dict | None:
        """Plain data for json.dump: of one bake its report, of pairs and frames all of theirs; None if there is none."""
        reports = [report.to_dict() for report in self.reports]
        if self.are:
            return {self.are: reports, "problems": self.problems}
        return reports[0] if reports else None


def warn_early(name: str, warnings: Sequence[str], said: list[str]) -> None:
    """Print warnings before a bake, which can take long. name: of the bake among many. said: those that were printed; receives
    these."""
    for warning in warnings:
        if warning not in said:
            print(f"imprint: {f'{name}: ' if name else ''}warning: {warning}", file=sys.stderr)
            said.append(warning)


def report_file(report: str | None) -> Path | None:
    """The absolute path of a report, or None where it goes to standard output, or nowhere."""
    return Path(report).absolute() if report not in (None, STDOUT) else None


def write_json(path: Path, value) -> None:
    """Write plain data to a file. Raises BakeError."""
    _write(path, as_text(value))


def _write(path: Path, text: str) -> None:
    with replacing(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8")


def as_text(value) -> str:
    """Plain data as JSON."""
    return json.dumps(value, indent=2)


def write_failure(path: Path, result: Result) -> None:
    """Write the report of a single bake that failed, if it can be written.

    A file that holds no JSON is left alone: it may be an input that was not known to be one when the bake failed.
    """
    with suppress(BakeError, OSError, ValueError):
        if path.exists():
            json.loads(path.read_bytes())
        write_json(path, to_json([result])[0])


class ReportFile:
    """The report of many bakes. It is written again while they go on, so that a crash loses only the last moments."""

    SHARE = 0.02
    """The most of the time that is spent on writing, which takes longer with each bake."""

    def __init__(self, path: Path):
        """Raises BakeError if the file cannot be written."""
        check_writable(path)
        self._path, self._next = path, 0.0
        self._entries: list[str] = []
        """The text of each result in the report. Results do not change, so each is put into words once."""
        self._known = 0
        """How many results were seen."""

    def update(self, results: Sequence[Result]) -> None:
        """Write the file if it is time to. A failure is ignored: `write` comes last."""
        start = time.perf_counter()
        if start >= self._next:
            with suppress(BakeError):
                self.write(results)
            stop = time.perf_counter()
            self._next = stop + (stop - start) / self.SHARE

    def write(self, results: Sequence[Result]) -> None:
        """Write the file. results: those of the call before, and more. Raises BakeError."""
        self._entries += [indent(as_text(entry), "  ") for entry in to_json(results[self._known :])]
        self._known = len(results)
        _write(self._path, "[\n" + ",\n".join(self._entries) + "\n]" if self._entries else "[]")


def summary(result: Result) -> Iterator[str]:
    """The summary of a single bake, in lines. A sequence has one line, since its frames hardly differ."""
    if result.are == "frames":
        seconds = sum(report.seconds["total"] for report in result.reports)
        yield f"{len(result.reports)} frames of {result.reports[0].low!r}, {seconds:.2f} s"
    else:
        yield from (line for report in result.reports for line in report.summary())


def wrote(result: Result, *others: Path | None) -> str:
    """The files that a single bake wrote, as absolute paths: of frames the first and the last one."""
    maps = result.maps
    if result.are == "frames" and len(maps) > 2:
        maps = [f"{len(maps)} maps from {maps[0]} to {maps[-1]}"]
    return f"Wrote {', '.join([*maps, *result.exports, *(str(path) for path in others if path)])}"


def table(results: Sequence[Result], planned: int) -> Iterator[str]:
    """A line for each bake, and one for all. Errors go to standard error. planned: how many were to be done."""
    width = max((len(result.name) for result in results), default=0)
    for result in results:
        state = "stopped" if result.is_stopped else "failed" if result.error else "done"
        yield f"{state:7} {result.seconds:8.2f} s  {result.name:{width}}  {', '.join([*result.maps, *result.exports])}".rstrip()
    failed = sum(1 for result in results if result.error)
    done = sum(1 for result in results if not result.error and not result.is_stopped)
    left = f", {planned - failed - done} stopped or not begun" if planned > failed + done else ""
    yield f"{done} done, {failed} failed{left}, {sum(result.seconds for result in results):.2f} s"


def to_json(results: Sequence[Result]) -> list[dict]:
    """Plain data for json.dump. A bake that was stopped is listed if some of its pairs or frames are done."""
    return [
        {
            "name": result.name,
            "ok": not result.error and not result.is_stopped,
            "error": "It was stopped." if result.is_stopped else result.error,
            "seconds": result.seconds,
            "maps": result.maps,
            "report": result.to_json(),
        }
        for result in results
        if result.reports or not result.is_stopped
    ]
