# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are there whole or not at all."""

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from ..core.errors import BakeError, WrongPlace
from .partial_files import Beside, try_in

_MADE: set[Path] = set()
"""Folders that were made for files of which none is there yet."""


def check_writable(path: Path) -> None:
    """Raise BakeError unless a file can be put at `path`; folders that are missing above it can be made then."""
    try:
        target = place(path)
        folder = next(folder for folder in target.parents if os.path.lexists(folder))
        # Ask the file system: permission bits say nothing about a full or read-only disk.
        try_in(folder)
    except OSError as error:
        raise BakeError(f"{str(path)!r} cannot be written: {reason(error)}.") from error


def place(path: Path) -> Path:
    """Where a file at `path` is to be put: links are followed, so that they stay. Raises as `check_kind`."""
    check_kind(path)
    return Path(os.path.realpath(path))


def check_kind(path: str | Path) -> None:
    """Raise WrongPlace for what is there and no file, and OSError where nothing can be."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        raise WrongPlace(f"{str(path)!r} is a folder: name a file.")
    if not stat.S_ISREG(mode):
        kind = "pipe" if stat.S_ISFIFO(mode) else "socket" if stat.S_ISSOCK(mode) else "device"
        raise WrongPlace(f"{str(path)!r} is a {kind}: name a file, which can be replaced.")


def reason(error: OSError | RuntimeError) -> str:
    """What a failed operation of the system or of Blender says for itself, in one line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    # Blender raises several reports at once, the first of them the cause.
    return str(error).strip().partition("\n")[0].removeprefix("Error: ").rstrip(".")


class Partial:
    """What is to take the place of the file at `path`, which stays as it is until `commit`. A link keeps its place.

    Raises BakeError for what is no file.
    """

    def __init__(self, path: Path):
        try:
            self.path = place(path)
        except OSError as error:
            raise BakeError(f"{str(path)!r} cannot be written: {reason(error)}.") from error
        self._beside = Beside(self.path.with_suffix(path.suffix))

    @property
    def here(self) -> Path:
        """The path to write to, inside `told`."""
        return self._beside.here

    @contextmanager
    def told(self) -> Iterator[None]:
        """Make the folder if it is missing, and turn what goes wrong in the block into a BakeError."""
        try:
            _make(self.path.parent)
            yield
        except (OSError, RuntimeError) as error:  # Blender's writers raise RuntimeError
            raise BakeError(f"{str(self.path)!r} could not be written: {reason(error)}.") from error

    def commit(self) -> None:
        """Put what was written into its place, in one step of the file system. Raises BakeError if that cannot be."""
        with self.told():
            replaced = _REPLACED.get()
            if replaced is not None:
                replaced.keep(self.path)
            os.replace(self.here, self.path)
        _MADE.difference_update(self.path.parents)
        self._beside.remove()

    def discard(self) -> None:
        """Leave nothing behind, nor a folder that was made for it; after `commit` there is nothing."""
        self._beside.remove()
        _remove_made(self.path)


class Replaced:
    """In a `with` statement: remembers the files that commits replace, until it ends."""

    def __init__(self):
        self._before: dict[Path, tuple[Beside | None, list[Path]]] = {}
        """By the path of a file: where its old content is, if it was there, and the folders that were made for it."""

    def __enter__(self) -> "Replaced":
        self._around = _REPLACED.get()
        self._token = _REPLACED.set(self)
        return self

    def __exit__(self, *_) -> None:
        _REPLACED.reset(self._token)
        for copy, _folders in self._before.values():
            if copy is not None:
                copy.remove()

    def keep(self, path: Path) -> None:
        """Hold what is at `path`, about to be replaced. Raises OSError if that cannot be."""
        if self._around is not None:
            self._around.keep(path)
        if path in self._before:
            return
        copy = _copy(path) if path.exists() else None
        self._before[path] = copy, [folder for folder in path.parents if folder in _MADE]

    @contextmanager
    def restoring(self) -> Iterator[None]:
        """Put back all that was replaced, unless the block ends well."""
        is_done = False
        try:
            yield
            is_done = True
        finally:
            if not is_done:
                self._restore()

    def _restore(self) -> None:
        """Raises BakeError, when all is done that can be, for a file whose old content had to stay beside it."""
        lost = ""
        for path, (copy, folders) in self._before.items():
            try:
                if copy is not None and path.exists() and copy.here.samefile(path):
                    copy.remove()  # it was about to be replaced and was not; and a file replaces no link to itself
                elif copy is not None:
                    os.replace(copy.here, path)
                    copy.remove()
                else:
                    path.unlink(missing_ok=True)
            except OSError as error:
                lost = f"{str(path)!r} could not be put back: {reason(error)}"
                if copy is not None:
                    lost += f"; it is in {str(copy.keep())!r}"
            _MADE.update(folders)
            _remove_made(path)
        self._before.clear()
        if lost:
            raise BakeError(f"{lost}.")


_REPLACED: ContextVar[Replaced | None] = ContextVar("_REPLACED", default=None)


@contextmanager
def together() -> Iterator[None]:
    """Files that are put into their places in this block are put there all or none."""
    with Replaced() as replaced, replaced.restoring():
        yield


def _copy(path: Path) -> Beside:
    """The content of a file under another name. Raises OSError."""
    copy = Beside(path)
    try:
        try:
            os.link(path, copy.here)
        except OSError:  # a file system without hard links
            shutil.copy2(path, copy.here)
    except OSError:
        copy.remove()
        raise
    return copy


def _make(folder: Path) -> None:
    """Make a folder, and those above it that are missing."""
    for missing in reversed([place for place in (folder, *folder.parents) if not place.exists()]):
        with suppress(FileExistsError):  # another process was faster
            missing.mkdir()
            _MADE.add(missing)


def _remove_made(path: Path) -> None:
    """Remove the folders above `path` that were made for it and stayed empty."""
    for folder in path.parents:
        if folder not in _MADE:
            break
        try:
            folder.rmdir()
        except FileNotFoundError:
            pass
        except OSError:  # somebody uses it
            break
        _MADE.discard(folder)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to; what was written takes the place of `path` when the block ends well.

    Raises BakeError if it cannot; then `path` is as it was.
    """
    partial = Partial(path)
    try:
        with partial.told():
            yield partial.here
        partial.commit()
    finally:
        partial.discard()
