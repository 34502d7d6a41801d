# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects clashes of paths: a file must not be both read and written, or written twice, even if its paths differ."""

import os
import re
import unicodedata
from collections.abc import Hashable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from ...core import udim
from ...core.errors import WrongPlace
from ...core.udim import TOKEN
from . import atomic_file

_TILE = re.compile(r"(?=([0-9]{4}))")
_UNFINISHED = re.compile(r"\.imprint\..*\.partial")
"""Names of temporary files, which Imprint may remove."""


@dataclass(frozen=True)
class _Use:
    """A file that is read or written. title: for messages. by: see Places.read."""

    title: str
    path: str
    by: Hashable


@dataclass
class _Table:
    """Uses by the keys of their paths."""

    exact: dict[Hashable, list[_Use]] = field(default_factory=dict)
    tiles: dict[Hashable, list[_Use]] = field(default_factory=dict)
    """The uses of paths with a tile's number, by the path with TOKEN instead of the number."""
    folders: dict[Hashable, list[_Use]] = field(default_factory=dict)
    """The uses by the missing folders above them."""

    def add(self, keys: "_Keys", use: _Use) -> None:
        for table, table_keys in ((self.exact, keys.exact), (self.tiles, keys.tiles), (self.folders, keys.folders)):
            for key in table_keys:
                table.setdefault(key, []).append(use)

    def find(self, keys: "_Keys", ignored: Hashable = None) -> _Use | None:
        """A use of the same file, except uses by `ignored`. None if there is none."""
        found = chain(_all(self.exact, (*keys.exact, *keys.tiles)), _all(self.tiles, keys.exact))
        return next((use for use in found if ignored is None or use.by != ignored), None)

    def nested(self, keys: "_Keys") -> _Use | None:
        """A use that needs a folder at the path of this file, or a file at the path of one of its folders."""
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

    def __init__(self, advice: str = "give each its own path"):
        """advice: for two files that would be the same, the end of the message."""
        self._advice = advice
        self._reads, self._writes = _Table(), _Table()
        self._folders: dict[str, tuple[Hashable, tuple[str, ...]]] = {}

    def read(self, path: str, title: str, by: Hashable = None) -> None:
        """Add a file that is read. Raises WrongPlace if it is written as well.

        title: the file in messages. by: an identifier of the reader.
        """
        keys, use = self._keys(path), _Use(title, path, by)
        written = self._writes.find(keys)
        if written is not None:
            raise _over(written, use)
        self._reads.add(keys, use)

    def write(self, path: str, title: str, by: Hashable = None, *, may_replace: Hashable = None) -> None:
        """Add a file that is written. Raises WrongPlace if it is read or written as well, or is not a file.

        title, by: see `read`. may_replace: the `by` of reads that are ignored, for a scene that is saved over itself.
        """
        with suppress(OSError):  # the bake reports it
            atomic_file.check_kind(path)
        keys, use = self._keys(path), _Use(title, path, by)
        read = self._reads.find(keys, may_replace)
        if read is not None:
            raise _over(use, read)
        written = self._writes.find(keys)
        if written is not None:
            raise WrongPlace(
                f"{_subject(use)} and {written.title} would both be {_both(path, written.path)}: {self._advice}."
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
            raise WrongPlace(f"{path!r} has a name that Imprint uses for its temporary files: rename it.")
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
    """A name as it is compared by file systems that ignore case and Unicode composition."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", name).casefold())


def _without_numbers(name: str) -> Iterator[str]:
    """A folded name with TOKEN instead of a tile's number, once for each such number in it."""
    for found in _TILE.finditer(name):
        if int(found[1]) in udim.TILES:
            yield f"{name[: found.start(1)]}{_folded(TOKEN)}{name[found.end(1) :]}"


def _over(written: _Use, read: _Use) -> WrongPlace:
    return WrongPlace(
        f"{_subject(written)} would overwrite {read.title}, {_both(read.path, written.path)}: choose another path for it."
    )


def _subject(use: _Use) -> str:
    return use.title[:1].upper() + use.title[1:]


def _both(path: str, other: str) -> str:
    is_same = os.path.abspath(path) == os.path.abspath(other)
    return repr(path) if is_same else f"{path!r}, which is {other!r} as well"
