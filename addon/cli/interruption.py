# SPDX-License-Identifier: GPL-3.0-or-later
"""Signals that stop a bake. They set a flag, which is read between two steps. No handler raises an exception.

An exception of a signal handler would be lost in one of Blender's callbacks, or break its start. This module does not need
Blender, so that a script can listen before it loads bpy.
"""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from ..core.naming import printable
from ..core.progress import BEGUN
from ..output import atomic_file

NAMES = ("SIGHUP", "SIGINT", "SIGTERM")
ASK, END = "SIGUSR1", "SIGUSR2"
"""How scripts/imprint.py forwards a first and a second signal: the process group may have received the same one as well."""
LAUNCHER, BAKING, OUTPUT = "IMPRINT_LAUNCHER", "IMPRINT_BAKING", "IMPRINT_OUTPUT"
"""Environment variables with the process number of scripts/imprint.py, and the files for the current bake's name and for what
Blender prints."""
OF_LAUNCHER = (LAUNCHER, BAKING, OUTPUT, BEGUN)
"""The variables by which a process knows the script that started it, which those that it starts must not."""


class Stopped(Exception):
    """A signal stopped the bake, which has left nothing."""


@dataclass
class _Asked:
    """The signals since `listening`."""

    code: int = 0
    direct: int = 0
    """The number of signals that this process received itself."""
    launcher: int = 0
    """The process number of the launcher that waits for this process, or 0."""

    def reset(self, launcher: int = 0) -> None:
        self.code, self.direct, self.launcher = 0, 0, launcher


_asked = _Asked()
_at_end: list[Callable[[], None]] = []
"""What `before_end` adds."""


def code() -> int:
    """The exit code after a signal, 128 plus its number as in shells, or 0 without a signal."""
    if _asked.launcher and os.getppid() != _asked.launcher:
        _asked.code = _asked.code or 128 + signal.SIGHUP  # the launcher was killed
    return _asked.code


def check() -> None:
    """Raise Stopped after a signal. Call this where no work is incomplete."""
    if code():
        raise Stopped


def listen() -> dict[signal.Signals, Any]:
    """Handle signals from now on; a second one ends the process at once. Returns the handlers before.

    An ignored SIGHUP stays ignored, as nohup expects.
    """
    numbers = [getattr(signal, name) for name in (*NAMES, ASK, END) if hasattr(signal, name)]
    numbers = [each for each in numbers if (each.name, signal.getsignal(each)) != ("SIGHUP", signal.SIG_IGN)]
    before = {number: signal.signal(number, _handle) for number in numbers}
    if _handle not in before.values():
        _asked.reset(_launcher())
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)  # scripts/imprint.py blocks them until now
    return before


def leave() -> int:
    """Ignore signals from now on: the process is about to end, and a signal while Blender unloads would kill it.

    Returns the exit code, as `code`.
    """
    for name in (*NAMES, ASK, END):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    return code()


def is_launched() -> bool:
    """Whether scripts/imprint.py started this process and waits for it. It explains crashes."""
    return bool(_asked.launcher)


def note_bake(name: str) -> None:
    """Pass the name of the current bake to scripts/imprint.py, which names it if Blender crashes."""
    descriptor = _of_launcher(BAKING)
    if descriptor is not None:
        with suppress(OSError):  # a full disk; the name only matters in a crash
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, os.fsencode(printable(name)), 0)


def blender_output() -> int | None:
    """The descriptor of the file for what Blender prints, of which scripts/imprint.py shows the end after a crash. None without
    it."""
    return _of_launcher(OUTPUT)


def _of_launcher(variable: str) -> int | None:
    descriptor = os.environ.get(variable, "")
    return int(descriptor) if is_launched() and descriptor.isdecimal() else None


@contextmanager
def before_end(act: Callable[[], None]) -> Iterator[None]:
    """While the block runs, call `act` before a second signal ends the process."""
    _at_end.append(act)
    try:
        yield
    finally:
        _at_end.remove(act)


@contextmanager
def listening() -> Iterator[None]:
    """Handle signals while the block runs. Afterwards reset, unless the process listened before."""
    before = listen()
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # a handler of C, which Python cannot restore
                signal.signal(number, handler)
        if _handle not in before.values():
            _asked.reset()


def _launcher() -> int:
    """The process number of the launcher if it is the parent process; another process's end cannot be seen."""
    number = os.environ.get(LAUNCHER, "")
    return int(number) if number.isdecimal() and int(number) == os.getppid() else 0


def _handle(number: int, _) -> None:
    name = signal.Signals(number).name
    if name in NAMES:
        _asked.direct += 1
    meant = signal.SIGINT if name in (ASK, END) else number
    _asked.code = _asked.code or 128 + meant
    if name == END or _asked.direct > 1:
        try:
            for act in _at_end:
                act()
            atomic_file.leave()
        finally:  # also if the signal interrupted this very removal
            os._exit(_asked.code)
