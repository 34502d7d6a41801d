# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker as its parent sees it: its process, their messages, its memory, and what it printed before a crash."""

import ctypes
import functools
import json
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
from dataclasses import dataclass, field, is_dataclass, replace
from enum import StrEnum
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from queue import SimpleQueue
from typing import Any, get_args, get_origin, get_type_hints

from ..core.naming import printable
from ..core.progress import BEGUN
from . import interruption, run_report, sheet
from .options import RunOptions
from .plans import Plan
from .records import Assignment
from .run_report import Entry
from .untrusted import Sandbox, processes_in


@dataclass(frozen=True)
class Setup:
    """To a worker, in a tuple with an Assignment: what all bakes of the run have in common."""

    options: RunOptions
    needs_all: bool
    """As baker.need_all returns it for all plans."""
    is_shown: bool
    """Whether the parent shows how far bakes are."""
    folders: tuple[str, ...] = ()
    """Those that bakes of untrusted files read; none for others."""


@dataclass(frozen=True)
class Answer:
    """To a worker: its files may be used, or the sentence that says why not."""

    problem: str = ""


@dataclass(frozen=True)
class Ready:
    """To the parent: Blender and its GPU have started. most_bakes: after so many, another worker takes its place; 0 for any
    number."""

    most_bakes: int = 0


@dataclass(frozen=True)
class Begun:
    """To the parent: the worker has its Assignment. Without that, another worker can have it."""


@dataclass(frozen=True)
class Gone:
    """To the parent, from the thread that reads: the process has ended, or a sentence that says what is wrong with it."""

    why: str = ""


@dataclass(frozen=True)
class FilesFound:
    """To the parent, which sends an Answer: a bake found more files, as the arguments of clashes.RunFiles.opened, or an export,
    that of clashes.RunFiles.exported."""

    lows: list[str] = field(default_factory=list)
    used: list[tuple[str, str]] = field(default_factory=list)
    export: str = ""


@dataclass(frozen=True)
class Percent:
    """To the parent: how far a bake is. done: from 0 to 1."""

    subject: str
    what: str
    done: float


@dataclass(frozen=True)
class Line:
    """To the parent: a line to print before a bake, which can take long."""

    line: str


LONGEST_MESSAGE = 1 << 26
"""Of a message from a worker for untrusted files. Others may have long sequences, with a report for each frame."""
_FROM_WORKERS = {each.__name__: each for each in (Entry, FilesFound, Ready, Begun, Percent, Line)}
_PICTURE = b"\0"
"""Between the JSON of a message, which has no such byte, and the picture of an Entry."""


def packed(message: Any) -> bytes:
    """A message of a worker as JSON."""
    values = dict(vars(message))
    image = values.pop("image", b"")
    text = json.dumps([type(message).__name__, values], default=vars)
    return text.encode() + _PICTURE + image


def unpacked(content: bytes, *, is_trusted: bool = True) -> Any:
    """A message of a worker from its bytes. Raises OSError for what is no message.

    is_trusted: whether the values in its reports are taken to be of the right types.
    """
    text, _, image = content.partition(_PICTURE)
    try:
        name, values = json.loads(text)
        if name == Entry.__name__:
            values["image"] = image
        message = _made(values, _FROM_WORKERS[name])
        if not is_trusted and isinstance(message, Entry):
            _check_reports(message)
    except (LookupError, ValueError, TypeError, AttributeError, MemoryError, RecursionError) as error:
        raise OSError("no message") from error
    return message


def _made(value: Any, hint: Any) -> Any:
    """A value from JSON as the type of an annotation. Raises LookupError, TypeError or ValueError if it is of another."""
    kind, given = get_origin(hint) or hint, get_args(hint)
    if kind is Any:
        return value
    if is_dataclass(kind):
        return kind(**{name: _made(value[name], each) for name, each in _hints(kind).items()})
    if issubclass(kind, StrEnum):
        return kind(value)
    if kind is tuple:
        return tuple(_made(each, own) for each, own in zip(value, given, strict=True))
    if not isinstance(value, int | float if kind is float else kind):
        raise TypeError(f"{value!r} is no {kind.__name__}")
    return [_made(each, given[0]) for each in value] if kind is list else value


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _check_reports(entry: Entry) -> None:
    """Raise LookupError, TypeError, ValueError or AttributeError if an entry cannot be shown as those of bakes are."""
    for each in (*entry.files, *entry.inputs):
        if not all(isinstance(each[name], str) for name in ("path", "what")):
            raise TypeError("a file without a path")
    written = (paths for each in entry.reports for paths in run_report.written_paths(each).values())
    if not all(isinstance(path, str) for paths in written for path in paths):
        raise TypeError("a path that is no text")
    sheet.row(entry.to_dict(), b"")


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
        found = subprocess.run(["ps", "-o", "rss=", "-p", str(number)], capture_output=True, text=True, check=False)
        return int(found.stdout) * 1024
    return 0


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
        found = ctypes.windll.psapi.GetProcessMemoryInfo(handle, ctypes.byref(counters), counters.length)
        return counters.working_set if found else 0
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
    """As `clause`, for a log. Empty if there is none: one that is no plain file is not read."""
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


_NO_MORE = object()
"""In the place of an answer: the connection closes."""
WORD = "worker"
"""The only argument of a worker."""
CONNECTION = "IMPRINT_WORKER"
"""The environment variable with the number of the worker's end of the connection."""
ENDING = 5.0
"""Seconds for a sandbox to end that was killed."""
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
        self.has_begun = False
        """Whether it has received that."""
        self.is_well = False
        """Whether it has received any bake: one may end after Blender has started, and before that."""
        self.chain = 0
        """The chain of its last bake, whose scene is open in it."""
        self.begun = 0.0
        """When its bake began, by time.monotonic."""
        self._log = ""
        """The path of the log of its bake, or ""."""
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        """What it prints while no bake has a log of its own."""
        self._printed = 0
        """The bytes that it had printed there when its bake began."""
        self._out_of_memory = kills()
        self._answers: SimpleQueue[Any] = SimpleQueue()
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
        self.assigned, self.has_begun, self.chain = assigned, False, assigned.plan.chain
        self._log, self.begun = log_path(setup.options.log, assigned.plan), time.monotonic()
        self._printed = os.fstat(self._output.fileno()).st_size
        self.answer((setup, replace(assigned, record=None, key=None) if setup.folders else assigned))

    def answer(self, message: Any = None) -> None:
        """Answer the last message, or let the process go on without an answer. A process that has ended takes none."""
        self._answers.put(message)

    def _talk(self, messages: "SimpleQueue[tuple[Worker, Any]]") -> None:
        is_trusted = self._sandbox is None
        with self._connection:
            try:
                while True:
                    content = self._connection.recv_bytes(None if is_trusted else LONGEST_MESSAGE)
                    messages.put((self, unpacked(content, is_trusted=is_trusted)))
                    answer = self._answers.get()
                    if answer is _NO_MORE:
                        return
                    if answer is not None:
                        self._connection.send(answer)
            except (EOFError, ConnectionError):
                gone = Gone()
            except (OSError, MemoryError):
                gone = Gone("Its process sent what is not a message.")
        messages.put((self, gone))

    def crash_output(self) -> str:
        """The clause of the function `crash_output` about its bake."""
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
        numbers = processes_in(self._process.pid) if self._sandbox else [self._process.pid]
        return sum(map(memory_of, numbers))

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

    def end(self, seconds: float = 5.0) -> "Ending":
        """Wait some seconds for a process whose connection has closed."""
        try:
            code = self._process.wait(seconds)
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
