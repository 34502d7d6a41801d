# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects clashes of paths: a file must not be both read and written, or written twice, even if its paths differ."""

import errno
import os
import re
import unicodedata
from collections.abc import Hashable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from ..core import udim
from ..core.errors import WrongPlace
from ..core.udim import TOKEN
from . import atomic_file

_UNFINISHED = re.compile(r"\.imprint\..*\.partial")
"""Names of temporary files, which Imprint may remove."""


class _Use(NamedTuple):
    """A file that is read or written.

    Attributes:
        title: For messages.
        by: See Places.read.
    """

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
        for key in keys.exact:
            self.exact.setdefault(key, []).append(use)
        for key in keys.tiles:
            self.tiles.setdefault(key, []).append(use)
        for key in keys.folders:
            self.folders.setdefault(key, []).append(use)

    def find(self, keys: "_Keys", ignored: Hashable = None) -> _Use | None:
        """A use of the same file, except uses by `ignored`. None if there is none."""
        return next((use for use in self.find_all(keys) if ignored is None or use.by != ignored), None)

    def find_all(self, keys: "_Keys") -> Iterator[_Use]:
        """All uses of the same file."""
        if not self.exact:
            return
        for table, table_keys in ((self.exact, keys.exact), (self.exact, keys.tiles), (self.tiles, keys.exact)):
            for key in table_keys:
                yield from table.get(key, ())

    def nested(self, keys: "_Keys") -> _Use | None:
        """A use that needs a folder at the path of this file, or a file at the path of one of its folders."""
        for table, table_keys in ((self.folders, keys.exact), (self.exact, keys.folders)):
            for key in table_keys:
                if uses := table.get(key):
                    return uses[0]
        return None


def identity(path: str) -> Hashable:
    """What is the same for all paths and hard links of a file. Raises OSError or ValueError if there is none."""
    status = os.stat(path)
    return status.st_dev, status.st_ino


class _Keys(NamedTuple):
    """The keys of a path. Two paths that can lead to one file have a key in common."""

    exact: tuple[Hashable, ...]
    tiles: tuple[Hashable, ...]
    folders: tuple[Hashable, ...]


class _Folder(NamedTuple):
    """A folder."""

    there: Hashable
    """What is the same for all paths of the folder, or of the lowest one above it that exists."""
    below: str = ""
    """The folded names of the missing folders from there on, each with a slash."""
    missing: tuple[Hashable, ...] = ()
    """The keys of the missing folders among it and those above."""

    def key(self, name: str) -> Hashable:
        """The key of what has this folded name in it."""
        return self.there, self.below + name


class Places:
    """The files that are read and written. Add those that are read first. A path may have TOKEN for the numbers of tiles."""

    def __init__(self, advice: str = "give each its own path"):
        """advice: for two files that would be the same, the end of the message."""
        self._advice = advice
        self._reads, self._writes = _Table(), _Table()
        self._folders: dict[str, _Folder] = {}

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
        keys, use = self._keys(path, is_written=True), _Use(title, path, by)
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

    def written_by(self, path: str) -> list[tuple[str, Hashable]]:
        """The writes of a file: their titles, and by whom each is."""
        keys = self._keys(path)
        return [(use.title, use.by) for use in self._writes.find_all(keys)]

    def _keys(self, given: str, *, is_written: bool = False) -> _Keys:
        """Raises WrongPlace for the names of temporary files, and for what cannot be written."""
        path = str(Path(given).absolute())
        parent, name = os.path.split(path)
        if is_written:
            with suppress(OSError):  # the bake reports it
                atomic_file.check_kind(given)
        if os.path.islink(path) or name in {"", ".."}:
            path = os.path.realpath(path)
            parent, name = os.path.split(path)
        if _UNFINISHED.match(name):
            raise WrongPlace(f"{path!r} has a name that Imprint uses for its temporary files: rename it.")
        folder = self._folder(parent)
        on_disk = None
        if TOKEN not in path:
            with suppress(OSError, ValueError):  # it is missing, or no valid path
                on_disk = identity(path)
        folded = _folded(name)
        own = folder.key(folded)
        exact = (own,) if on_disk is None else (own, on_disk)
        tiles = tuple([folder.key(other) for other in _without_numbers(folded)])
        return _Keys(exact, tiles, folder.missing)

    def _folder(self, path: str) -> _Folder:
        if path not in self._folders:
            missing, ancestor = [], os.path.realpath(path)
            while ancestor not in self._folders:
                try:
                    self._folders[ancestor] = _Folder(identity(ancestor))
                except (OSError, ValueError) as error:
                    parent, name = os.path.split(ancestor)
                    if not name or getattr(error, "errno", None) == errno.ENAMETOOLONG:
                        self._folders[ancestor] = _Folder(ancestor)
                        break
                    missing.append((ancestor, _folded(name)))
                    ancestor = parent
            folder = self._folders[ancestor]
            for ancestor, name in reversed(missing):
                folder = _Folder(folder.there, f"{folder.below}{name}/", (*folder.missing, folder.key(name)))
                self._folders[ancestor] = folder
            self._folders[path] = folder
        return self._folders[path]


def _folded(name: str) -> str:
    """A name as it is compared by file systems that ignore case and Unicode composition."""
    if name.isascii():
        return name.lower()
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", name).casefold())


def _without_numbers(name: str) -> Iterator[str]:
    """A folded name with TOKEN instead of a tile's number, once for each such number in it."""
    for start, end in udim.numbers_in(name):
        yield f"{name[:start]}{_folded(TOKEN)}{name[end:]}"


def _over(written: _Use, read: _Use) -> WrongPlace:
    return WrongPlace(
        f"{_subject(written)} would overwrite {read.title}, {_both(read.path, written.path)}: choose another path for it."
    )


def _subject(use: _Use) -> str:
    return use.title[:1].upper() + use.title[1:]


def _both(path: str, other: str) -> str:
    is_same = os.path.abspath(path) == os.path.abspath(other)
    return repr(path) if is_same else f"{path!r}, which is {other!r} as well"
