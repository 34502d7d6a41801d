# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a mesh file names: materials, buffers and textures."""

import json
import os
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

MOST = 1 << 24
"""Bytes of a file that are read: an .obj names its materials before its points, and longer JSON contains its buffers."""
_FIRST_PIECE, _PIECE = 1 << 12, 1 << 16
_POINT = re.compile(rb"^[ \t]*v[ \t]", re.MULTILINE)


def of(name: str) -> Iterator[Path]:
    """The files that the mesh file at the path `name` refers to; none for formats that only their importers read."""
    find = {".obj": _of_obj, ".gltf": _of_gltf, ".glb": _of_glb}.get(os.path.splitext(name)[1].lower())
    if find is None:
        return
    path = Path(name)
    try:
        names = list(find(path))
    except (OSError, ValueError, RecursionError, struct.error):  # the importer will report what is wrong
        return
    for folder in _folders(path):
        yield from (folder / name for name in names)


def _may_name_library(path: Path) -> bool:
    """Whether an .obj may name a file of materials, which it does before its points. Raises OSError."""
    if not path.is_file():  # opening a pipe may wait for ever
        return False
    start, size = b"", _FIRST_PIECE
    with path.open("rb", buffering=0) as file:
        while len(start) < MOST and (piece := file.read(size)):
            seen, start, size = max(0, len(start) - _PIECE), start + piece, _PIECE
            if _POINT.search(start, seen):
                break
    return b"mtllib" in start.lower()


def _of_obj(path: Path) -> Iterator[str]:
    for library in _said(path, ("mtllib",)) if _may_name_library(path) else ():
        yield library
        for folder in _folders(path):
            try:
                maps = list(_said(folder / library, ("map_", "bump", "disp", "decal", "refl", "norm")))
            except (OSError, ValueError):
                continue
            for value in maps:  # options may stand before the name, which may hold spaces
                names = dict.fromkeys((value, value.split()[-1]))
                yield from (os.path.join(os.path.dirname(library), name) for name in names)


def _folders(path: Path) -> list[Path]:
    """The folders that names in the file at `path` may start at: that of a link, which importers use, and of its target."""
    return list(dict.fromkeys((path.parent, Path(os.path.realpath(path)).parent)))


def _said(path: Path, words: tuple[str, ...]) -> Iterator[str]:
    """The text after one of these words at the start of a line."""
    if not path.is_file():  # opening a pipe may wait for ever
        return
    with path.open("rb") as file:
        text = file.read(MOST).decode(errors="surrogateescape")
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        if rest.strip() and word.lower().startswith(words):
            yield rest.strip()


def _of_gltf(path: Path) -> Iterator[str]:
    if path.stat().st_size <= MOST:
        yield from _named_in(path.read_bytes())


def _of_glb(path: Path) -> Iterator[str]:
    with path.open("rb") as file:
        (length,) = struct.unpack_from("<12xI", file.read(20))  # of the first chunk, which is the JSON
        if length <= MOST:
            yield from _named_in(file.read(length))


def _named_in(content: bytes) -> Iterator[str]:
    """The files that the JSON of a glTF names."""
    table = json.loads(content)
    for key in ("buffers", "images"):
        found = table.get(key, []) if isinstance(table, dict) else []
        for entry in found if isinstance(found, list) else []:
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str) and not uri.startswith("data:"):
                yield unquote(uri)
