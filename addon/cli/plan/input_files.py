# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that bakes read: whether they are there, and which they are. Each is looked at once."""

import os
import stat
from typing import NamedTuple

from ...core import udim
from ...output.files.atomic_file import reason
from . import file_references

_FLAGS = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
"""Opening a pipe for these does not wait for its other end."""


class _Found(NamedTuple):
    problem: str
    identity: tuple[int, int] | None = None
    """As path_clashes.identity."""
    has_library: bool | None = None
    """Whether it is an .obj that may name a file of materials; None if that was not asked."""


class InputFiles:
    """Files of a run, asked for by their paths."""

    def __init__(self):
        self._known: dict[str, _Found] = {}
        self._references: dict[str, tuple[str, ...]] = {}

    def problem(self, path: str) -> str:
        """Why a file cannot be read, as a sentence, or ""."""
        return self._look(path).problem

    def identity(self, path: str) -> tuple[int, int]:
        """As path_clashes.identity."""
        found = self._look_into(path).identity
        if found is None:
            raise FileNotFoundError
        return found

    def references(self, path: str) -> tuple[str, ...]:
        """The files that a mesh file refers to, as file_references.of finds them."""
        found = self._references.get(path)
        if found is None:
            is_plain = _is_obj(path) and not self._look_into(path).has_library
            found = self._references[path] = () if is_plain else tuple(map(str, file_references.of(path)))
        return found

    def _look_into(self, path: str) -> _Found:
        """Opens an .obj. What only asks for problems does not: the path may be one that an untrusted call must not read."""
        known = self._known.get(path)
        if known is None or known.has_library is None:
            opened = _look_into(path) if _is_obj(path) else None
            known = self._known[path] = opened or self._look(path)._replace(has_library=False)
        return known

    def _look(self, path: str) -> _Found:
        known = self._known.get(path)
        if known is None:
            known = self._known[path] = _look_at_tiles(path) if udim.is_tiled(path) else _look(path)
        return known


def _is_obj(path: str) -> bool:
    return path.lower().endswith(".obj")


def _look_at_tiles(path: str) -> _Found:
    """As `_look`, of the files of all tiles."""
    tiles = [_look(each) for each in udim.files(path).values()]
    if not tiles:
        return _Found(f"There is no file {os.path.abspath(path)!r}.")
    return _Found(next((tile.problem for tile in tiles if tile.problem), ""))


def _look(path: str) -> _Found:
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return _Found(f"There is no file {os.path.abspath(path)!r}.")
    except (OSError, ValueError) as error:
        return _Found(f"{path!r} cannot be read: {reason(error)}.")
    identity = found.st_dev, found.st_ino
    if not stat.S_ISREG(found.st_mode):
        return _Found(f"There is no file {os.path.abspath(path)!r}.", identity)  # as the bake says
    if not found.st_mode & stat.S_IROTH and not os.access(path, os.R_OK):
        return _Found(f"{path!r} cannot be read: Permission denied.", identity)
    return _Found("", identity)


def _look_into(path: str) -> _Found | None:
    """What is known of an .obj that can be opened. None for others, and for what is no file."""
    try:
        descriptor = os.open(path, _FLAGS)
    except (OSError, ValueError):
        return None
    try:
        found = os.fstat(descriptor)
        if stat.S_ISREG(found.st_mode):
            return _Found("", (found.st_dev, found.st_ino), file_references.has_library(descriptor))
        return None
    finally:
        os.close(descriptor)
