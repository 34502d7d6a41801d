# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a bake is, on one line of a terminal that is written over and erased in the end."""

import shutil
from typing import TextIO

from ..core.progress import Progress


class Meter:
    """Writes to `stream` if that is a terminal, and nothing at all if it is not."""

    def __init__(self, stream: TextIO):
        self.is_on = stream.isatty()
        self.place = ""
        """What the line starts with: which of many bakes this is."""
        self._stream, self._width = stream, 0

    def __enter__(self) -> "Meter":
        return self

    def __exit__(self, *_) -> None:
        self.clear()

    def tell(self, name: str, step: Progress) -> None:
        """Write what is going on with the object, or file, of that name."""
        what = step.what if name in step.what else f"{name}: {step.what}"
        self._write(f"{self.place}{what}, {min(step.done, 1.0):.0%}")

    def clear(self) -> None:
        """Erase the line, so that others can be written."""
        if self._width:
            self._write("")
            self._stream.write("\r")
            self._stream.flush()

    def _write(self, line: str) -> None:
        if not self.is_on:
            return
        line = line[: shutil.get_terminal_size().columns - 1]  # a longer one would go on below
        self._stream.write("\r" + line.ljust(self._width))
        self._stream.flush()
        self._width = len(line)
