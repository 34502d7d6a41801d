# SPDX-License-Identifier: GPL-3.0-or-later
"""Signals that ask a bake to stop. They set a flag, which is read between two steps; none raises an exception anywhere.

An exception out of a signal handler would be lost in one of Blender's own callbacks, or break its start. No Blender is
needed here, so that a script can listen before it loads bpy.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from ..output import partial_files

NAMES = ("SIGHUP", "SIGINT", "SIGTERM")
ASK, END = "SIGUSR1", "SIGUSR2"
"""How scripts/imprint.py hands a first and a second signal on: its process group may have got the same one as well."""
LAUNCHER, BAKING = "IMPRINT_LAUNCHER", "IMPRINT_BAKING"
"""Environment variables in which scripts/imprint.py tells its process number, and where to write what is being baked."""


class Stopped(Exception):
    """The bake was asked to stop, and has left nothing."""


@dataclass
class _Asked:
    """What was heard since `listening`."""

    code: int = 0
    direct: int = 0
    """How many signals came to this process itself."""
    launcher: int = 0
    """The process that waits for us, where its end can be seen."""

    def reset(self, launcher: int = 0) -> None:
        self.code, self.direct, self.launcher = 0, 0, launcher


_asked = _Asked()


def code() -> int:
    """The exit code of a process that was asked to stop, 128 and the signal's number as shells have it, or 0."""
    if _asked.launcher and os.getppid() != _asked.launcher:
        _asked.code = _asked.code or 128 + signal.SIGHUP  # killed, and nobody waits for us
    return _asked.code


def check() -> None:
    """Raise Stopped if somebody has asked for it. To be called where nothing is half done."""
    if code():
        raise Stopped


def listen() -> dict[signal.Signals, Any]:
    """Hear signals from now on; a second one ends the process at once. Returns who heard them before.

    An ignored SIGHUP stays ignored, as nohup wants it.
    """
    numbers = [getattr(signal, name) for name in (*NAMES, ASK, END) if hasattr(signal, name)]
    numbers = [each for each in numbers if (each.name, signal.getsignal(each)) != ("SIGHUP", signal.SIG_IGN)]
    before = {number: signal.signal(number, _hear) for number in numbers}
    if _hear not in before.values():
        _asked.reset(_launcher())
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)  # scripts/imprint.py holds them back until now
    return before


def leave() -> int:
    """Hear no signal any more: the process is about to end, and one that came while Blender unloads would kill it for nothing.

    Returns the exit code of what was heard until now, as `code`.
    """
    for name in (*NAMES, ASK, END):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    return code()


def is_launched() -> bool:
    """Whether scripts/imprint.py waits for us, which says why Blender crashed if it does."""
    return bool(_asked.launcher)


def note(name: str) -> None:
    """Tell scripts/imprint.py, if that waits for us, what is being baked: it names it should Blender crash."""
    descriptor = os.environ.get(BAKING, "")
    if is_launched() and descriptor.isdecimal():
        with suppress(OSError):  # a full disk: it is for a crash alone
            os.ftruncate(int(descriptor), 0)
            os.pwrite(int(descriptor), os.fsencode(name), 0)


@contextmanager
def listening() -> Iterator[None]:
    """Hear signals while the block runs, and forget them after it, unless somebody listened before."""
    before = listen()
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # one of C, which Python cannot set again
                signal.signal(number, handler)
        if _hear not in before.values():
            _asked.reset()


def _launcher() -> int:
    """The process that waits for us, if it is our parent: where it is not, its end cannot be seen."""
    number = os.environ.get(LAUNCHER, "")
    return int(number) if number.isdecimal() and int(number) == os.getppid() else 0


def _hear(number: int, _) -> None:
    name = signal.Signals(number).name
    if name in NAMES:
        _asked.direct += 1
    told = signal.SIGINT if name in (ASK, END) else number
    _asked.code = _asked.code or 128 + told
    if name == END or _asked.direct > 1:
        try:
            partial_files.remove_ours()
        finally:  # it may have come in the middle of just that
            os._exit(_asked.code)
