# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths for partial files that no other process has, and what processes left that are dead by now."""

import hashlib
import os
import platform
import re
import secrets
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

WEEK = 7 * 24 * 3600.0
"""Seconds. Nobody takes that long to write a file: older ones are swept whoever wrote them, on whatever machine."""
NAME = re.compile(r"\.imprint\.(?:(?P<machine>\w+)\.)?\d+\.\w+\.partial")
"""Of a guard, with which the names of the files that it guards begin; 0.1.0 had neither guards nor machines."""


class Beside:
    """A path in the folder of `path`, with its ending, that is this process's own until `remove`."""

    def __init__(self, path: Path):
        # Not made of path.stem, which may already be as long as the file system allows.
        self._folder, self._ending = path.parent, path.suffix
        self._guard: _Guard | None = None

    @property
    def here(self) -> Path:
        """The first look at it takes possession. Raises OSError where that cannot be."""
        if self._guard is None:
            _sweep_once(self._folder)
            self._guard = _Guard(self._folder)
            _OURS.add(self)
        return self._folder / f"{self._guard.path.name}{self._ending}"

    def keep(self) -> Path:
        """Give the file a name under which no process sweeps it, if that can be, and return its path."""
        kept = self._folder / f"imprint-kept-{secrets.token_hex(6)}{self._ending}"
        try:
            os.replace(self.here, kept)
        except OSError:
            return self.here
        self.remove()
        return kept

    def remove(self) -> None:
        """Leave nothing there, as far as the folder still lets us. May be called again."""
        if self._guard is None:
            return
        blenders = self.here.with_name(f"{self.here.name}@")  # its own partial file, of a .blend
        for remove in (self.here.unlink, blenders.unlink, self._guard.remove):
            with suppress(OSError):
                remove()
        self._guard = None
        _OURS.discard(self)


_OURS: set[Beside] = set()


def try_in(folder: Path) -> None:
    """Raise OSError unless a file can be made in `folder`."""
    _sweep_once(folder)
    _Guard(folder).remove()


def remove_ours() -> None:
    """Leave nothing of this process, which ends at once."""
    for beside in tuple(_OURS):
        beside.remove()


class _Guard:
    """An empty hidden file that is locked as long as this process lives: with its name those begin that it guards."""

    def __init__(self, folder: Path):
        while True:
            self.path = folder / f".imprint.{machine()}.{os.getpid()}.{secrets.token_hex(6)}.partial"
            self._descriptor = os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
            try:
                _lock(self._descriptor)
            except OSError:  # a file system without locks: then others find none to take, and leave it alone
                return
            if os.fstat(self._descriptor).st_nlink:
                return
            os.close(self._descriptor)  # somebody swept it before it was locked

    def remove(self) -> None:
        try:
            os.close(self._descriptor)  # first, as Windows removes no file that is open
        finally:
            self.path.unlink(missing_ok=True)


@cache
def machine() -> str:
    """What tells this machine from all others: containers on it share the name, and a restart changes it."""
    try:
        text = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
    except OSError:
        text = platform.node()
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def sweep(folder: Path) -> None:
    """Remove the partial files in `folder` whose writers are known to be dead, as far as we may."""
    files: dict[str, list[Path]] = {}
    try:
        names = os.listdir(folder)
    except OSError:  # a folder may take files and show none
        return
    for name in names:
        if match := NAME.match(name):
            files.setdefault(match[0], []).append(folder / name)
    for name, remains in files.items():
        try:
            _sweep(folder / name, remains)
        except OSError:  # gone since, or another person's
            continue


@cache
def _sweep_once(folder: Path) -> None:
    sweep(folder)


def _sweep(guard: Path, remains: list[Path]) -> None:
    is_old = time.time() - max(path.stat().st_mtime for path in remains) > WEEK
    if not is_old and NAME.match(guard.name)["machine"] != machine():
        return
    # A process takes its guard away last: without one nobody is at work.
    descriptor = os.open(guard, os.O_RDWR) if fcntl and guard.exists() else None
    try:
        if descriptor is not None and not is_old:
            _lock(descriptor, wait=False)
        guard.unlink(missing_ok=True)  # Windows refuses to while a process has it open
        for path in remains:
            path.unlink(missing_ok=True)
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock(descriptor: int, *, wait: bool = True) -> None:
    """Hold a file until it is closed; OSError where another process does, or nobody can. Nothing on Windows."""
    if fcntl:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
