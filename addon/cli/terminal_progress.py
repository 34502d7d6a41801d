# SPDX-License-Identifier: GPL-3.0-or-later
"""The progress of a bake on one line of a terminal, which is erased at the end."""

import shutil
import sys
from typing import TextIO

from ..core.progress import Progress


class Meter:
    """Writes to `stream` if it is a terminal, else nothing."""

    def __init__(self, stream: TextIO):
        self.is_on = stream.isatty()
        self.place = ""
        """The start of the line: the number of the bake among many."""
        self._stream, self._width = stream, 0

    def __enter__(self) -> "Meter":
        return self

    def __exit__(self, *_) -> None:
        self.clear()

    def show(self, name: str, step: Progress) -> None:
        """Show a step of the object or file `name`."""
        what = step.what if name in step.what else f"{name}: {step.what}"
        self._write(f"{self.place}{what}, {min(step.done, 1.0):.0%}")

    def report(self, line: str) -> None:
        """Print a line to standard error, in place of the progress."""
        self.clear()
        print(line, file=sys.stderr)

    def clear(self) -> None:
        """Erase the line, so that others can be written."""
        if self._width:
            self._write("")
            self._stream.write("\r")
            self._stream.flush()

    def _write(self, line: str) -> None:
        if not self.is_on:
            return
        line = line[: shutil.get_terminal_size().columns - 1]  # a longer line would wrap
        self._stream.write("\r" + line.ljust(self._width))
        self._stream.flush()
        self._width = len(line)
