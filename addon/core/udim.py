# SPDX-License-Identifier: GPL-3.0-or-later
"""UDIM tiles: their numbers, their places in UV space, and their spelling in lists and paths."""

import functools
import os
import re
from collections.abc import Iterable, Iterator

from .errors import BakeError

COLUMNS, ROWS = 10, 100
"""The number of tiles along u and along v."""
FIRST = 1001
"""The tile from 0 to 1 in u and v: the whole map, without UDIM."""
TILES = range(FIRST, FIRST + COLUMNS * ROWS)
"""The tiles that Blender supports."""
MOST_BAKED = 100
"""The largest number of tiles of a bake without a list of tiles: a single stray UV can add hundreds."""
TOKEN = "<UDIM>"
"""The placeholder for a tile's number in a path."""
UV_TILE = "<UVTILE>"
"""Blender's other placeholder for a tile in a path: its column and row, from 1."""
_NUMBER = "1(?!000)[0-9]{3}|2000"
_COLUMN_ROW = "u(?:10|[1-9])_v(?:100|[1-9][0-9]?)"
_ANYWHERE = re.compile(f"(?=({_NUMBER}))")
"""The numbers of two tiles can share digits."""

UvToClip = tuple[float, float, float, float]
"""A transform from UV space to clip space: the scales along u and v, then the offsets. clip = uv * scale + offset."""


def number(column: int, row: int) -> int:
    """The number of the tile that begins at u = `column` and v = `row`."""
    return FIRST + column + COLUMNS * row


def place(tile: int) -> tuple[int, int]:
    """The u and v where a tile begins."""
    row, column = divmod(tile - FIRST, COLUMNS)
    return column, row


def uv_to_clip(
    tile: int = FIRST,
    size: tuple[int, int] = (1, 1),
    start: tuple[float, float] = (0.0, 0.0),
    count: tuple[int, int] | None = None,
) -> UvToClip:
    """The transform to clip space that shows a part of a tile.

    size: of the tile in texels, along u and v. start, count: the part in texels; by default, the whole tile.
    """
    along_u, along_v = zip(place(tile), size, start, count or size, strict=True)
    scale_u, offset_u = _to_clip(*along_u)
    scale_v, offset_v = _to_clip(*along_v)
    return scale_u, scale_v, offset_u, offset_v


def _to_clip(lowest: int, size: int, start: float, count: int) -> tuple[float, float]:
    """Scale and offset along one axis."""
    return 2.0 * size / count, -2.0 * (start + lowest * size) / count - 1.0


def parse(text: str) -> tuple[int, ...]:
    """The tiles in a list such as "1001, 1003". Raises BakeError if it has anything but whole numbers."""
    words = text.replace(",", " ").split()
    # Python refuses to read thousands of digits.
    if not all(word.isdecimal() and len(word) < 100 for word in words):
        raise BakeError(f"{text!r} is not a list of UDIM tiles, such as 1001, 1003.")
    return tuple(dict.fromkeys(map(int, words)))


def check(tiles: Iterable[int]) -> None:
    """Raise BakeError if a number does not belong to a tile."""
    for tile in tiles:
        if tile not in TILES:
            raise BakeError(f"{tile} is not a UDIM tile: their numbers are {TILES[0]} to {TILES[-1]}.")


def fill(path: str, tile: int | str) -> str:
    """`path` with the tile's number in place of TOKEN."""
    return path.replace(TOKEN, str(tile))


def fill_all(path: str, tile: int) -> str:
    """`path` with a tile in place of TOKEN and of UV_TILE."""
    column, row = place(tile)
    return fill(path, tile).replace(UV_TILE, f"u{column + 1}_v{row + 1}")


def is_tiled(path: str) -> bool:
    """Whether the file's name in `path` stands for the files of tiles."""
    name = os.path.basename(path)
    return TOKEN in name or UV_TILE in name


def tile_of(name: str, tiled: str, *, any_case: bool = False) -> int:
    """The tile of the file `name`, where the names of tiles are as `tiled`; 0 if it is none. any_case: letters may differ in
    case."""
    match = _pattern(tiled, any_case).fullmatch(name)
    if match is None:
        return 0
    parts = match.groupdict()
    tiles = {int(parts["tile"])} if parts.get("tile") else set()
    if parts.get("place"):
        column, row = parts["place"][1:].lower().split("_v")
        tiles.add(number(int(column) - 1, int(row) - 1))
    return tiles.pop() if len(tiles) == 1 else 0


def spelled(tiled: str, name: str) -> str:
    """`tiled` with the letter case of `name`, the file of one of its tiles."""
    parts = re.split(f"({TOKEN}|{UV_TILE})", tiled)
    match = re.fullmatch("(.*)".join(f"({re.escape(part)})" for part in parts[::2]), name, re.IGNORECASE)
    return "".join(match[2 * at + 1] + token for at, token in enumerate([*parts[1::2], ""])) if match else tiled


def files(path: str, *, any_case: bool = False) -> dict[int, str]:
    """The files that exist for a path whose name has TOKEN or UV_TILE, by their tiles, in the order of these.

    any_case: as in `tile_of`.
    """
    folder, tiled = os.path.split(path)
    try:
        names = sorted(os.listdir(folder or os.curdir))
    except (OSError, ValueError):
        return {}
    paths = {tile: os.path.join(folder, name) for name in names if (tile := tile_of(name, tiled, any_case=any_case))}
    return dict(sorted(paths.items()))


def numbers_in(text: str) -> Iterator[tuple[int, int]]:
    """Where numbers of tiles may be in a name: starts and ends."""
    return (match.span(1) for match in _ANYWHERE.finditer(text))


def tiled_name(stem: str) -> str:
    """`stem`, the name of a file without its ending, with TOKEN for the number of a tile at its end; empty without one."""
    filled, count = re.subn(f"(?<![0-9])({_NUMBER})$", TOKEN, stem)
    return filled if count else ""


@functools.lru_cache(maxsize=256)
def _pattern(tiled: str, any_case: bool) -> re.Pattern:
    parts, seen = [], set()
    for text in re.split(f"({TOKEN}|{UV_TILE})", tiled):
        key = {TOKEN: "tile", UV_TILE: "place"}.get(text)
        if key is None:
            parts.append(re.escape(text))
        elif key in seen:
            parts.append(f"(?P={key})")
        else:
            seen.add(key)
            parts.append(f"(?P<{key}>{_NUMBER if text == TOKEN else _COLUMN_ROW})")
    return re.compile("".join(parts), re.IGNORECASE if any_case else 0)
