# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens in a call, while it goes on: on a terminal, the progress of a bake on one line, which is erased at the end."""

import shutil
import sys
from typing import TextIO

from ..core.naming import printable
from ..core.progress import Progress
from .plan.plans import Plan
from .results.run_report import Entry


class Meter:
    """Writes the progress to `stream` if it is a terminal, else nothing. results.events has another one for programs."""

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
