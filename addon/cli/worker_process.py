# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker as its parent sees it: its process, their messages, its memory, and what it printed before a crash."""

import ctypes
import math
import os
import re
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from ..core.naming import printable
from ..core.progress import BEGUN
from . import interruption, run_report
from .plans import Plan
from .records import Assignment
from .untrusted import Sandbox, processes_in
from .worker_messages import LONGEST_MESSAGE, Gone, Setup, Turns, unpacked


def log_path(folder: str | None, plan: Plan) -> str:
    """The absolute path of a bake's log; empty without a folder."""
    return str(Path(folder).absolute() / f"{plan.number:06}_{run_report.plain_name(plan.name)}.log") if folder else ""


def memory_of(number: int) -> int:
    """The bytes of memory that a process has in use; 0 if it has ended, or where the system does not say."""
    with suppress(OSError, ValueError, IndexError, AttributeError):
        if sys.platform == "linux":
            pages = int(Path(f"/proc/{number}/statm").read_text(encoding="ascii").split()[1])
            return pages * os.sysconf("SC_PAGE_SIZE")
        if os.name == "nt":
            return _on_windows(number)
        listed = subprocess.run(["ps", "-o", "rss=", "-p", str(number)], capture_output=True, text=True, check=False)
        return int(listed.stdout) * 1024
    return 0


def unnamed_memory_of(numbers: Sequence[int]) -> int:
    """The bytes of files without a name that processes have open, as those of memfd_create, which are memory. Of Linux."""
    sizes = {}
    for number in numbers:
        with suppress(OSError):
            for each in os.scandir(f"/proc/{number}/fd"):
                with suppress(OSError):
                    status = os.stat(each.path)
                    if stat.S_ISREG(status.st_mode) and not status.st_nlink:
                        sizes[status.st_dev, status.st_ino] = 512 * status.st_blocks
    return sum(sizes.values())


def kills() -> int:
    """How many processes the system has ended since memory ran out; 0 where it does not say."""
    for path, word in (("/sys/fs/cgroup/memory.events", "oom_kill"), ("/proc/vmstat", "oom_kill")):
        with suppress(OSError, ValueError):
            fields = dict(line.split() for line in Path(path).read_text(encoding="ascii").splitlines())
            if word in fields:
                return int(fields[word])
    return 0


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of Windows."""

    _fields_ = (
        ("length", ctypes.c_uint32),
        ("faults", ctypes.c_uint32),
        ("peak", ctypes.c_size_t),
        ("working_set", ctypes.c_size_t),
        *((name, ctypes.c_size_t) for name in ("a", "b", "c", "d", "page_file", "page_file_peak")),
    )


def _on_windows(number: int) -> int:
    query_and_read = 0x0410
    handle = ctypes.windll.kernel32.OpenProcess(query_and_read, False, number)
    if not handle:
        return 0
    try:
        counters = _Counters(length=ctypes.sizeof(_Counters))
        is_known = ctypes.windll.psapi.GetProcessMemoryInfo(handle, ctypes.byref(counters), counters.length)
        return counters.working_set if is_known else 0
    finally:
        ctypes.windll.kernel32.CloseHandle(handle)


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


def crash_output_of_log(path: str) -> str:
    """As `crash_output`, for a log. Empty if there is none: one that is no plain file is not read."""
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return ""
    try:
        return crash_output(printed_tail(descriptor)) if stat.S_ISREG(os.fstat(descriptor).st_mode) else ""
    finally:
        os.close(descriptor)


def printed_tail(descriptor: int, start: int = 0) -> str:
    """The end of an open file, without its first `start` bytes. Its position stays."""
    if not hasattr(os, "pread"):  # Windows: the position is shared with the process that prints
        return ""
    size = os.fstat(descriptor).st_size
    begin = max(start, size - TAIL)
    return os.pread(descriptor, max(0, size - begin), begin).decode(errors="replace")


def crash_output(text: str) -> str:
    """Where Python was and what was printed before, as the rest of a sentence: ", in read, line 7 of mesh/edges.py, after it
    printed 'Opening'". Empty if the text has neither. text: what a process printed.
    """
    lines = text.splitlines()
    place = next(filter(None, map(_PLACE.fullmatch, lines)), None)
    printed = last_line("\n".join(line for line in lines if not _CRASH.match(line)))
    where = ""
    if place:
        file = "/".join(re.split(r"[/\\]", place["path"])[-2:])
        where = f", in {_short(place['name'])}, line {place['line'][:9]} of {_short(file)}"
    return f"{where}, after it printed {printed!r}" if printed else where


def last_line(text: str) -> str:
    """The last line that is not empty, shortened; "" if there is none."""
    return _short(next((line.strip() for line in reversed(text.splitlines()) if line.strip()), ""))


def _short(text: str) -> str:
    text = printable(text)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


NO_MESSAGE = "Its process sent what is not a message."
"""The error of a bake whose process lies."""
LONGEST_SEND = 2.0
"""Seconds from the first byte of a message of a process that is not trusted to its last one, and from the end of its connection
to its own."""
LONGEST_BEGIN = 4.0
"""Seconds for a process that is not trusted to take its next bake, before another one has it."""
_NO_MORE = object()
"""In the place of an answer: the connection closes."""
WORD = "worker"
"""The only argument of a worker."""
CONNECTION = "IMPRINT_WORKER"
"""The environment variable with the number of the worker's end of the connection."""
ENDING = 5.0
"""Seconds for a process to end that has closed its connection, and for a sandbox that was killed."""
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


@dataclass(frozen=True)
class Ending:
    """How a process ended."""

    text: str
    """In words: "signal 11, Segmentation fault" or "exit code 7"."""
    signal: str
    """The name of the signal; "" for none."""
    lacked_memory: bool
    """Whether the system ended it since there was no more memory."""


class Worker:
    """A worker process, and the bake that it has. Raises OSError if the process cannot be started.

    A thread talks with it: it takes a message, and waits for `answer` or `begin` before it takes the next one. So a process can
    neither make its parent wait nor fill its memory.
    """

    def __init__(self, messages: "SimpleQueue[tuple[Worker, Any]]", sandbox: Sandbox | None = None):
        """messages: gets those of the process. sandbox: in which it runs, if its files are not trusted."""
        self._sandbox = sandbox
        self.started = time.monotonic()
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
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        """What it prints while no bake has a log of its own."""
        self._printed = 0
        """The bytes that it had printed there when its bake began."""
        self._out_of_memory = kills()
        self._answers: SimpleQueue[Any] = SimpleQueue()
        self._receives = math.inf
        """When the first byte of the message that now arrives did, by time.monotonic, of a process that is not trusted."""
        self._connection, other = Pipe()
        with other:
            try:
                self._process = self._start(other)
            except OSError:
                self._connection.close()
                raise
        threading.Thread(target=self._talk, args=(messages,), name="imprint-worker", daemon=True).start()

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

    def answer(self, message: Any = None) -> None:
        """Answer the last message, or let the process go on without an answer. A process that has ended takes none."""
        self._answers.put(message)

    def _talk(self, messages: "SimpleQueue[tuple[Worker, Any]]") -> None:
        is_trusted, turns = self._sandbox is None, Turns()
        with self._connection:
            try:
                while True:
                    message = unpacked(self._received(), is_trusted=is_trusted)
                    if not is_trusted:
                        turns.check(message, self.plan)
                    messages.put((self, message))
                    answer = self._answers.get()
                    if answer is _NO_MORE:
                        return
                    if answer is not None:
                        self._connection.send(answer)
            except (EOFError, ConnectionError):
                gone = Gone()
            except (OSError, MemoryError):
                gone = Gone(NO_MESSAGE)
        messages.put((self, gone))

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

    def _start(self, other: Connection) -> subprocess.Popen:
        number = other.fileno()
        variables = dict(os.environ, **{BEGUN: "", CONNECTION: str(number), interruption.LAUNCHER: str(os.getpid())})
        variables[interruption.BAKING] = ""  # this process names the bake
        words = command()
        if self._sandbox is not None:
            words = self._sandbox.command(command(is_untrusted=True), number)
            own = {name: variables[name] for name in (BEGUN, CONNECTION, interruption.BAKING)}
            own[interruption.LAUNCHER] = "1"  # the init of the sandbox, its parent there
            variables = {**self._sandbox.environment(), **own}
        given: dict[str, Any] = {
            "stdin": subprocess.DEVNULL,
            "stdout": self._output,
            "stderr": self._output,
            "env": variables,
        }
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
        if self._sandbox is None:
            return memory_of(self._process.pid)
        numbers = processes_in(self._process.pid)
        return sum(map(memory_of, numbers)) + unnamed_memory_of(numbers)

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

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
        self._process.kill()
        self._process.wait()

    def dismiss(self) -> None:
        """Let it end: without a bake it does once its connection closes, and with one after a signal."""
        self._answers.put(_NO_MORE)
        if self.plan:
            self.ask_to_stop(at_once=True)

    def close(self, seconds: float = 5.0) -> None:
        """Dismiss it, and wait some seconds before it is killed."""
        self.dismiss()
        self.kill(seconds)
        self._output.close()

    def end(self) -> "Ending":
        """Wait some seconds for a process whose connection has closed."""
        try:
            code = self._process.wait(LONGEST_SEND if self._sandbox else ENDING)
        except subprocess.TimeoutExpired:  # it closed its connection and goes on
            self.kill()
            code = -signal.SIGABRT
        if self._sandbox is not None and code > 128:  # as shells, bwrap adds 128 to the number of a signal
            code = 128 - code
        lacked = code == -getattr(signal, "SIGKILL", 0) and kills() > self._out_of_memory
        return Ending(_ending_text(code), signal.Signals(-code).name if code < 0 else "", lacked)

    def last_printed(self, start: int = 0) -> str:
        """The end of what it printed while no bake had a log, after the first `start` bytes."""
        return printed_tail(self._output.fileno(), start)


def _ending_text(code: int) -> str:
    if code < 0:
        return f"signal {-code}, {signal.strsignal(-code)}"
    return f"exception {code:#x}" if code >= 0x80000000 else f"exit code {code}"  # the first is Windows
