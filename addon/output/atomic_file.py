# SPDX-License-Identifier: GPL-3.0-or-later
"""Files have either their complete new content or their old one, and what ends early leaves nothing behind.

Content is written to temporary paths of this process, which are moved to their places in one step. What a dead process left is
removed by the next one that writes to the folder.
"""

import errno
import hashlib
import os
import platform
import re
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ..core.errors import BakeError, WrongPlace, reason

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


before_first: Callable[[Path], None] | None = None
"""Called with each folder before this process makes its first temporary file there, in any thread."""


@cache
def _sweep_once(folder: Path) -> None:
    if before_first is not None:
        before_first(folder)
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


_SYSTEM_MESSAGES = frozenset(map(os.strerror, errno.errorcode))
_SAVE_FAILED = "Failed to write blendfile"
"""What Blender 5.3 says before the last error of the system, or alone, where older versions say that error alone."""
_NEW_FOLDERS: set[Path] = set()
"""Folders that were made for files that are not yet written."""
before_replacing: Callable[[Path, list[Path]], None] | None = None
"""Called with the path of each file before it is made or replaced, and the folders that were made for it."""


def check_writable(path: Path) -> None:
    """Raise BakeError unless a file can be written to `path`. Missing folders above it count as writable."""
    try:
        target = resolved(path)
        folder = next(folder for folder in target.parents if os.path.lexists(folder))
        # Ask the file system: permission bits say nothing about a full or read-only disk.
        check_folder(folder)
    except OSError as error:
        raise BakeError(f"{str(path)!r} cannot be written: {reason(error)}.") from error


def resolved(path: Path) -> Path:
    """`path` with links resolved, so that writing replaces their target. Raises as `check_kind`."""
    check_kind(path)
    return Path(os.path.realpath(path))


def check_kind(path: str | Path) -> None:
    """Raise WrongPlace if `path` exists and is not a file, and OSError if it cannot exist."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        raise WrongPlace(f"{str(path)!r} is a folder: name a file.")
    if not stat.S_ISREG(mode):
        kind = "pipe" if stat.S_ISFIFO(mode) else "socket" if stat.S_ISSOCK(mode) else "device"
        raise WrongPlace(f"{str(path)!r} is a {kind}: name a file, which can be replaced.")


class Partial:
    """The new content of the file at `path`, which does not change until `commit`. A link stays a link.

    Raises BakeError if `path` exists and is not a file.
    """

    def __init__(self, path: Path):
        try:
            self.path = resolved(path)
        except OSError as error:
            raise BakeError(f"{str(path)!r} cannot be written: {reason(error)}.") from error
        self._temporary = TemporaryPath(self.path.with_suffix(path.suffix))

    @property
    def temporary(self) -> Path:
        """The path to write to, inside `writing`."""
        return self._temporary.path

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Make missing folders, and turn errors in the block into BakeError."""
        try:
            _NEW_FOLDERS.update(make_folder(self.path.parent))
            yield
        except OSError as error:
            raise BakeError(f"{str(self.path)!r} could not be written: {reason(error)}.") from error
        except RuntimeError as error:  # of Blender's writers
            why = reason(error)
            # If it cannot write all of a file, Blender reports the last error of the system, which may be of an earlier call.
            if why == _SAVE_FAILED or why.removeprefix(f"{_SAVE_FAILED}: ") in _SYSTEM_MESSAGES:
                why = "Blender could not write all of it, as on a full disk"
            raise BakeError(f"{str(self.path)!r} could not be written: {why}.") from error

    def commit(self) -> None:
        """Replace the file, in one step of the file system. Raises BakeError if that fails."""
        with self.writing():
            if before_replacing is not None:
                before_replacing(self.path, _made_for(self.path))
            _replace(self.path, self.temporary)
        _NEW_FOLDERS.difference_update(self.path.parents)
        self._temporary.remove()

    def discard(self) -> None:
        """Remove the temporary file, and the folders that were made for it. After `commit` this does nothing."""
        self._temporary.remove()
        _remove_made(self.path)


def put(temporary: str, path: str) -> None:
    """Replace the file at `path` by one that another process wrote for it, as Partial.commit. Raises BakeError."""
    with Partial(Path(path)).writing():
        _replace(Path(path), Path(temporary))


def _replace(path: Path, temporary: Path) -> None:
    """Replace a file. Raises OSError if that fails."""
    replaced = _REPLACED.get()
    if replaced is not None:
        replaced.keep(path)
    _copy_rights(path, temporary)
    os.replace(temporary, path)


class _Old(NamedTuple):
    """A file before it is replaced, and a copy of it or a link to it."""

    status: os.stat_result
    copy: TemporaryPath

    def is_at(self, path: Path) -> bool:
        """Whether the file was not replaced."""
        try:
            return os.path.samestat(self.status, path.stat())
        except FileNotFoundError:
            return False


class Replaced:
    """Keeps the old content of the files that commits replace. Use it in a `with` block."""

    def __init__(self):
        self._before: dict[Path, tuple[_Old | None, list[Path]]] = {}
        """By the path of a file: what was there, if anything, and the folders that were made for it."""

    def __enter__(self) -> "Replaced":
        self._around = _REPLACED.get()
        self._token = _REPLACED.set(self)
        return self

    def __exit__(self, *_) -> None:
        _REPLACED.reset(self._token)
        for old, _folders in self._before.values():
            if old is not None:
                old.copy.remove()

    def keep(self, path: Path) -> None:
        """Keep the content of `path`, which is about to be replaced. Raises OSError if that fails."""
        if self._around is not None:
            self._around.keep(path)
        if path in self._before:
            return
        old = _Old(path.stat(), _copy(path)) if path.exists() else None
        self._before[path] = old, _made_for(path)

    @contextmanager
    def restoring(self) -> Iterator[None]:
        """Restore all replaced files if the block raises or is closed."""
        is_done = False
        try:
            yield
            is_done = True
        finally:
            if not is_done:
                self.restore()

    def restore(self) -> None:
        """Restore all files. Then raise BakeError if this failed for a file, with the path of its old content."""
        lost = ""
        while self._before:
            path, (old, folders) = next(reversed(self._before.items()))
            try:
                if old is None:
                    path.unlink(missing_ok=True)
                else:
                    if not old.is_at(path):  # os.replace does nothing between two links to one file
                        os.replace(old.copy.path, path)
                    old.copy.remove()
            except OSError as error:
                lost = f"The old content of {str(path)!r} could not be restored: {reason(error)}"
                if old is not None:
                    lost += f"; it is in {str(old.copy.keep())!r}"
            _NEW_FOLDERS.update(folders)
            _remove_made(path)
            del self._before[path]  # last: a signal may restore all while this is going on
        if lost:
            raise BakeError(f"{lost}.")


_REPLACED: ContextVar[Replaced | None] = ContextVar("_REPLACED", default=None)
_UNFINISHED: list[Replaced] = []
"""Those of the blocks of `all_or_none` that have not ended, the innermost last."""


@contextmanager
def all_or_none(*, has_parts: bool = False) -> Iterator[None]:
    """Replace all files that are committed in the block, or none if it raises.

    has_parts: whether those of blocks in it that have ended stay if a second signal ends the process, as after the first one.
    """
    with Replaced() as replaced:
        if not has_parts:
            _UNFINISHED.append(replaced)
        try:
            with replaced.restoring():
                yield
        finally:
            if not has_parts:
                _UNFINISHED.remove(replaced)


def leave() -> None:
    """Restore what unfinished blocks have replaced, and remove all temporary files, before the process exits at once."""
    try:
        while _UNFINISHED:
            with suppress(BakeError):  # the old content stays beside the file
                _UNFINISHED.pop().restore()
    finally:
        remove_all()


def _copy_rights(path: Path, other: Path) -> None:
    """Give a file the mode and the group of the one at `path`, as far as the system allows it. Raises OSError."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return
    mode = status.st_mode & 0o777
    if hasattr(os, "chown") and os.stat(other).st_gid != status.st_gid:
        try:
            os.chown(other, -1, status.st_gid)
        except OSError:  # this user is not in the group: another one may do no more than all users
            mode &= 0o707 | (mode & 0o007) << 3
    with suppress(OSError):  # a file system without modes
        os.chmod(other, mode)


def _copy(path: Path) -> TemporaryPath:
    """A copy of a file, or a hard link to it. Raises OSError."""
    copy = TemporaryPath(path)
    try:
        try:
            os.link(path, copy.path)
        except OSError:  # a file system without hard links
            shutil.copy2(path, copy.path)
    except OSError:
        copy.remove()
        raise
    return copy


def make_folder(folder: Path) -> list[Path]:
    """Make a folder and the missing ones above it, of which there may be more than Python's own functions call themselves for.

    Returns those that were made, the outermost first. Raises OSError.
    """
    made = []
    for missing in reversed([parent for parent in (folder, *folder.parents) if not parent.exists()]):
        with suppress(FileExistsError):  # another process was faster
            missing.mkdir()
            made.append(missing)
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    return made


def _made_for(path: Path) -> list[Path]:
    """The folders above `path` that were made for files that are not yet written, the innermost first."""
    return [folder for folder in path.parents if folder in _NEW_FOLDERS]


def _remove_made(path: Path) -> None:
    """Remove the folders above `path` that were made for it and are still empty."""
    for folder in path.parents:
        if folder not in _NEW_FOLDERS:
            break
        try:
            folder.rmdir()
        except FileNotFoundError:
            pass
        except OSError:  # not empty
            break
        _NEW_FOLDERS.discard(folder)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path to write to. When the block ends without an error, the file there replaces `path`.

    Raises BakeError if that fails; then `path` has not changed.
    """
    partial = Partial(path)
    try:
        with partial.writing():
            yield partial.temporary
        partial.commit()
    finally:
        partial.discard()
