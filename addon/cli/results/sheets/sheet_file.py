# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the page of results of a run. Its rows, which have pictures, wait in a file while the bakes go on."""

import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from ....core.errors import BakeError
from ....output.files.atomic_file import check_writable, make_folder, reason, replacing
from .. import run_report
from ..run_report import Entry
from . import result_sheet


class SheetFile:
    """The page at `path`."""

    def __init__(self, path: Path, head: dict[str, Any]):
        """Raises BakeError if the file cannot be written. head: from run_report.head."""
        check_writable(path)
        self.path, self._head = path, head
        self._rows: IO[bytes] | None = None
        self._places: list[tuple[int, int, int]] = []
        """The number of each bake, where its row begins, and its bytes."""
        self._size = 0
        self._error: OSError | None = None
        self._counted = run_report.summary(())

    def close(self) -> None:
        """Forget the rows."""
        if self._rows is not None:
            with suppress(OSError):  # it writes what is left once more, which has failed before
                self._rows.close()

    def add(self, entry: Entry, picture: bytes) -> None:
        """Add a row. picture: a PNG file, or nothing. A failure is reported by `finish`: the bakes go on."""
        run_report.count(self._counted, entry)
        if self._error is not None:
            return
        try:
            if self._rows is None:
                make_folder(self.path.parent)
                self._rows = tempfile.TemporaryFile(dir=self.path.parent)  # noqa: SIM115 (see close)
            size = self._rows.write(result_sheet.row(entry.to_dict(), picture).encode(errors="replace"))
            self._places.append((entry.number, self._size, size))
            self._size += size
        except OSError as error:
            self._error = error

    def finish(self) -> None:
        """Write the page. Raises BakeError."""
        if self._error is not None:
            raise BakeError(f"{str(self.path)!r} could not be written: {reason(self._error)}.") from self._error
        write(self.path, {**self._head, "summary": self._counted}, self._in_order())
        self.close()

    def _in_order(self) -> Iterator[str]:
        for _, start, size in sorted(self._places):
            self._rows.seek(start)
            yield self._rows.read(size).decode()


def write(path: Path, report: dict[str, Any], rows: Iterator[str]) -> None:
    """Write a page. report, rows: as in result_sheet.page. A byte of a file's name that is no text becomes a question mark.

    Raises BakeError.
    """
    with replacing(path) as partial, partial.open("w", encoding="utf-8", errors="replace") as file:
        file.writelines(result_sheet.page(report, path.stem, rows))
