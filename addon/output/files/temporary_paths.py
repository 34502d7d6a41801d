# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary paths that belong to one process, and the removal of files that dead processes left."""

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
"""Seconds. No process writes a file for that long: older files are removed, whichever machine wrote them."""
NAME = re.compile(r"\.imprint\.(?:(?P<machine>\w+)\.)?\d+\.\w+\.partial")
"""The names of guards. A file that a guard protects has a name that begins with the guard's. Version 0.1.0 wrote no machine."""


class TemporaryPath:
    """A path in the folder of `path`, with its ending, that no other process uses until `remove`."""

    def __init__(self, path: Path):
        # path.stem is not used: it may already be as long as the file system allows.
        self._folder, self._ending = path.parent, path.suffix
        self._guard: _Guard | None = None

    @property
    def path(self) -> Path:
        """The path. The first access reserves it, and raises OSError if that fails."""
        if self._guard is None:
            _sweep_once(self._folder)
            self._guard = _Guard(self._folder)
            _OURS.add(self)
        return self._folder / f"{self._guard.path.name}{self._ending}"

    def keep(self) -> Path:
        """Rename the file so that no process removes it, if possible. Returns its path."""
        kept = self._folder / f"imprint-kept-{secrets.token_hex(6)}{self._ending}"
        try:
            os.replace(self.path, kept)
        except OSError:
            return self.path
        self.remove()
        return kept

    def remove(self) -> None:
        """Remove the file, if the folder allows it. Can be called more than once."""
        if self._guard is None:
            return
        blend = self.path.with_name(f"{self.path.name}@")  # Blender writes a .blend to this path first
        for remove in (self.path.unlink, blend.unlink, self._guard.remove):
            with suppress(OSError):
                remove()
        self._guard = None
        _OURS.discard(self)


_OURS: set[TemporaryPath] = set()
"""The reserved paths of this process."""


def check_folder(folder: Path) -> None:
    """Raise OSError unless a file can be created in `folder`."""
    _sweep_once(folder)
    _Guard(folder).remove()


def remove_all() -> None:
    """Remove all temporary files of this process, before it exits."""
    for path in tuple(_OURS):
        path.remove()


class _Guard:
    """An empty hidden file that this process locks. The names of the files that it protects begin with its name."""

    def __init__(self, folder: Path):
        while True:
            self.path = folder / f".imprint.{machine()}.{os.getpid()}.{secrets.token_hex(6)}.partial"
            self._descriptor = os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
            try:
                _lock(self._descriptor)
            except OSError:  # a file system without locks, where other processes do not remove the file either
                return
            if os.fstat(self._descriptor).st_nlink:
                return
            os.close(self._descriptor)  # another process removed it before it was locked

    def remove(self) -> None:
        try:
            os.close(self._descriptor)  # first: Windows does not remove open files
        finally:
            self.path.unlink(missing_ok=True)


@cache
def machine() -> str:
    """An identifier of this machine, which changes when it restarts. Containers on a machine share it."""
    try:
        text = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
    except OSError:
        text = platform.node()
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def sweep(folder: Path) -> None:
    """Remove the temporary files in `folder` whose processes have ended, if permissions allow it."""
    files: dict[str, list[Path]] = {}
    try:
        names = os.listdir(folder)
    except OSError:  # a folder can be writable and not readable
        return
    for name in names:
        if match := NAME.match(name):
            files.setdefault(match[0], []).append(folder / name)
    for name, paths in files.items():
        try:
            _sweep(folder / name, paths)
        except OSError:  # already gone, or owned by another user
            continue


@cache
def _sweep_once(folder: Path) -> None:
    sweep(folder)


def _sweep(guard: Path, paths: list[Path]) -> None:
    is_old = time.time() - max(path.stat().st_mtime for path in paths) > WEEK
    if not is_old and NAME.match(guard.name)["machine"] != machine():
        return
    # A process removes its guard last: without a guard, no process is writing.
    descriptor = os.open(guard, os.O_RDWR) if fcntl and guard.exists() else None
    try:
        if descriptor is not None and not is_old:
            _lock(descriptor, wait=False)
        guard.unlink(missing_ok=True)  # Windows refuses while a process has it open
        for path in paths:
            path.unlink(missing_ok=True)
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock(descriptor: int, *, wait: bool = True) -> None:
    """Lock a file until it is closed. Does nothing on Windows.

    Raises OSError if another process has locked the file, or if the file system has no locks."""
    if fcntl:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
