# SPDX-License-Identifier: GPL-3.0-or-later
"""UDIM tiles: their numbers, their places in UV space, and their spelling in lists and paths."""

from collections.abc import Iterable

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
