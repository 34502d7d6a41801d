# SPDX-License-Identifier: GPL-3.0-or-later
"""Results in lines for a terminal."""

import argparse
import io
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

from ...core.naming import printable
from ..usage.options import STDOUT
from .bake_result import Result
from .run_report import Entry, State


def summary(result: Result) -> Iterator[str]:
    """The summary of a single bake, in lines. A sequence has one line, since its frames hardly differ."""
    if result.chain is not None:
        yield from (*result.chain.table(), result.chain.summary()[-1])
    elif result.are == "frames":
        seconds = sum(report.seconds["total"] for report in result.reports)
        yield f"{len(result.reports)} frames of {result.reports[0].low!r}, {seconds:.2f} s"
    else:
        yield from (line for report in result.reports for line in report.summary())


def wrote(result: Result, report: Path | None) -> str:
    """The files that a single bake wrote, as absolute paths: of frames the first and the last one. report: its file."""
    maps = result.maps
    if result.are == "frames" and len(maps) > 2:
        maps = [f"{len(maps)} maps from {maps[0]} to {maps[-1]}"]
    return f"Wrote {', '.join([*maps, *result.exports, *(str(path) for path in (result.scene, report) if path)])}"


class _Nowhere(io.TextIOBase):
    """Takes text and keeps none."""

    def write(self, text: str) -> int:
        return len(text)


def out(options: argparse.Namespace) -> TextIO:
    """Where the summary goes: standard output, or standard error if the report goes there, or nowhere."""
    return _Nowhere() if options.quiet else sys.stderr if options.report == STDOUT else sys.stdout


def saved(paths: Sequence[str]) -> Iterator[str]:
    """A line for each map, in Blender's words after a rendering, by which farms find a picture to show."""
    yield from (printable(f"Saved: '{path}'") for path in paths)


def line(entry: Entry, width: int) -> str:
    """A line of the table of many bakes. width: of the longest name."""
    return printable(
        f"{entry.state:7} {entry.seconds:8.2f} s  {entry.name:{width}}  {', '.join(entry.written)}".rstrip()
    )


def total(counted: dict[str, float], planned: int) -> str:
    """The last line of the table. counted: as run_report.summary returns it. planned: how many were to be done."""
    done, failed = int(counted[State.DONE] + counted[State.GATE]), int(counted[State.FAILED])
    resumed = int(counted[State.RESUMED])
    left = planned - failed - done - resumed
    parts = [
        f"{done} done",
        *([f"{resumed} done before"] if resumed else []),
        f"{failed} failed",
        *([f"{left} stopped or not begun"] if left else []),
        *([f"{int(counted[State.GATE])} over a limit"] if counted[State.GATE] else []),
    ]
    return f"{', '.join(parts)}, {counted['seconds']:.2f} s"
