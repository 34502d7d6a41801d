# SPDX-License-Identifier: GPL-3.0-or-later
"""The standard streams of the command line: only our text on standard output, and no failure where nothing reads it."""

import io
import os
import re
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout

from ..core.naming import printable
from ..core.quiet import flush, silence

__all__ = ["flush", "ignore_errors", "redirect_blender", "reserve", "silence", "without_egl"]


def without_egl(text: str) -> str:
    """What a process printed, without EGL's messages, which are harmless, and blanks around it."""
    return "\n".join(line for line in text.splitlines() if not line.startswith("EGL Error")).strip()


class _ErrorTolerantStream(io.FileIO):
    """A stream of the system that ignores errors: a full disk or a closed pipe must not stop a bake."""

    error: OSError | None = None
    """The first error."""

    def write(self, data) -> int:
        try:
            while (written := super().write(data)) is None:  # the stream is non-blocking
                select.select((), (self,), ())
            return written
        except OSError as error:
            self.error = self.error or error
            return len(data)


class _Text(io.TextIOWrapper):
    """Text for a terminal, without characters that control it: names come from files. Lines may end and have tabs, and a text
    may begin with a return, as the line that shows progress does."""

    def write(self, text: str) -> int:
        start = "\r" if text.startswith("\r") else ""
        parts = re.split("([\n\t])", text.removeprefix(start))
        parts[::2] = map(printable, parts[::2])
        super().write(start + "".join(parts))
        return len(text)


def reserve() -> None:
    """Open closed standard streams: else the next file would take the number, and Blender would print into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # takes the lowest free number
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, io.TextIOWrapper(io.FileIO(number, "w", closefd=False)))


def ignore_errors() -> None:
    """Both standard streams ignore errors from now on."""
    flush()
    sys.stdout, sys.stderr = (_text(_ErrorTolerantStream(number, "wb", closefd=False)) for number in (1, 2))


MOST_LINES = 20
"""Lines of Blender that are printed."""


@contextmanager
def redirect_blender(output: int | None = None) -> Iterator[Callable[[], list[str]]]:
    """Both standard streams ignore errors, and Blender's own messages go to standard error, or to a file.

    output: the descriptor of the file. Yields a function that returns the lines in it, which are to be printed as lines of
    Imprint. Streams that are not the system's own, as in a test that captures them, stay as they are.
    """
    if not (_is(sys.stdout, 1) and _is(sys.stderr, 2)):
        yield list
        return
    out, err = (_ErrorTolerantStream(os.dup(number), "wb") for number in (1, 2))
    flush()
    kept = os.dup(1), os.dup(2)
    os.dup2(2 if output is None else output, 1)
    if output is not None:
        os.dup2(output, 2)
    try:
        with _text(out) as stdout, _text(err) as stderr, redirect_stdout(stdout), redirect_stderr(stderr):
            yield lambda: [] if output is None else _lines(output)
            stdout.flush()
            if out.error is not None and not isinstance(out.error, BrokenPipeError):  # as in "| head -1"
                print(f"imprint: standard output could not be written: {out.error.strerror}.", file=stderr)
    finally:
        flush()
        for number, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, number)
            os.close(copy)


def _lines(output: int) -> list[str]:
    """The different lines in a file, at most MOST_LINES of them, and how many more there are."""
    flush()
    text = os.pread(output, 1 << 20, 0).decode(errors="replace")
    printed = list(dict.fromkeys(line.strip() for line in text.splitlines() if line.strip()))
    more = len(printed) - MOST_LINES
    return printed if more <= 0 else [*printed[:MOST_LINES], f"and {more:,} more lines"]


def _is(stream, number: int) -> bool:
    try:
        return stream.fileno() == number
    except (AttributeError, OSError):  # None, or text in memory
        return False


def _text(file: _ErrorTolerantStream) -> io.TextIOWrapper:
    """Text that never fails to be encoded, line by line."""
    return _Text(io.BufferedWriter(file), errors="backslashreplace", line_buffering=True)
