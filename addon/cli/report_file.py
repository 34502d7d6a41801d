# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a call writes about its bakes: its report, and folders of logs and pictures."""

import json
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from ..core.errors import BakeError, WrongPlace
from ..output.atomic_file import check_folder, check_writable, make_folder, reason, replacing
from . import run_report
from .options import STDOUT
from .run_report import Entry, State

READ = 1024
"""Bytes of the beginning of a file, which may have blanks."""
_BLANK = b" \t\r\n\0"
"""Bytes that are nothing. File systems leave zeros of a file that was written when the power failed."""


def check_report(path: str, title: str) -> None:
    """Raise WrongPlace if `path` is a file that is not JSON. title: of the report, for the message."""
    _check(path, title, (b"{", b"["), "JSON")


def check_page(path: str, title: str) -> None:
    """Raise WrongPlace if `path` is a file that is not HTML. title: of the page, for the message."""
    _check(path, title, (b"<!doctype html", b"<html"), "HTML")


def _check(path: str, title: str, starts: tuple[bytes, ...], kind: str) -> None:
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


LONGEST = 80
"""Characters of a bake's name in the name of its file."""


def prepare_folder(option: str, folder: str | None) -> None:
    """Make the folder that `option` names, if it does. Raises WrongPlace unless files can be written there."""
    if not folder:
        return
    try:
        make_folder(Path(folder).absolute())
        check_folder(Path(folder))
    except OSError as error:
        raise WrongPlace(f"{option}: no files can be written to {folder!r}: {reason(error)}.") from error


def plain_name(name: str) -> str:
    """The name of a bake for the name of a file."""
    return re.sub(r"[^\w.-]+", "_", name).strip("_")[:LONGEST]


LINES = ".lines"
"""Added to the path of a report for the file that holds it while the bakes go on: its head, then an entry a line."""


def report_path(report: str | None) -> Path | None:
    """The absolute path of a report, or None where it goes to standard output, or nowhere."""
    return Path(report).absolute() if report not in (None, STDOUT) else None


def write_report(path: Path, report: dict[str, Any]) -> None:
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
        write_report(path, report)


class ReportFile:
    """The report of many bakes. While they go on, their entries are in another file, which a crash leaves."""

    def __init__(self, path: Path, head: dict[str, Any]):
        """Raises BakeError if the file cannot be written. head: what comes before the bakes, as run_report.head returns it."""
        check_writable(path)
        self._path, self._head = path, head
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
