# SPDX-License-Identifier: GPL-3.0-or-later
"""The material libraries and images that .obj files name, and where these are."""

import mmap
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from .found_files import MOST_BYTES_READ, cleaned, find_file, folders

_POINT = re.compile(rb"^[ \t]*v[ \t]", re.MULTILINE)
_LIBRARY = re.compile(rb"mtllib[ \t]+([^\r\n]+)")
"""Found ten times as fast as one that begins a line, which is looked at afterwards."""
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_IMAGE_WORDS = ("map_", "bump", "disp", "decal", "refl", "norm")
"""The beginnings of lines that name an image."""
_OPTIONS = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2}
"""The most arguments of options before an image's name, which are numbers. All others have one."""
_READ = ("-s", "-o", "-bm", "-type")
"""The options that Blender's importer uses. It takes those that it does not know for the beginning of the name."""


_COLORS = ("map_kd", "map_ke", "map_ks", "map_ka")
"""The lines whose images are colors. Others are numbers or normals, which are not stored as sRGB."""


_SAYS_SHADING = re.compile(rb"^s[ \t]", re.MULTILINE)


def libraries(path: Path, *, is_whole: bool = True) -> list[str]:
    """The names of the material libraries of the .obj at `path`, as it spells them. Raises OSError.

    Args:
        is_whole: Whether the whole file is read. Otherwise nothing is, unless a library is named before the first point, and
            then MOST_BYTES_READ bytes.
    """
    with path.open("rb") as file:
        if not os.fstat(file.fileno()).st_size:
            return []
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
            stop = len(text) if is_whole else min(MOST_BYTES_READ, len(text))
            point = None if is_whole else _POINT.search(text, 0, stop)
            if point and not _LIBRARY.search(text, 0, point.start()):
                return []
            matches = _LIBRARY.finditer(text, 0, stop)
            return [_decoded(each[1]) for each in matches if _begins_line(text, each.start())]


def _begins_line(text: mmap.mmap, at: int) -> bool:
    """Whether only spaces are before this place in its line."""
    return not text[text.rfind(b"\n", 0, at) + 1 : at].strip()


class ImageLine(NamedTuple):
    """A line of a .mtl that names an image: its first word, the options that Blender reads, and the name as it is spelled.

    Attributes:
        whole: All that follows the first word, which is the name if its beginning only looks like options.
    """

    word: str
    options: str
    name: str
    whole: str


def image_line(line: bytes) -> ImageLine | None:
    """What a line of a .mtl says of an image; None for other lines."""
    word, _, rest = _decoded(line.replace(b"\t", b" ")).partition(" ")
    if not rest.strip() or not word.lower().startswith(_IMAGE_WORDS):
        return None
    return ImageLine(word, *_split(rest), rest.strip())


def lines_of(library: Path) -> list[bytes]:
    """The lines of a .mtl. Raises OSError."""
    return library.read_bytes().removeprefix(b"\xef\xbb\xbf").splitlines()


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


def references(path: Path) -> Iterator[str]:
    """The libraries and images that the .obj at `path` names, as far as they are before its points. Raises OSError."""
    named = libraries(path, is_whole=False)
    several = [each for name in named if " " in name for each in name.split()]  # in one line
    own = f"{path.stem}.mtl"  # as in Blender's importer, it counts even if no line names it
    has_own = any((folder / own).is_file() for folder in folders(path))
    names = [*map(cleaned, (*named, *several)), *([own] if has_own else [])]
    for library in dict.fromkeys(names):
        yield library
        for folder in folders(path):
            lines: list[bytes] = []
            with suppress(OSError, ValueError):  # the library itself is named nevertheless
                if (file := folder / library).is_file() and file.stat().st_size <= MOST_BYTES_READ:
                    lines = lines_of(file)
            for image in filter(None, map(image_line, lines)):
                for name in dict.fromkeys(map(cleaned, (image.name, image.whole))):
                    yield os.path.join(os.path.dirname(library), name)


@dataclass(frozen=True)
class NamedImage:
    """An image that materials name.

    Attributes:
        name: As they spell it.
        path: Its file, which may contain <UDIM>; None if it is missing.
        is_color: Whether it stores colors, rather than numbers.
    """

    name: str
    path: Path | None
    is_color: bool


@dataclass(frozen=True)
class Materials:
    """The materials of an .obj.

    Attributes:
        content: Of one library with all of them, in which `placeholders` stand for the images.
    """

    content: bytes = b""
    placeholders: dict[str, NamedImage] = field(default_factory=dict)


def read_materials(path: Path) -> Materials:
    """The materials of the .obj at `path`. Raises OSError."""
    lines, known = [], {}
    for file in _libraries(path)[0]:
        places = list(dict.fromkeys((file.parent, *folders(path))))
        lines += [_with_placeholder(line, places, known) for line in lines_of(file)]
    placeholders = dict(known.values())
    return Materials(b"\n".join([*lines, b""]) if lines else b"", placeholders)


def missing_libraries(path: Path) -> list[str]:
    """The names of the libraries that the .obj at `path` needs and that do not exist. Raises OSError."""
    return _libraries(path)[1]


def _libraries(path: Path) -> tuple[list[Path], list[str]]:
    """The libraries of an .obj, and the names of those that do not exist."""
    places = folders(path)
    there, missing = [], []
    for name in libraries(path):
        files = [find_file(name, places)]
        if files == [None]:  # several names may be in one line
            files = [find_file(each, places) for each in name.split()]
        if files and all(files):
            there += files
        else:
            missing.append(name)
    # As in Blender's importer, one with the name of the .obj counts even if no line names it.
    own = find_file(f"{path.stem}.mtl", places)
    return list(dict.fromkeys([*there, *([own] if own else [])])), [] if own else missing


def _with_placeholder(line: bytes, places: list[Path], known: dict[tuple, tuple[str, NamedImage]]) -> bytes:
    """A line of a library, with a placeholder for the image that it names. known: the placeholders by image."""
    image = image_line(line)
    if image is None:
        return line.strip()
    word, options, name, whole = image
    if not cleaned(name).strip("./"):  # it names a folder
        return b""
    path = find_file(name, places)
    if path is None and name != whole and (path := find_file(whole, places)):
        options, name = "", whole
    use = NamedImage(name, path, word.lower() in _COLORS)
    key = (path or cleaned(name), use.is_color)
    if key not in known:
        known[key] = f"imprint-image-{len(known)}{Path(cleaned(name)).suffix}", use
    return " ".join(filter(None, (word, options, known[key][0]))).encode()


def says_shading(path: Path) -> bool:
    """Whether the .obj at `path` says which faces are smooth. Raises OSError."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return _SAYS_SHADING.search(text) is not None
