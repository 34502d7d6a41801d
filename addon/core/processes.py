# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of Imprint's own as their parent sees them: start, messages, memory, end, and what they printed before a crash."""

import ctypes
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
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from .naming import printable

CONNECTION = "IMPRINT_WORKER"
"""The environment variable with the number of the child's end of the connection."""
ENDING = 5.0
"""Seconds for a process to end that has closed its connection."""
NO_MESSAGE = "Its process sent what is not a message."
"""The error of a bake whose process lies."""
_NO_MORE = object()
"""In the place of an answer: the connection closes."""
_PR_SET_PDEATHSIG = 1
"""Of Linux's prctl: the signal when the parent process ends."""


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
    libraries = vars(ctypes)["windll"]  # which only Windows has
    handle = libraries.kernel32.OpenProcess(query_and_read, False, number)
    if not handle:
        return 0
    try:
        counters = _Counters(length=ctypes.sizeof(_Counters))
        is_known = libraries.psapi.GetProcessMemoryInfo(handle, ctypes.byref(counters), counters.length)
        return counters.working_set if is_known else 0
    finally:
        libraries.kernel32.CloseHandle(handle)


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


@dataclass(frozen=True)
class Ending:
    """How a process ended."""

    text: str
    """In words: "signal 11, Segmentation fault" or "exit code 7"."""
    signal: str
    """The name of the signal; "" for none."""
    lacked_memory: bool
    """Whether the system ended it since there was no more memory."""


@dataclass(frozen=True)
class Gone:
    """From the thread that reads: the process has ended, or a sentence that says what is wrong with it.

    Attributes:
        why: The sentence; empty for an end without one.
    """

    why: str = ""


def in_blender(binary: str, program: str) -> list[str]:
    """The words that run a program in Python. binary: of Blender, without interface and settings of the user; empty where
    it is a package of this Python."""
    if not binary:
        return [sys.executable, "-c", program]
    options = ["--background", "--factory-startup", "-noaudio", "--python-exit-code", "1"]
    return [binary, *options, "--python-expr", program]


class Process:
    """A process, and a connection to it. Raises OSError if it cannot be started.

    A thread talks with it: it takes a message, and waits for `answer` before it takes the next one. So a process can neither
    make its parent wait nor fill its memory. The process finds its end of the connection by CONNECTION.
    """

    def __init__(self, messages: "SimpleQueue[tuple[Process, Any]]"):
        """messages: gets those of the process, and Gone after the last one."""
        self.started = time.monotonic()
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        """What it prints."""
        self._out_of_memory = kills()
        self._answers: SimpleQueue[Any] = SimpleQueue()
        self._sending = threading.Lock()
        self._connection, other = Pipe()
        with other:
            try:
                self._process = self._start(other)
            except OSError:
                self._connection.close()
                raise
        self._talking = threading.Thread(target=self._talk, args=(messages,), name="imprint-worker", daemon=True)
        self._talking.start()

    def _command(self, number: int) -> tuple[Sequence[str], dict[str, str]]:
        """The words that start it, and its environment. number: of its end of the connection."""
        raise NotImplementedError

    def _next(self) -> Any:
        """Its next message. Raises EOFError and OSError."""
        raise NotImplementedError

    def _popen(self, words: Sequence[str], **given: Any) -> subprocess.Popen:
        return subprocess.Popen(words, **given)

    def _start(self, other: Connection) -> subprocess.Popen:
        number = other.fileno()
        words, variables = self._command(number)
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
        return self._popen(words, pass_fds=[number], **given)

    def tell(self, message: Any) -> None:
        """Send it a message that is no answer. A process that has ended takes none."""
        with suppress(OSError), self._sending:
            self._connection.send(message)

    def answer(self, message: Any = None) -> None:
        """Answer the last message, or let the process go on without an answer. A process that has ended takes none."""
        self._answers.put(message)

    def _talk(self, messages: "SimpleQueue[tuple[Process, Any]]") -> None:
        with self._connection:
            try:
                while True:
                    messages.put((self, self._next()))
                    answer = self._answers.get()
                    if answer is _NO_MORE:
                        return
                    if answer is not None:
                        with self._sending:
                            self._connection.send(answer)
            except (EOFError, ConnectionError):
                gone = Gone()
            except (OSError, MemoryError):
                gone = Gone(NO_MESSAGE)
        messages.put((self, gone))

    @property
    def memory(self) -> int:
        """The bytes of memory that it has now; 0 where the system does not say."""
        return memory_of(self._process.pid)

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def kill(self, seconds: float = 0.0) -> None:
        """End it, unless it ends within some seconds by itself."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
            return
        self._process.kill()
        self._process.wait()

    def dismiss(self) -> None:
        """Let it end, once its connection closes."""
        self._answers.put(_NO_MORE)

    def close(self, seconds: float = ENDING) -> None:
        """Dismiss it, and wait some seconds before it is killed. What it has sent until then is read."""
        self.dismiss()
        self.kill(seconds)
        self._talking.join(ENDING)
        self._output.close()

    def end(self, seconds: float = ENDING) -> Ending:
        """Wait some seconds for a process whose connection has closed."""
        try:
            code = self._process.wait(seconds)
        except subprocess.TimeoutExpired:  # it closed its connection and goes on
            self.kill()
            code = -signal.SIGABRT
        return self._ending(code)

    def _ending(self, code: int) -> Ending:
        lacked = code == -getattr(signal, "SIGKILL", 0) and kills() > self._out_of_memory
        return Ending(_ending_text(code), signal.Signals(-code).name if code < 0 else "", lacked)

    def last_printed(self, start: int = 0) -> str:
        """The end of what it printed, after the first `start` bytes."""
        return printed_tail(self._output.fileno(), start)


def end_with_parent() -> None:
    """Have the system kill this process when its parent ends. Elsewhere than on Linux it ends by itself, unless it hangs."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _ending_text(code: int) -> str:
    if code < 0:
        return f"signal {-code}, {signal.strsignal(-code)}"
    return f"exception {code:#x}" if code >= 0x80000000 else f"exit code {code}"  # the first is Windows
