# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the material libraries (.mtl) of an .obj, and finds the images that they name."""

from dataclasses import dataclass, field
from pathlib import Path

from ...core.file_structure import mesh_references

_COLORS = ("map_kd", "map_ke", "map_ks", "map_ka")
"""The lines whose images are colors. Others are numbers or normals, which are not stored as sRGB."""


@dataclass(frozen=True)
class Page:
    """An image that materials name. name: as they spell it. path: its file, which may contain <UDIM>; None if it is missing.
    is_color: whether it stores colors, rather than numbers."""

    name: str
    path: Path | None
    is_color: bool


@dataclass(frozen=True)
class Materials:
    """The materials of an .obj.

    content: of one library with all of them, in which `placeholders` stand for the images.
    """

    content: bytes = b""
    placeholders: dict[str, Page] = field(default_factory=dict)


def read(path: Path) -> Materials:
    """The materials of the .obj at `path`. Raises OSError."""
    lines, known = [], {}
    for file in _libraries(path)[0]:
        folders = list(dict.fromkeys((file.parent, *mesh_references.folders(path))))
        for line in mesh_references.lines_of(file):
            lines.append(_with_placeholder(line, folders, known))
    placeholders = dict(known.values())
    return Materials(b"\n".join([*lines, b""]) if lines else b"", placeholders)


def missing_libraries(path: Path) -> list[str]:
    """The names of the libraries that the .obj at `path` needs and that do not exist. Raises OSError."""
    return _libraries(path)[1]


def _libraries(path: Path) -> tuple[list[Path], list[str]]:
    """The libraries of an .obj, and the names of those that do not exist."""
    folders = mesh_references.folders(path)
    found, missing = [], []
    for name in mesh_references.libraries(path):
        file = mesh_references.find_file(name, folders)
        if file is None and " " in name:  # several names in one line
            several = [mesh_references.find_file(each, folders) for each in name.split()]
            if all(several):
                found += several
                continue
        if file is not None:
            found.append(file)
        else:
            missing.append(name)
    # As in Blender's importer, one with the name of the .obj counts even if no line names it.
    own = mesh_references.find_file(f"{path.stem}.mtl", folders)
    return list(dict.fromkeys([*found, *([own] if own else [])])), [] if own else missing


def _with_placeholder(line: bytes, folders: list[Path], known: dict[tuple, tuple[str, Page]]) -> bytes:
    """A line of a library, with a placeholder for the image that it names. known: the placeholders by image."""
    image = mesh_references.image_line(line)
    if image is None:
        return line.strip()
    word, options, name, whole = image
    clean = mesh_references.cleaned
    if not clean(name).strip("./"):  # it names a folder
        return b""
    path = mesh_references.find_file(name, folders)
    if path is None and name != whole and (path := mesh_references.find_file(whole, folders)):
        options, name = "", whole
    page = Page(name, path, word.lower() in _COLORS)
    key = (path or clean(name), page.is_color)
    if key not in known:
        known[key] = f"imprint-page-{len(known)}{Path(clean(name)).suffix}", page
    return " ".join(filter(None, (word, options, known[key][0]))).encode()
