# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds clashes of files: a file that is written must not be read, or written twice, however its paths are spelled."""

import os
import re
import unicodedata
from collections.abc import Hashable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from ..core import udim
from ..core.errors import WrongPlace
from ..core.udim import TOKEN
from . import atomic_file

_TILE = re.compile(r"(?=([0-9]{4}))")
_UNFINISHED = re.compile(r"\.imprint\..*\.partial")
"""Names of temporary files, which Imprint may remove."""


@dataclass(frozen=True)
class _Use:
    what: str
    path: str
    by: Hashable


@dataclass
class _Table:
    """Uses by the keys of their paths."""

    exact: dict[Hashable, list[_Use]] = field(default_factory=dict)
    tiles: dict[Hashable, list[_Use]] = field(default_factory=dict)
    """Of paths with a tile's number, by the path with TOKEN in its place."""
    folders: dict[Hashable, list[_Use]] = field(default_factory=dict)
    """By the folders that will be made."""

    def add(self, keys: "_Keys", use: _Use) -> None:
        for table, own in ((self.exact, keys.exact), (self.tiles, keys.tiles), (self.folders, keys.folders)):
            for key in own:
                table.setdefault(key, []).append(use)

    def find(self, keys: "_Keys", spared: Hashable = None) -> _Use | None:
        """A use of the same file, except by `spared`. None if there is none."""
        found = chain(_all(self.exact, (*keys.exact, *keys.tiles)), _all(self.tiles, keys.exact))
        return next((use for use in found if spared is None or use.by != spared), None)

    def nested(self, keys: "_Keys") -> _Use | None:
        """A use that needs a folder where this file will be, or has a file where one of its folders will be."""
        return next(chain(_all(self.folders, keys.exact), _all(self.exact, keys.folders)), None)


def _all(table: dict[Hashable, list[_Use]], keys: Iterable[Hashable]) -> Iterator[_Use]:
    return (use for key in keys for use in table.get(key, ()))


@dataclass(frozen=True)
class _Keys:
    """The keys of a path. Two paths that can lead to one file have a key in common."""

    exact: tuple[Hashable, ...]
    tiles: tuple[Hashable, ...]
    folders: tuple[Hashable, ...]


class Places:
    """The files that are read and written. Add those that are read first. A path may have TOKEN for the numbers of tiles."""

    def __init__(self, advice: str = "give each a place of its own"):
        """advice: what to do about two files that would be one."""
        self._advice = advice
        self._reads, self._writes = _Table(), _Table()
        self._folders: dict[str, tuple[Hashable, tuple[str, ...]]] = {}

    def read(self, path: str, what: str, by: Hashable = None) -> None:
        """Add a file that is read. what: its name in messages. by: its user. Raises WrongPlace if it is written as well."""
        keys, use = self._keys(path), _Use(what, path, by)
        written = self._writes.find(keys)
        if written is not None:
            raise _over(written, use)
        self._reads.add(keys, use)

    def write(self, path: str, what: str, by: Hashable = None, *, may_replace: Hashable = None) -> None:
        """Add a file that is written. Raises WrongPlace if it is read or written as well, or is not a file.

        what, by: see `read`. may_replace: the `by` of reads that do not count, such as of the scene that is saved over itself.
        """
        with suppress(OSError):  # the bake reports it
            atomic_file.check_kind(path)
        keys, use = self._keys(path), _Use(what, path, by)
        read = self._reads.find(keys, may_replace)
        if read is not None:
            raise _over(use, read)
        written = self._writes.find(keys)
        if written is not None:
            raise WrongPlace(
                f"{_subject(use)} and {written.what} would both be {_both(path, written.path)}: {self._advice}."
            )
        nested = self._writes.nested(keys)
        if nested is not None:
            raise WrongPlace(f"{path!r} and {nested.path!r} cannot both be: one is a folder for the other.")
        self._writes.add(keys, use)

    def _keys(self, path: str) -> _Keys:
        """Raises WrongPlace for the names of temporary files."""
        path = str(Path(path).absolute())
        if os.path.islink(path) or os.path.basename(path) in {"", ".."}:
            path = os.path.realpath(path)
        if _UNFINISHED.match(os.path.basename(path)):
            raise WrongPlace(f"{path!r} is called as only Imprint's own unfinished files are: rename it.")
        parent, name = os.path.split(path)
        root, above = self._folder(parent)
        name = _folded(name)
        exact = [(root, *above, name)]
        if TOKEN not in path:
            try:
                found = os.stat(path)
                exact.append((found.st_dev, found.st_ino))  # the same for hard links
            except (OSError, ValueError):  # missing, or not a valid path
                pass
        tiles = [(root, *above, other) for other in _without_numbers(name)]
        folders = [(root, *above[: end + 1]) for end in range(len(above))]
        return _Keys(tuple(exact), tuple(tiles), tuple(folders))

    def _folder(self, path: str) -> tuple[Hashable, tuple[str, ...]]:
        """The folder at `path`: a key of the nearest one that exists, and the names of those below it."""
        if path not in self._folders:
            real = os.path.realpath(path)
            try:
                found = os.stat(real)
                self._folders[path] = (found.st_dev, found.st_ino), ()
            except (OSError, ValueError):
                parent, name = os.path.split(real)
                root, above = self._folder(parent) if name else (real, ())
                self._folders[path] = root, (*above, _folded(name))
        return self._folders[path]


def _folded(name: str) -> str:
    """A name as file systems compare it that ignore case and Unicode composition."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", name).casefold())


def _without_numbers(name: str) -> Iterator[str]:
    """A folded name with TOKEN in place of each number in it that can be a tile's, one at a time."""
    for found in _TILE.finditer(name):
        if int(found[1]) in udim.TILES:
            yield f"{name[: found.start(1)]}{_folded(TOKEN)}{name[found.end(1) :]}"


def _over(written: _Use, read: _Use) -> WrongPlace:
    return WrongPlace(
        f"{_subject(written)} would be written over {read.what}, {_both(read.path, written.path)}: give it a place of its own."
    )


def _subject(use: _Use) -> str:
    return use.what[:1].upper() + use.what[1:]


def _both(path: str, other: str) -> str:
    is_same = os.path.abspath(path) == os.path.abspath(other)
    return repr(path) if is_same else f"{path!r}, which is {other!r} as well"
