# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the report of a call. Of many bakes, each result is on the disk before the next bake ends."""

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from ...core.errors import BakeError
from ...output.files.atomic_file import check_writable, make_folder, reason, replacing
from ..usage.options import STDOUT
from . import run_report
from .only import Only
from .run_report import Entry, State

LINES = ".lines"
"""Added to the path of a report for the file that holds it while the bakes go on: its head, then an entry a line."""


def path_of(report: str | None) -> Path | None:
    """The absolute path of a report, or None where it goes to standard output, or nowhere."""
    return Path(report).absolute() if report not in (None, STDOUT) else None


def write(path: Path, report: dict[str, Any]) -> None:
    """Write a report to a file. Raises BakeError."""
    with replacing(path) as partial:
        partial.write_text(as_text(report) + "\n", encoding="utf-8")


def as_text(value: Any) -> str:
    """Plain data as JSON."""
    return json.dumps(value, indent=2)


def write_failure(path: Path, report: dict[str, Any]) -> None:
    """Write the report of a single bake that failed, if it can be written.

    A file that holds no JSON is left alone: it may be an input that was not known to be one when the bake failed.
    """
    with suppress(BakeError, OSError, ValueError):
        if path.exists():
            json.loads(path.read_bytes())
        write(path, report)


class ReportFile:
    """The report of many bakes. While they go on, their entries are in another file, which a crash leaves."""

    def __init__(self, path: Path, planned: int, shard: str = "", only: Only | None = None):
        """Raises BakeError if the file cannot be written. planned, shard, only: as in run_report.document."""
        check_writable(path)
        self._path, self._head = path, run_report.head(planned, shard, only)
        self.lines = path.with_name(path.name + LINES)
        self._file: IO[bytes] | None = None
        self._places: list[tuple[int, int]] = []
        """The number of each bake, and where its line begins."""
        self._size = 0
        self._error: OSError | None = None
        self._counted = run_report.summary(())

    def close(self) -> None:
        """Close the file with the lines, which stays unless `finish` came before."""
        if self._file is not None:
            with suppress(OSError):  # it writes what is left once more, which has failed before
                self._file.close()

    def add(self, entry: Entry) -> None:
        """Append an entry, and wait until it is on the disk. A failure is reported by `finish`: the bakes go on."""
        run_report.count(self._counted, entry)
        if self._error is not None:
            return
        try:
            if self._file is None:
                make_folder(self.lines.parent)
                self._file = self.lines.open("wb")
                self._write(self._head)
            self._places.append((entry.number, self._size))
            self._write(entry.to_dict())
            self._file.flush()
            if entry.state != State.RESUMED:  # its record has it
                os.fsync(self._file.fileno())
        except OSError as error:
            self._error = error

    def finish(self) -> None:
        """Write the report from all entries, in the order of their numbers, and remove the other file. Raises BakeError."""
        if self._error is not None:
            raise BakeError(f"{str(self.lines)!r} could not be written: {reason(self._error)}.") from self._error
        self.close()
        with replacing(self._path) as partial, partial.open("w", encoding="utf-8") as file:
            file.writelines(run_report.text(self._entries(), self._counted, self._head))
        self.lines.unlink(missing_ok=True)

    def _write(self, values: dict[str, Any]) -> None:
        self._size += self._file.write(json.dumps(values).encode() + b"\n")

    def _entries(self) -> Iterator[str]:
        if self._file is None:
            return
        with self.lines.open("rb") as file:
            for _, start in sorted(self._places):
                file.seek(start)
                yield file.readline().decode().removesuffix("\n")
