# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that bakes read: whether they exist, and which others they refer to. Each is read once for all bakes of a call."""

import os
import stat

from ...core import udim
from ...core.file_structure import mesh_references
from ...output.files.atomic_file import reason


class InputFiles:
    """Files of a run, asked for by their paths."""

    def __init__(self):
        self._problems: dict[str, str] = {}
        self._references: dict[str, tuple[str, ...]] = {}

    def problem(self, path: str) -> str:
        """Why a file cannot be read, as a sentence, or ""."""
        if path not in self._problems:
            self._problems[path] = _problem_of_tiles(path) if udim.is_tiled(path) else _problem(path)
        return self._problems[path]

    def references(self, path: str) -> tuple[str, ...]:
        """The files that a mesh file refers to, as mesh_references.of finds them."""
        if path not in self._references:
            self._references[path] = tuple(map(str, mesh_references.of(path)))
        return self._references[path]


def _problem_of_tiles(path: str) -> str:
    """As `_problem`, of the files of all tiles."""
    tiles = list(map(_problem, udim.files(path).values()))
    return next(filter(None, tiles), "") if tiles else f"There is no file {os.path.abspath(path)!r}."


def _problem(path: str) -> str:
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return f"There is no file {os.path.abspath(path)!r}."
    except (OSError, ValueError) as error:
        return f"{path!r} cannot be read: {reason(error)}."
    if not stat.S_ISREG(found.st_mode):
        return f"There is no file {os.path.abspath(path)!r}."  # as the bake says
    return "" if os.access(path, os.R_OK) else f"{path!r} cannot be read: Permission denied."
