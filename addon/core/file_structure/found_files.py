# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the files that mesh files name, which may be spelled for another machine."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from .. import udim

MOST_BYTES_READ = 1 << 24
"""Bytes that are read to plan a bake: an .obj names its libraries before its points, and longer JSON contains its buffers."""
_DRIVE = re.compile("[A-Za-z]:/")


def folders(path: Path) -> list[Path]:
    """The folders that names in the file at `path` may start at: that of a link, which importers use, and of its target."""
    return list(dict.fromkeys((path.parent, Path(os.path.realpath(path)).parent)))


def cleaned(name: str) -> str:
    """`name` with slashes, without quotation marks."""
    return name.strip().strip("\"'").strip().replace("\\", "/")


def find_file(name: str, folders: Sequence[Path]) -> Path | None:
    """The file for the image `name`, as it stands in a mesh file; None if there is none.

    It may have quotation marks, backslashes, another letter case, or a path of another machine: then the file is looked for
    in `folders`, with fewer and fewer of the name's own folders. A name with <UDIM> stands for any of its tiles, and stays in
    the result. Empty files count as missing.
    """
    parts = _parts(name)
    if not parts:
        return None
    for first in range(len(parts)):
        # A path of this machine, and then each shorter end of it beside the mesh file.
        starts = [Path(parts[0])] if first == 0 and os.path.isabs(parts[0]) else folders
        rest = parts[1:] if starts is not folders else parts[first:]
        for start in starts if rest else ():
            path = _below(start, rest)
            if path is not None:
                return path
    return None


def expected_path(name: str, folder: Path) -> Path:
    """Where a missing image with this name should be: in `folder`, with the folders in its name unless they are absolute."""
    parts = _parts(name)
    is_absolute = len(parts) > 1 and parts[0].endswith("/")
    return folder.joinpath(*(parts[-1:] if is_absolute else parts))


def existing_tiles(path: Path) -> list[int]:
    """The numbers of the UDIM tiles that exist for a path with <UDIM>, in order."""
    return [tile for tile, file in udim.files(str(path), any_case=True).items() if is_file(Path(file))]


def tiled_path(path: Path) -> Path | None:
    """`path` with <UDIM> for the number at the end of its name, as in scan_1001.png; None if it has no such number."""
    stem = udim.tiled_name(path.stem)
    return path.with_name(stem + path.suffix) if stem else None


def _parts(name: str) -> list[str]:
    """The folders and the file in `name`; an absolute path starts with its root."""
    clean = cleaned(name)
    if "\0" in clean:
        return []
    parts = [part for part in clean.split("/") if part not in ("", ".")]
    if parts and clean.startswith("/"):
        return ["/", *parts]
    if len(parts) > 1 and _DRIVE.match(clean):
        return [f"{parts[0]}/", *parts[1:]]
    return parts


def _below(folder: Path, parts: Sequence[str]) -> Path | None:
    """The file at `parts` below `folder`, in any letter case."""
    *between, last = parts
    for part in between:
        inner = folder.parent if part == ".." else _entry(folder, part)
        if inner is None:
            return None
        folder = inner
    if udim.is_tiled(last):
        numbered = next((entry for entry in _entries(folder) if udim.tile_of(entry, last, any_case=True)), None)
        if numbered is None or not is_file(folder / numbered):
            return None
        return folder / udim.spelled(last, numbered)
    file = _entry(folder, last)
    return file if file is not None and is_file(file) else None


def _entry(folder: Path, name: str) -> Path | None:
    """What `name` is in `folder`: exactly, or else in another letter case."""
    exact = folder / name
    if os.path.exists(exact):
        return exact
    return next((folder / entry for entry in _entries(folder) if entry.casefold() == name.casefold()), None)


def _entries(folder: Path) -> list[str]:
    try:
        return sorted(os.listdir(folder))
    except OSError:
        return []


def is_file(path: Path) -> bool:
    """Whether there is a file that is not empty."""
    try:
        return path.is_file() and path.stat().st_size > 0
    except OSError:
        return False
