# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker as its parent sees it: a process, and the bake that it has."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from ..core.processes import (
    CONNECTION,
    ENDING,
    Ending,
    Process,
    crash_output,
    crash_output_of_log,
    memory_of,
    unnamed_memory_of,
)
from ..core.progress import BEGUN
from . import interruption, run_report
from .plans import Plan
from .records import Assignment
from .untrusted import Sandbox, processes_in
from .worker_messages import LONGEST_MESSAGE, Setup, Turns, unpacked


def log_path(folder: str | None, plan: Plan) -> str:
    """The absolute path of a bake's log; empty without a folder."""
    return str(Path(folder).absolute() / f"{plan.number:06}_{run_report.plain_name(plan.name)}.log") if folder else ""


LONGEST_SEND = 2.0
"""Seconds from the first byte of a message of a process that is not trusted to its last one, and from the end of its connection
to its own."""
LONGEST_BEGIN = 4.0
"""Seconds for a process that is not trusted to take its next bake, before another one has it."""
WORD = "worker"
"""The only argument of a worker."""
SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "bake.py"


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


class Worker(Process):
    """A worker process, and the bake that it has. `begin` answers its messages, too."""

    def __init__(self, messages: "SimpleQueue[tuple[Process, Any]]", sandbox: Sandbox | None = None):
        """messages: gets those of the process. sandbox: in which it runs, if its files are not trusted."""
        self._sandbox, self._turns = sandbox, Turns()
        self.is_ready = False
        """Whether Blender has started."""
        self.bakes_left = 0
        """How many bakes it may begin; below 0 for any number."""
        self.assigned: Assignment | None = None
        """Its bake."""
        self.has_accepted = False
        """Whether it has received that."""
        self.is_well = False
        """Whether it has received any bake: one may end after Blender has started, and before that."""
        self.chain = 0
        """The chain of its last bake, whose scene is open in it."""
        self.assigned_at = 0.0
        """When it was given its bake, by time.monotonic."""
        self._log = ""
        """The path of the log of its bake, or ""."""
        self._printed = 0
        """The bytes that it had printed while no bake had a log of its own, when its bake began."""
        self._receives = math.inf
        """When the first byte of the message that now arrives did, by time.monotonic, of a process that is not trusted."""
        super().__init__(messages)

    @property
    def plan(self) -> Plan | None:
        return self.assigned and self.assigned.plan

    @property
    def log(self) -> str:
        """The file that has what its bake prints, or ""."""
        return self._log if os.path.exists(self._log) else ""

    def begin(self, setup: Setup, assigned: Assignment) -> None:
        """Send it a bake. One whose files are not trusted writes no record."""
        self.assigned, self.has_accepted, self.chain = assigned, False, assigned.plan.chain
        self._log, self.assigned_at = log_path(setup.options.log, assigned.plan), time.monotonic()
        self._printed = os.fstat(self._output.fileno()).st_size
        self.answer((setup, replace(assigned, record=None, key=None) if setup.folders else assigned))

    def _next(self) -> Any:
        is_trusted = self._sandbox is None
        message = unpacked(self._received(), is_trusted=is_trusted)
        if not is_trusted:
            self._turns.check(message, self.plan)
        return message

    def _received(self) -> bytes:
        """The bytes of the next message. Raises EOFError and OSError."""
        if self._sandbox is None:
            return self._connection.recv_bytes()
        self._connection.poll(None)
        self._receives = time.monotonic()
        try:
            return self._connection.recv_bytes(LONGEST_MESSAGE)
        finally:
            self._receives = math.inf

    @property
    def is_stuck(self) -> bool:
        """Whether a process that is not trusted has begun a message and does not end it, or does not begin its bake."""
        if self._sandbox is None:
            return False
        now, is_waiting = time.monotonic(), self.assigned is not None and not self.has_accepted
        return now - self._receives > LONGEST_SEND or (is_waiting and now - self.assigned_at > LONGEST_BEGIN)

    def crash_output(self) -> str:
        """What the function `crash_output` says of its bake."""
        return crash_output_of_log(self.log) if self.log else crash_output(self.last_printed(self._printed))

    def _command(self, number: int) -> tuple[Sequence[str], dict[str, str]]:
        variables = dict(os.environ, **{BEGUN: "", CONNECTION: str(number), interruption.LAUNCHER: str(os.getpid())})
        variables[interruption.BAKING] = ""  # this process names the bake
        if self._sandbox is None:
            return command(), variables
        own = {name: variables[name] for name in (BEGUN, CONNECTION, interruption.BAKING)}
        own[interruption.LAUNCHER] = "1"  # the init of the sandbox, its parent there
        words = self._sandbox.command(command(is_untrusted=True), number)
        return words, {**self._sandbox.environment(), **own}

    def _popen(self, words: Sequence[str], **given: Any) -> subprocess.Popen:
        # The worker unblocks them once it handles them.
        blocked = [getattr(signal, name) for name in (*interruption.NAMES, interruption.ASK, interruption.END)]
        before = signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
        try:
            return subprocess.Popen(words, **given)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    @property
    def memory(self) -> int:
        """The bytes of memory that it has now, with all that it has started; 0 where the system does not say."""
        if self._sandbox is None:
            return memory_of(self._process.pid)
        numbers = processes_in(self._process.pid)
        return sum(map(memory_of, numbers)) + unnamed_memory_of(numbers)

    def ask_to_stop(self, *, at_once: bool = False) -> None:
        """Ask it to stop, cleanly or at once, as scripts/imprint.py asks this process."""
        if os.name == "nt" or self.has_ended:  # on Windows, Ctrl-C reaches all processes of a console
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
        super().kill()

    def dismiss(self) -> None:
        """Let it end: without a bake it does once its connection closes, and with one after a signal."""
        super().dismiss()
        if self.plan:
            self.ask_to_stop(at_once=True)

    def end(self, seconds: float = 0.0) -> Ending:
        """As Process.end. seconds: 0 for as long as such a process may take."""
        return super().end(seconds or (LONGEST_SEND if self._sandbox else ENDING))

    def _ending(self, code: int) -> Ending:
        # As shells, bwrap adds 128 to the number of a signal.
        return super()._ending(128 - code if self._sandbox is not None and code > 128 else code)
