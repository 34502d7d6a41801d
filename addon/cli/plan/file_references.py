# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a file uses: materials, buffers and textures of a mesh file, libraries of a .blend."""

import json
import os
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote

MOST = 1 << 24
"""Bytes of a file that are read: an .obj names its materials before its points, and longer JSON contains its buffers."""
_HEAD_OF_4, _HEAD_OF_5 = re.compile(rb"BLENDER[_-][vV]\d{3}"), re.compile(rb"BLENDER17-01v\d{4}")
"""The first bytes of a .blend of Blender before 5.0, by the width of pointers and the order of bytes, and from 5.0 on."""
_LIBRARY = re.compile(rb"[^\0]*[/\\][^\0]*\.blend(?=\0)")
"""A path in the block of a library, which contains its bare name as well."""


def of(path: Path) -> Iterator[Path]:
    """The files that the mesh file at `path` names; none for formats that only their importers read."""
    find = {".obj": _of_obj, ".gltf": _of_gltf, ".glb": _of_glb}.get(path.suffix.lower())
    if find is None:
        return
    try:
        names = list(find(path))
    except (OSError, ValueError, RecursionError, struct.error):  # the importer will report what is wrong
        return
    for folder in _folders(path):
        yield from (folder / name for name in names)


def libraries(path: Path) -> list[Path]:
    """The libraries that the .blend at `path` links, found without opening it in Blender. This reads all its blocks."""
    # Parts of Blender.
    import zstandard
    from blend_render_info import RawBlendFileReader

    try:
        with RawBlendFileReader(path) as file:
            # Names are in the bytes of the system, as paths are.
            found = [os.fsdecode(name) for block in _blocks(file, b"LI") for name in _LIBRARY.findall(block)]
    except (OSError, EOFError, ValueError, struct.error, zstandard.ZstdError):
        return []  # opening the file will report what is wrong
    return [path.parent / name.removeprefix("//") for name in found]


def _blocks(file: BinaryIO, code: bytes) -> Iterator[bytes]:
    """The content of the blocks of this kind."""
    layout, size_at = _head_of_blocks(file)
    while (head := layout.unpack(file.read(layout.size)))[0] != b"ENDB":
        size = head[size_at]
        if head[0].rstrip(b"\0") == code:
            yield file.read(size)
        else:
            file.seek(size, os.SEEK_CUR)


def _head_of_blocks(file: BinaryIO) -> tuple[struct.Struct, int]:
    """The layout of a block's head, and which of its values is the size. Goes to the first block.

    Raises ValueError for a file of another kind. Blender 4.5 has no module for the format of 5.0, which it opens.
    """
    head = file.read(12)
    if _HEAD_OF_4.fullmatch(head):
        return struct.Struct((">" if head[8:9] == b"V" else "<") + ("4siIii" if head[7:8] == b"_" else "4siQii")), 1
    if _HEAD_OF_5.fullmatch(head + file.read(5)):
        return struct.Struct("<4siQqq"), 3
    raise ValueError("not a .blend")


def _of_obj(path: Path) -> Iterator[str]:
    for library in _said(path, ("mtllib",)):
        yield library
        for folder in _folders(path):
            try:
                maps = list(_said(folder / library, ("map_", "bump", "disp", "decal", "refl", "norm")))
            except (OSError, ValueError):
                continue
            # Options may stand before the name, which may hold spaces.
            yield from (
                os.path.join(os.path.dirname(library), name) for value in maps for name in {value, value.split()[-1]}
            )


def _folders(path: Path) -> set[Path]:
    """The folders that names in the file at `path` may start at: that of a link, which importers use, and of its target."""
    return {path.parent, Path(os.path.realpath(path)).parent}


def _said(path: Path, words: tuple[str, ...]) -> Iterator[str]:
    """The text after one of these words at the start of a line."""
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
