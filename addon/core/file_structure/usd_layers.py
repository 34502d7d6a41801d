# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a USD file names, without USD: layers that it is put together from, and the assets of these, such as images.

Text is searched for paths between @. A binary file keeps all its paths in one table of words (OpenUSD, Crate file format).
"""

import mmap
import os
import posixpath
import re
import struct
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import NamedTuple

from .. import udim
from . import usd_archives

ENDINGS = (".usd", ".usda", ".usdc", ".usdz")
_LAYERS = (*ENDINGS, ".abc", ".mtlx", ".sdf")
"""Endings of files that can be layers."""
_BINARY = b"PXR-USDC"
PARTS = re.compile(
    rb'"""(?:[^\\]|\\.)*?"""|"(?:[^"\\\n]|\\.)*"|'
    rb"'''(?:[^\\]|\\.)*?'''|'(?:[^'\\\n]|\\.)*'|#[^\n]*|@@@(.+?)@@@|@([^@\n]*)@|\[[^][{}\"'@#]*\]|[][(){}]",
    re.DOTALL,
)
"""Parts of a file of text: texts, comments, paths, arrays of numbers, which can be long, and other brackets."""
_COMPUTED = b"templateAssetPath"
"""The word for files of which a frame's number is a part."""
_VARIANTS = b"variantSet"
_MOST_LAYERS = 10_000
_MOST_WORDS = 1 << 26
"""Bytes of the words of a binary file: a hostile one may name any number."""
_RAW_TABLE = 4
"""Before this version, words are not compressed."""


class Named(NamedTuple):
    """What a USD file names.

    Attributes:
        layers, assets: Paths in the file system, of which some may not exist.
        unknown: Why there can be others, as a clause; empty if there are none.
        has_variants: Whether some of them may be for variants that are not chosen.
    """

    layers: tuple[str, ...] = ()
    assets: tuple[str, ...] = ()
    unknown: str = ""
    has_variants: bool = False


def is_usd(path: str) -> bool:
    """Whether a file is a USD file by its name."""
    return path.lower().endswith(ENDINGS)


def named(path: str) -> Named:
    """What the USD file at `path` names, and the layers that it names, and so on. Files that cannot be read name nothing."""
    layers: dict[str, None] = {}
    assets: dict[str, None] = {}
    unknown, has_variants, left = "", False, [path] if is_usd(path) else []
    while left and len(layers) < _MOST_LAYERS:
        own = _named_in(left.pop())
        unknown, has_variants = unknown or own.unknown, has_variants or own.has_variants
        left += [each for each in own.layers if each not in layers and each != path]
        layers.update(dict.fromkeys(each for each in own.layers if each != path))
        assets.update(dict.fromkeys(own.assets))
    return Named(tuple(layers), tuple(assets), unknown, has_variants)


def _named_in(path: str) -> Named:
    """What one file names itself."""
    try:
        if not os.path.isfile(path):  # opening a pipe may wait for ever
            return Named()
        state = os.stat(path)
        return _read(path, (state.st_size, state.st_mtime_ns, state.st_ctime_ns, state.st_ino))
    except (OSError, ValueError, IndexError, struct.error):  # what opens it will report the error
        return Named()


@lru_cache(maxsize=1000)
def _read(path: str, _state: tuple[int, ...]) -> Named:
    """As `_named_in`. _state: changes with the file. Raises OSError, ValueError, IndexError, struct.error."""
    if not is_usd(path) or not os.path.getsize(path):
        return Named()
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if path.lower().endswith(usd_archives.ENDING):
            return _of_archive(path, content)
        return _of_layer(path, content, 0, len(content), lambda name: os.path.join(os.path.dirname(path), name))


def _of_archive(path: str, content: mmap.mmap) -> Named:
    """What the layers of an archive name and it does not contain. Such a path in the archive stands in brackets behind its own,
    and is no file."""
    members = usd_archives.members(content)
    # By their last parts: the words of a binary layer are also the paths that it had before it was packed. Of a layer that is
    # not where it is looked for, the importer tells.
    names = {posixpath.basename(name) for each in members for name in (each.name, _tiled(each.name))}

    def beside(member: usd_archives.Member, name: str) -> str:
        if posixpath.basename(name) in names:
            return ""
        inside = posixpath.normpath(posixpath.join(posixpath.dirname(member.name), name))
        return name if os.path.isabs(name) else f"{path}[{inside}]"

    layers = [member for member in members if member.is_layer]
    of_layers = [_of_layer(path, content, each.start, each.stop, partial(beside, each)) for each in layers]
    assets = [name for each in of_layers for name in each.assets]
    return Named(
        tuple(dict.fromkeys(name for each in of_layers for name in each.layers)),
        tuple({re.split(r"[/[]", name)[-1]: name for name in reversed(assets)}.values()),
        next(filter(None, (each.unknown for each in of_layers)), ""),
        any(each.has_variants for each in of_layers),
    )


def _tiled(name: str) -> str:
    """A name in an archive with <UDIM> for its number; empty if it has none."""
    stem, ending = posixpath.splitext(name)
    tiled = udim.tiled_name(stem)
    return tiled + ending if tiled else ""


def _of_layer(path: str, content: mmap.mmap, start: int, stop: int, place: Callable[[str], str]) -> Named:
    """What a layer names. start, stop: where it is in `content`. place: the path for a name, or "" for what needs none."""
    if content[start : start + len(_BINARY)] == _BINARY:
        words = _words(content, start).split(b"\0")
        names = [word for word in words if b"." in word or b"`" in word]
        is_computed, has_variants = (word in words for word in (_COMPUTED, _VARIANTS))
    else:
        names = [match[1] or match[2] for match in PARTS.finditer(content, start, stop) if match[1] or match[2]]
        is_computed, has_variants = (content.find(word, start, stop) >= 0 for word in (_COMPUTED, _VARIANTS))
    layers, assets = [], []
    for name in names:
        text = name.decode(errors="surrogateescape")
        file = text.partition(":SDF_FORMAT_ARGS:")[0].partition("[")[0]
        is_layer = file.lower().endswith(_LAYERS)
        if text[:1] == text[-1:] == "`" or (is_layer and "://" in text):
            is_computed = True
        elif whole_path := place(file):
            (layers if is_layer else assets).append(os.path.normpath(whole_path))
    why = f"{path!r} names files in a way that cannot be followed" if is_computed else ""
    return Named(tuple(dict.fromkeys(layers)), tuple(dict.fromkeys(assets)), why, has_variants)


def _words(content: mmap.mmap, base: int) -> bytes:
    """The words of a binary file, with a zero after each. base: where it begins. Raises as `_read`."""
    (table,) = struct.unpack_from("<q", content, base + 16)
    (count,) = struct.unpack_from("<Q", content, base + table)
    for row in range(min(count, 64)):
        name, start, _ = struct.unpack_from("<16sqq", content, base + table + 8 + 32 * row)
        if name.rstrip(b"\0") == b"TOKENS":
            break
    else:
        return b""
    start += base
    if content[base + 8] == 0 and content[base + 9] < _RAW_TABLE:
        (size,) = struct.unpack_from("<8xQ", content, start)
        return content[start + 16 : start + 16 + size]
    size, compressed = struct.unpack_from("<8xQQ", content, start)
    if size > _MOST_WORDS or compressed > _MOST_WORDS:
        raise ValueError("too many words")
    return b"".join(_decompressed(content[start + 24 : start + 24 + compressed]))


def _decompressed(data: bytes) -> Iterator[bytes]:
    """The content of USD's compressed data: one block of LZ4, or several, each after its size."""
    count, at = data[0], 1
    if not count:
        yield _lz4(data[1:])
    for _ in range(count):
        (size,) = struct.unpack_from("<i", data, at)
        yield _lz4(data[at + 4 : at + 4 + size])
        at += 4 + size


def _lz4(data: bytes) -> bytes:
    """A block of LZ4 (LZ4 Block Format Description, 2020). Raises IndexError or ValueError."""
    out, at = bytearray(), 0

    def length(total: int) -> int:
        """A length of which the first four bits are known."""
        nonlocal at
        more = 255 if total == 15 else 0
        while more == 255:
            more = data[at]
            at += 1
            total += more
        return total

    while at < len(data):
        token = data[at]
        at += 1
        literals = length(token >> 4)
        out += data[at : at + literals]
        at += literals
        if at >= len(data):
            break
        back = data[at] | data[at + 1] << 8
        at += 2
        count = length(token & 15) + 4
        if not 0 < back <= len(out) or len(out) + count > _MOST_WORDS:
            raise ValueError("no block of LZ4")
        start = len(out) - back
        piece = bytes(out[start : start + count])
        out += (piece * (count // len(piece) + 1))[:count]  # it may overlap with what it makes
    return bytes(out)
