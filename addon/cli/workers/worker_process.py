# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker as its parent sees it: a process that runs scripts/bake.py, or a further Blender."""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ...core.timings import BEGUN
from .. import interruption
from ..sandbox import Sandbox, processes_in
from . import last_words, process_memory
from .channel import Channel

WORD = "worker"
"""The only argument of a worker."""
CONNECTION = "IMPRINT_WORKER"
"""The environment variable with the number of the worker's end of the connection."""
ENDING = 5.0
"""Seconds for a sandbox to end that was killed."""
SCRIPT = Path(__file__).resolve().parents[3] / "scripts" / "bake.py"


def command(words: Sequence[str] = (), *, is_untrusted: bool = False) -> list[str]:
    """The command that starts a worker: what started this process, with other arguments for Imprint.

    words: the arguments of this process; sys.argv if empty. is_untrusted: whether Blender runs no scripts of files, even if
    preferences say so.
    """
    bpy = sys.modules.get("bpy")
    if bpy is None or bpy.app.module:
        return [sys.executable, str(SCRIPT), "--", WORD]
    given = list(words or sys.argv)
    never = ["--disable-autoexec"] if is_untrusted else []
    for option in ("--command", "-c"):
        if option in given:
            return [
                bpy.app.binary_path,
                *given[1 : given.index(option)],
                *never,
                *given[given.index(option) :][:2],
                WORD,
            ]
    return [bpy.app.binary_path, *given[1 : given.index("--") if "--" in given else None], *never, "--", WORD]


@dataclass(frozen=True)
class Ending:
    """How a process ended."""

    text: str
    """In words: "signal 11, Segmentation fault" or "exit code 7"."""
    signal: str
    """The name of the signal; "" for none."""
    lacked_memory: bool
    """Whether the system ended it since there was no more memory."""


class WorkerProcess:
    """A worker. Raises OSError if it cannot be started."""

    def __init__(self, sandbox: Sandbox | None = None):
        """sandbox: in which it runs, if its files are not trusted."""
        self.is_ready, self._sandbox = False, sandbox
        """Whether Blender has started."""
        self.log = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        """What it prints while no bake has a log of its own."""
        self._out_of_memory = process_memory.kills()
        self.channel = Channel()
        try:
            self._process = self._start(self.channel.other)
        except OSError:
            self.channel.close()
            raise
        self.channel.other.close()

    def _start(self, other: Connection) -> subprocess.Popen:
        number = other.fileno()
        variables = dict(os.environ, **{BEGUN: "", CONNECTION: str(number), interruption.LAUNCHER: str(os.getpid())})
        variables[interruption.BAKING] = ""  # this process names the bake
        words = command()
        if self._sandbox is not None:
            words = self._sandbox.command(command(is_untrusted=True))
            own = {name: variables[name] for name in (BEGUN, CONNECTION, interruption.BAKING)}
            own[interruption.LAUNCHER] = "1"  # the init of the sandbox, its parent there
            variables = {**self._sandbox.environment(), **own}
        given: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": self.log, "stderr": self.log, "env": variables}
        if os.name == "nt":
            os.set_handle_inheritable(number, True)
            startup = subprocess.STARTUPINFO(lpAttributeList={"handle_list": [number]})
            return subprocess.Popen(words, startupinfo=startup, **given)
        # The worker unblocks them once it handles them.
        blocked = [getattr(signal, name) for name in (*interruption.NAMES, interruption.ASK, interruption.END)]
        before = signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
        try:
            return subprocess.Popen(words, pass_fds=[number], **given)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    @property
    def memory(self) -> int:
        """The bytes of memory that it has now, with all that it has started; 0 where the system does not say."""
        numbers = processes_in(self._process.pid) if self._sandbox else [self._process.pid]
        return sum(map(process_memory.of, numbers))

    def send(self, message: Any) -> bool:
        """Send a message. Returns whether the worker takes messages: one that has died does not."""
        try:
            self.channel.send(message)
        except OSError:
            return False
        return True

    def ask_to_stop(self, *, at_once: bool = False) -> None:
        """Ask it to stop, cleanly or at once, as scripts/imprint.py asks this process."""
        if os.name == "nt":  # there, Ctrl-C reaches all processes of a console
            return
        meant = getattr(signal, interruption.END if at_once else interruption.ASK)
        if self._sandbox is None:
            self._process.send_signal(meant)
        else:
            for number in processes_in(self._process.pid)[1:2]:
                with suppress(ProcessLookupError):
                    os.kill(number, meant)

    def kill(self, seconds: float = 0.0) -> None:
        """End it, unless it ends within some seconds by itself."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
            return
        for number in processes_in(self._process.pid)[:1] if self._sandbox else ():
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)  # the init of the sandbox, with which all processes there end
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(ENDING)
                return
        self._process.kill()
        self._process.wait()

    def close(self, seconds: float = 5.0) -> None:
        """End it: it stops when its connection closes. seconds: how long to wait for that."""
        self.channel.close()
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.kill()
        self.log.close()

    def end(self, seconds: float = 5.0) -> "Ending":
        """Wait some seconds for a process whose connection has closed."""
        try:
            code = self._process.wait(seconds)
        except subprocess.TimeoutExpired:  # it closed its connection and goes on
            self.kill()
            code = -signal.SIGABRT
        if self._sandbox is not None and code > 128:  # as shells, bwrap adds 128 to the number of a signal
            code = 128 - code
        lacked = code == -getattr(signal, "SIGKILL", 0) and process_memory.kills() > self._out_of_memory
        return Ending(_words(code), signal.Signals(-code).name if code < 0 else "", lacked)

    @property
    def printed(self) -> int:
        """The bytes that it has printed to its own log."""
        return os.fstat(self.log.fileno()).st_size

    def last_printed(self, start: int = 0) -> str:
        """The end of what it printed to its own log after the first `start` bytes."""
        return last_words.tail(self.log.fileno(), start)


def _words(code: int) -> str:
    if code < 0:
        return f"signal {-code}, {signal.strsignal(-code)}"
    return f"exception {code:#x}" if code >= 0x80000000 else f"exit code {code}"  # the first is Windows
