# SPDX-License-Identifier: GPL-3.0-or-later
"""The contents of files, by hashes that are found once, and one text for the same plain data: what a bake's result follows from
is compared by both, by --resume and by the signs of parts.
"""

import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np

from . import udim

BLOCK = 1 << 18
"""Bytes that are hashed between two checks."""


@dataclass(frozen=True)
class Content:
    """The content of the file at an absolute path. size and sha256 are None if there is none that can be read.

    For a path that udim.is_tiled, that of the files of all tiles together, and for a folder, that of all files in it.
    """

    path: str
    what: str = ""
    """What the file is, in words for messages."""
    size: int | None = None
    """In bytes."""
    sha256: str | None = None
    stamp: str = ""
    """Changes when the file does, on this machine."""

    def facts(self) -> dict[str, Any]:
        """Plain data for a report."""
        return {"path": self.path, "bytes": self.size, "sha256": self.sha256, "what": self.what}

    def is_same(self, other: "Content") -> bool:
        """Whether both have the same content, wherever they are."""
        return (self.size, self.sha256) == (other.size, other.sha256)


class Contents:
    """Hashes files, each once as long as it does not change while this object exists."""

    def __init__(self, check: Callable[[], None] = lambda: None):
        """check: called again and again while a file is read. What it raises ends that."""
        self._check = check
        self._known: dict[str, str] = {}
        """Hashes by stamps. No file keeps them: other machines have other clocks and numbers of files."""

    def of(self, path: str, what: str = "") -> Content:
        """The content of a file, which is read if needed."""
        path = os.path.abspath(path)
        if (several := files(path)) != [path]:
            return self._of_several(path, what, several)
        try:
            with open(path, "rb", opener=_at_once) as file:
                state = os.fstat(file.fileno())
                if not stat.S_ISREG(state.st_mode):
                    return Content(path, what)
                stamp = _local_stamp(state)
                if stamp not in self._known:
                    self._known[stamp] = self._hash(file)
        except (OSError, ValueError):  # missing, a folder, or not a valid path
            return Content(path, what)
        return Content(path, what, state.st_size, self._known[stamp], stamp)

    def learn(self, path: str, sha256: str) -> None:
        """Take the word of another process for the content of a file. Raises OSError if there is none."""
        self._known[_local_stamp(os.stat(path))] = sha256

    def checking(self, check: Callable[[], None]) -> "Contents":
        """These contents with another `check`."""
        contents = Contents(check)
        contents._known = self._known
        return contents

    def all_of(self, paths: Iterable[tuple[str, str]]) -> list[Content]:
        """The contents of files, each once: paths, and what they are."""
        titles: dict[str, str] = {}
        for path, what in paths:
            titles.setdefault(os.path.abspath(path), what)
        return [self.of(path, what) for path, what in titles.items()]

    def _hash(self, file: BufferedReader) -> str:
        digest, block = hashlib.sha256(), memoryview(bytearray(BLOCK))
        while count := file.readinto(block):
            self._check()
            digest.update(block[:count])
        return digest.hexdigest()

    def _of_several(self, path: str, what: str, paths: Sequence[str]) -> Content:
        contents = [self.of(each) for each in paths]
        if not contents:
            return Content(path, what)
        start = path if os.path.isdir(path) else os.path.dirname(path)
        lines = [f"{each.sha256} {Path(os.path.relpath(each.path, start)).as_posix()}" for each in contents]
        digest = hashlib.sha256(os.fsencode("\n".join(lines))).hexdigest()
        return Content(path, what, size_of(path), digest, stamp_of(path))


def _at_once(path: str, flags: int) -> int:
    """Open a file. Opening a pipe does not wait for its other end."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def size_of(path: str) -> int | None:
    """The size of the files that `path` stands for, without reading them; None if there is none."""
    states = _states(path)
    return sum(each.st_size for each in states) if states else None


def stamp_of(path: str) -> str:
    """The stamp of Content, without reading the file. Empty if there is none."""
    return " ".join(map(_local_stamp, _states(path)))


def files(path: str) -> list[str]:
    """The files that a path stands for: those of all tiles, all below a folder, or the one at the path."""
    if udim.is_tiled(path):
        return list(udim.files(path).values())
    if not os.path.isdir(path):
        return [path]
    return sorted(os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names)


def _states(path: str) -> list[os.stat_result]:
    """What the system says of the files that `path` stands for."""
    try:
        return [os.stat(each) for each in files(path)]
    except (OSError, ValueError):
        return []


def _local_stamp(state: os.stat_result) -> str:
    # A program can set the time of a change back, but not that of the last change of anything, which Windows does not have.
    return f"{state.st_dev}:{state.st_ino}:{state.st_size}:{state.st_mtime_ns}:{state.st_ctime_ns}"


def canonical(value: Any) -> str:
    """Plain data as JSON, the same text for the same data: numbers of numpy, as scripts pass them, are those of Python."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=_plain)


def _plain(value: Any) -> int | float | bool:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} is no plain data.")


def short(value: Any) -> str:
    """A short hash of plain data."""
    return hashlib.blake2b(canonical(value).encode(), digest_size=8).hexdigest()
