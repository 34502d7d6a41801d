# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that mesh files name, and where these are: libraries and images of .obj, buffers and images of glTF."""

import json
import mmap
import os
import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from .. import udim

MOST = 1 << 24
"""Bytes that are read to plan a bake: an .obj names its libraries before its points, and longer JSON contains its buffers."""
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


def of(name: str) -> Iterator[Path]:
    """The files that the mesh file at the path `name` refers to, of which some may not exist.

    None for formats that only their importers read, and for what cannot be read.
    """
    find = {".obj": _of_obj, ".gltf": _of_gltf, ".glb": _of_gltf}.get(os.path.splitext(name)[1].lower())
    path = Path(name)
    try:
        # Opening a pipe may wait for ever.
        names = list(find(path)) if find and path.is_file() else []
    except (OSError, ValueError, RecursionError, struct.error):  # the importer will report what is wrong
        return
    for folder in folders(path):
        yield from (folder / name for name in names)


def folders(path: Path) -> list[Path]:
    """The folders that names in the file at `path` may start at: that of a link, which importers use, and of its target."""
    return list(dict.fromkeys((path.parent, Path(os.path.realpath(path)).parent)))


def cleaned(name: str) -> str:
    """`name` with slashes, without quotation marks."""
    return name.strip().strip("\"'").strip().replace("\\", "/")


def libraries(path: Path, *, is_whole: bool = True) -> list[str]:
    """The names of the material libraries of the .obj at `path`, as it spells them. Raises OSError.

    Args:
        is_whole: Whether the whole file is read. Otherwise nothing is, unless a library is named before the first point, and
            then MOST bytes.
    """
    with path.open("rb") as file:
        if not os.fstat(file.fileno()).st_size:
            return []
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
            stop = len(text) if is_whole else min(MOST, len(text))
            point = None if is_whole else _POINT.search(text, 0, stop)
            if point and not _LIBRARY.search(text, 0, point.start()):
                return []
            found = _LIBRARY.finditer(text, 0, stop)
            return [_decoded(each[1]) for each in found if _begins_line(text, each.start())]


def _begins_line(text: mmap.mmap, at: int) -> bool:
    """Whether only spaces are before this place in its line."""
    return not text[text.rfind(b"\n", 0, at) + 1 : at].strip()


class ImageLine(NamedTuple):
    """A line of a .mtl that names an image: its first word, the options that Blender reads, and the name as it is spelled.

    whole: all that follows the first word, which is the name if its beginning only looks like options.
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


def _of_obj(path: Path) -> Iterator[str]:
    named = libraries(path, is_whole=False)
    several = [each for name in named if " " in name for each in name.split()]  # in one line
    own = f"{path.stem}.mtl"  # as in Blender's importer, it counts even if no line names it
    has_own = any((folder / own).is_file() for folder in folders(path))
    found = [*map(cleaned, (*named, *several)), *([own] if has_own else [])]
    for library in dict.fromkeys(found):
        yield library
        for folder in folders(path):
            lines: list[bytes] = []
            with suppress(OSError, ValueError):  # the library itself is named nevertheless
                if (file := folder / library).is_file() and file.stat().st_size <= MOST:
                    lines = lines_of(file)
            for image in filter(None, map(image_line, lines)):
                for name in dict.fromkeys(map(cleaned, (image.name, image.whole))):
                    yield os.path.join(os.path.dirname(library), name)


def compressions(path: Path) -> list[str]:
    """What the meshes of a glTF may be compressed with: "Draco", "meshopt". Empty for other files, and for damaged ones."""
    try:
        names = _list_in(_table_of(path), "extensionsUsed") if path.suffix.lower() in {".glb", ".gltf"} else []
    except (OSError, ValueError, RecursionError, struct.error):
        return []
    return [name for name, spelling in _COMPRESSIONS.items() if any(str(each).endswith(spelling) for each in names)]


_COMPRESSIONS = {"Draco": "_draco_mesh_compression", "meshopt": "_meshopt_compression"}
"""The names of extensions of glTF, without who made them."""


def _of_gltf(path: Path) -> Iterator[str]:
    yield from _named_in(_table_of(path))


def _table_of(path: Path) -> object:
    """The JSON of a glTF. Raises OSError, ValueError and struct.error for what is none, and for one that is too large."""
    with path.open("rb") as file:
        if path.suffix.lower() == ".glb":
            (length,) = struct.unpack_from("<12xI", file.read(20))  # of the first chunk, which is the JSON
        else:
            length = path.stat().st_size
        if length > MOST:
            return {}
        return json.loads(file.read(length))


def _list_in(table: object, key: str) -> list:
    found = table.get(key, []) if isinstance(table, dict) else []
    return found if isinstance(found, list) else []


def _named_in(table: object) -> Iterator[str]:
    """The files that the JSON of a glTF names."""
    for key in ("buffers", "images"):
        for entry in _list_in(table, key):
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str) and not uri.startswith("data:"):
                yield unquote(uri)


_DRIVE = re.compile("[A-Za-z]:/")


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
            found = _below(start, rest)
            if found is not None:
                return found
    return None


def expected_path(name: str, folder: Path) -> Path:
    """Where a missing image with this name should be: in `folder`, with the folders in its name unless they are absolute."""
    parts = _parts(name)
    is_absolute = len(parts) > 1 and parts[0].endswith("/")
    return folder.joinpath(*(parts[-1:] if is_absolute else parts))


def existing_tiles(path: Path) -> list[int]:
    """The numbers of the UDIM tiles that exist for a path with <UDIM>, in order."""
    return [tile for tile, file in udim.files(str(path), any_case=True).items() if _is_file(Path(file))]


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
        found = folder.parent if part == ".." else _entry(folder, part)
        if found is None:
            return None
        folder = found
    if udim.is_tiled(last):
        numbered = next((entry for entry in _entries(folder) if udim.tile_of(entry, last, any_case=True)), None)
        if numbered is None or not _is_file(folder / numbered):
            return None
        return folder / udim.spelled(last, numbered)
    found = _entry(folder, last)
    return found if found is not None and _is_file(found) else None


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


def _is_file(path: Path) -> bool:
    try:
        return path.is_file() and path.stat().st_size > 0
    except OSError:
        return False
