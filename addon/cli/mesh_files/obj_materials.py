# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the material libraries (.mtl) of an .obj, and finds the images that they name."""

import mmap
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from . import page_search

_LIBRARY = re.compile(rb"mtllib[ \t]+([^\r\n]+)")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_IMAGE_WORDS = ("map_", "bump", "disp", "decal", "refl", "norm")
"""The beginnings of lines that name an image."""
_COLORS = ("map_kd", "map_ke", "map_ks", "map_ka")
"""The lines whose images are colors. Others are numbers or normals, which are not stored as sRGB."""
_OPTIONS = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2}
"""The most arguments of options before an image's name, which are numbers. All others have one."""
_READ = ("-s", "-o", "-bm", "-type")
"""The options that Blender's importer uses. It takes those that it does not know for the beginning of the name."""


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
        folders = list(dict.fromkeys((file.parent, path.parent, Path(os.path.realpath(path)).parent)))
        for line in file.read_bytes().removeprefix(b"\xef\xbb\xbf").splitlines():
            lines.append(_with_placeholder(line, folders, known))
    placeholders = dict(known.values())
    return Materials(b"\n".join([*lines, b""]) if lines else b"", placeholders)


def missing_libraries(path: Path) -> list[str]:
    """The names of the libraries that the .obj at `path` needs and that do not exist. Raises OSError."""
    return _libraries(path)[1]


def _libraries(path: Path) -> tuple[list[Path], list[str]]:
    """The libraries of an .obj, and the names of those that do not exist."""
    folders = list(dict.fromkeys((path.parent, Path(os.path.realpath(path)).parent)))
    found, missing = [], []
    for name in _named_libraries(path):
        file = page_search.find(name, folders)
        if file is None and " " in name:  # several names in one line
            several = [page_search.find(each, folders) for each in name.split()]
            if all(several):
                found += several
                continue
        if file is not None:
            found.append(file)
        else:
            missing.append(name)
    # As in Blender's importer, one with the name of the .obj counts even if no line names it.
    own = page_search.find(f"{path.stem}.mtl", folders)
    return list(dict.fromkeys([*found, *([own] if own else [])])), [] if own else missing


def _named_libraries(path: Path) -> Iterator[str]:
    with path.open("rb") as file:
        if not os.fstat(file.fileno()).st_size:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
            for match in _LIBRARY.finditer(text):
                line = text[text.rfind(b"\n", 0, match.start()) + 1 : match.start()]
                if not line.strip():
                    yield _decoded(match[1])


def _with_placeholder(line: bytes, folders: list[Path], known: dict[tuple, tuple[str, Page]]) -> bytes:
    """A line of a library, with a placeholder for the image that it names. known: the placeholders by image."""
    word, _, rest = _decoded(line.replace(b"\t", b" ")).partition(" ")
    if not rest.strip() or not word.lower().startswith(_IMAGE_WORDS):
        return line.strip()
    options, name = _split(rest)
    if not page_search.cleaned(name).strip("./"):  # it names a folder
        return b""
    path = page_search.find(name, folders)
    if path is None and name != rest.strip():  # what looks like options may be the beginning of the name
        path = page_search.find(rest, folders)
        options, name = ("", rest.strip()) if path else (options, name)
    page = Page(name, path, word.lower() in _COLORS)
    key = (path or page_search.cleaned(name), page.is_color)
    if key not in known:
        known[key] = f"imprint-page-{len(known)}{Path(page_search.cleaned(name)).suffix}", page
    return " ".join(filter(None, (word, options, known[key][0]))).encode()


def _split(text: str) -> tuple[str, str]:
    """The options that Blender reads, and the name, in what follows the first word of a line."""
    words, first, read = [word for word in text.split(" ") if word], 0, []
    while first < len(words) - 1 and words[first].startswith("-") and len(words[first]) > 1:
        begin, option = first, words[first].lower()
        first, last = first + 1, min(first + 1 + _OPTIONS.get(option, 1), len(words) - 1)
        while first < last and (option not in _OPTIONS or _NUMBER.fullmatch(words[first])):
            first += 1
        read += words[begin:first] if option in _READ else []
    rest = text.strip()
    for word in words[:first]:
        rest = rest[len(word) :].lstrip()
    return " ".join(read), rest


def _decoded(text: bytes) -> str:
    """Text of a file: UTF-8, or what Windows writes in western languages."""
    text = text.strip()
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("cp1252", errors="replace")
