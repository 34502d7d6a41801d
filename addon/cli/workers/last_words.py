# SPDX-License-Identifier: GPL-3.0-or-later
"""What a process that has crashed printed last, for the sentence that reports it."""

import os
import re
import stat

from ...core.naming import printable

TAIL = 1 << 14
"""Bytes at the end of what was printed that are searched."""
LONGEST = 160
"""Characters of a printed line in a sentence."""
_PLACE = re.compile(r'  File "(?P<path>.*)", line (?P<line>\d+) in (?P<name>.*)')
_CRASH = re.compile(
    r"Fatal Python error: |Windows fatal exception: |(Current thread|Thread) 0x|Stack \(most recent call first\):"
    r"|Current thread's C stack trace|Extension modules: |  ((Binary file|File) \"|<|\.\.\.)"
)
"""The starts of lines that Python prints at a crash: the error, threads and their calls, the last one first."""


def of_file(path: str) -> str:
    """As `clause`, for a log. Empty if there is none: one that is no plain file is not read."""
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return ""
    try:
        return clause(tail(descriptor)) if stat.S_ISREG(os.fstat(descriptor).st_mode) else ""
    finally:
        os.close(descriptor)


def tail(descriptor: int, start: int = 0) -> str:
    """The end of an open file, without its first `start` bytes. Its position stays."""
    if not hasattr(os, "pread"):  # Windows: the position is shared with the process that prints
        return ""
    size = os.fstat(descriptor).st_size
    begin = max(start, size - TAIL)
    return os.pread(descriptor, max(0, size - begin), begin).decode(errors="replace")


def clause(text: str) -> str:
    """Where Python was and what was printed before, as the rest of a sentence: ", in read, line 7 of mesh/uv.py, after it
    printed 'Opening'". Empty if the text has neither. text: what a process printed.
    """
    lines = text.splitlines()
    place = next(filter(None, map(_PLACE.fullmatch, lines)), None)
    printed = last_line("\n".join(line for line in lines if not _CRASH.match(line)))
    said = ""
    if place:
        file = "/".join(re.split(r"[/\\]", place["path"])[-2:])
        said = f", in {_short(place['name'])}, line {place['line'][:9]} of {_short(file)}"
    return f"{said}, after it printed {printed!r}" if printed else said


def last_line(text: str) -> str:
    """The last line that is not empty, shortened; "" if there is none."""
    return _short(next((line.strip() for line in reversed(text.splitlines()) if line.strip()), ""))


def _short(text: str) -> str:
    text = printable(text)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
