# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that bakes read: whether they are there, and how large they are. The system is asked once for each."""

import glob
import os
import stat

from ...core import udim
from ...output.files.atomic_file import reason


class InputFiles:
    """Files of a run, asked for by their paths."""

    def __init__(self):
        self._known: dict[str, tuple[int, str]] = {}
        """Bytes, and what is wrong."""

    def size(self, path: str) -> int:
        """The bytes of a file; 0 if it cannot be read."""
        return self._probe(path)[0]

    def problem(self, path: str) -> str:
        """Why a file cannot be read, as a sentence, or ""."""
        return self._probe(path)[1]

    def _probe(self, path: str) -> tuple[int, str]:
        if path not in self._known:
            self._known[path] = _probe_tiles(path) if udim.TOKEN in path else _probe(path)
        return self._known[path]


def _probe_tiles(path: str) -> tuple[int, str]:
    """As `_probe`, of the files of all tiles."""
    folder, name = os.path.split(path)
    found = glob.glob(glob.escape(name).replace(udim.TOKEN, "[0-9]" * 4), root_dir=folder)
    tiles = [_probe(os.path.join(folder, each)) for each in found]
    if not tiles:
        return 0, f"There is no file {os.path.abspath(path)!r}."
    return sum(size for size, _ in tiles), next((problem for _, problem in tiles if problem), "")


def _probe(path: str) -> tuple[int, str]:
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return 0, f"There is no file {os.path.abspath(path)!r}."
    except OSError as error:
        return 0, f"{path!r} cannot be read: {reason(error)}."
    if not stat.S_ISREG(found.st_mode):
        return 0, f"There is no file {os.path.abspath(path)!r}."  # as the bake says
    if not found.st_mode & stat.S_IROTH and not os.access(path, os.R_OK):
        return 0, f"{path!r} cannot be read: Permission denied."
    return found.st_size, ""
