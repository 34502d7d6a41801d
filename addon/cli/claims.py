# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims on bakes: files by which processes on any machine agree which of them does a bake.

A claim is a file that only one process can create. Its owner changes it again and again. Nothing depends on clocks of other
machines or on process numbers: a claim has been left if its owner's machine, this one, has unlocked it, or if it does not
change while this process watches it for long.
"""

import json
import os
import platform
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..output import atomic_file
from ..output.atomic_file import TemporaryPath, make_folder
from . import heartbeat
from .heartbeat import Heartbeat

try:
    import fcntl
except ImportError:  # Windows, which renames no file that a process has open
    fcntl = None

HEARTBEAT = 10.0
"""Seconds between two changes of a claim by its owner."""
LEFT_AFTER = 60.0
"""Seconds without a change after which a claim of another machine has been left."""
EMPTY_FOR = 5.0
"""Seconds after which a claim that is still empty has been left: its process was killed between creating and writing it."""


@dataclass
class _Held:
    """A claim of this process."""

    descriptor: int
    is_locked: bool
    identity: os.stat_result
    """What the system says of the file."""
    made: list[Path]
    """The folders that were made for it, the innermost first."""
    machine: str
    token: str = field(default_factory=lambda: secrets.token_hex(16))
    count: int = 0

    @property
    def values(self) -> dict[str, Any]:
        """What the file contains beside how often it was changed."""
        machine = self.machine if self.is_locked else ""
        return {"token": self.token, "host": platform.node(), "machine": machine, "process": os.getpid()}

    def beat(self) -> None:
        """Change the claim. Raises OSError."""
        self.count += 1
        heartbeat.write(self.descriptor, heartbeat.text(self.values, self.count))


class Claims:
    """The claims that this process has, and those of others that it watches. `close` gives all up."""

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        machine: str = "",
        beat: float = HEARTBEAT,
        *,
        is_busy: bool = False,
    ):
        """clock: in seconds. machine: an identifier of this machine. is_busy: whether this process bakes, so that another one
        has to change its claims as well."""
        self._clock, self._machine, self._every = clock, machine or atomic_file.machine(), beat
        self._held: dict[Path, _Held] = {}
        self._watched: dict[Path, tuple[bytes, float]] = {}
        """What claims of others contain, and since when."""
        self._is_busy = threading.Lock()
        self._is_closed = threading.Event()
        self._thread: threading.Thread | None = None
        self._heartbeat = Heartbeat(beat) if is_busy else None

    def __enter__(self) -> "Claims":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def take(self, path: Path) -> bool:
        """Whether this process has the claim at `path` from now on. Returns at once: ask again while another one has it.

        Raises OSError if no file can be created there.
        """
        if self._create(path):
            return True
        content = self._left(path)
        return content is not None and _remove(path, content) and self._create(path)

    def release(self, path: Path) -> None:
        """Give a claim up. Does nothing for one that this process does not have."""
        with self._is_busy:
            held = self._held.pop(path, None)
        if held is None:
            return
        if self._heartbeat is not None:
            self._heartbeat.send(str(path))
        if fcntl is None:
            os.close(held.descriptor)
        with suppress(OSError):  # a share that is gone; others see that the claim does not change
            if os.path.samestat(os.stat(path), held.identity):  # its content may be missing, on a full disk
                path.unlink()
        if fcntl is not None:
            os.close(held.descriptor)
        for folder in held.made:
            with suppress(OSError):  # it has files now
                folder.rmdir()

    def close(self) -> None:
        """Give all claims up. Can be called more than once."""
        self._is_closed.set()
        for path in tuple(self._held):
            self.release(path)
        if self._thread is not None:
            self._thread.join()
        if self._heartbeat is not None:
            self._heartbeat.close()

    def _create(self, path: Path) -> bool:
        """Create the file of a claim, unless there is one. Raises OSError."""
        made = make_folder(path.parent)[::-1]
        try:
            descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
        except FileExistsError:
            return False
        held = _Held(descriptor, _lock(descriptor), os.fstat(descriptor), made, self._machine)
        with suppress(OSError):  # a full disk: an empty claim is one, too
            held.beat()
        self._watched.pop(path, None)
        with self._is_busy:
            self._held[path] = held
        if self._heartbeat is not None:
            self._heartbeat.send(str(path), held.values)
        if self._thread is None:
            self._thread = threading.Thread(target=self._beat, name="imprint-claims", daemon=True)
            self._thread.start()
        return True

    def _left(self, path: Path) -> bytes | None:
        """What the claim of another process contains, if that process has left it. None if it has not."""
        try:
            content = path.read_bytes()
        except OSError:  # given up this moment
            return None
        now = self._clock()
        before, since = self._watched.get(path, (None, now))
        if content != before:
            since = now
            self._watched[path] = content, now
        is_from_here = _machine_of(content) == self._machine
        if now - since >= (LEFT_AFTER if content else EMPTY_FOR) or (is_from_here and _is_unlocked(path)):
            return content
        return None

    def _beat(self) -> None:
        while not self._is_closed.wait(self._every):
            if self._heartbeat is not None and self._heartbeat.is_running:
                continue
            with self._is_busy:
                for held in self._held.values():
                    with suppress(OSError):  # a share that is gone for a moment
                        held.beat()


def _remove(path: Path, content: bytes) -> bool:
    """Remove the claim of another process at `path` if that is its content. Returns whether there is none now.

    It is renamed first, which only one of several processes can do, and then looked at: another process may have been faster,
    and its own new claim be here, which is put back.
    """
    moved = TemporaryPath(path)
    try:
        try:
            os.rename(path, moved.path)
        except FileNotFoundError:
            return True
        except PermissionError:  # Windows: its owner has it open
            return False
        if moved.path.read_bytes() == content:
            return True
        with suppress(OSError):  # a third process has created its claim meanwhile: the bake is done twice
            os.link(moved.path, path)
        return False
    finally:
        moved.remove()


def _lock(descriptor: int) -> bool:
    """Lock a file until it is closed, which the system does when a process ends. False on file systems without locks."""
    if fcntl:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError:
            return False
    return True


def _is_unlocked(path: Path) -> bool:
    """Whether no process of this machine has the file locked."""
    if fcntl is None:
        return True  # renaming it shows whether it is open
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def _machine_of(content: bytes) -> str:
    """The identifier of the machine whose process locked a claim, or "" if it locked none."""
    try:
        return json.loads(content)["machine"]
    except (ValueError, KeyError, TypeError):  # it is being written
        return ""
