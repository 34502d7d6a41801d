# SPDX-License-Identifier: GPL-3.0-or-later
"""The content of a file that threads pack, and the division of its rows into blocks and pieces."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from ...core import threads

BLOCK = 1 << 18
"""Bytes of the rows that are prepared at a time: few enough for the cache, and enough that threads seldom wait for
each other."""
LEAST_PIECE, MOST_PIECE = 1 << 18, 1 << 24
"""The least and the most bytes that a thread deflates at a time."""


@dataclass(frozen=True)
class Content:
    """A file to write.

    parts: functions that can run in threads, in any order: each packs a part of the file. write: puts the results, in the
    order of `parts`, into an open file.
    """

    parts: Sequence[Callable[[], Any]]
    write: Callable[[BinaryIO, Iterator[Any]], None]


def for_rows(height: int, row_bytes: int, work: Callable[[Iterator[slice]], None]) -> None:
    """Call `work` with iterators of slices of rows that cover `height`, as threads.for_shares does."""
    threads.for_shares(height, max(1, BLOCK // row_bytes), work)


def pieces(height: int, row_bytes: int, whole: int = 1) -> list[slice]:
    """Slices that cover `height` rows: one for each processor, unless they are too small or too large.

    whole: rows that stay together. The number of rows of a slice is a multiple of it, but for the last one.
    """
    wanted = -(-height * row_bytes // threads.processors())
    wanted = min(max(wanted, LEAST_PIECE), MOST_PIECE)
    count = whole * max(1, wanted // (row_bytes * whole))
    return threads.blocks(height, count)


def top_first(texels: np.ndarray, has_alpha: bool) -> np.ndarray:
    """`texels` (height, width, 4) with the highest row first, as files have them, with or without alpha. No copy."""
    return texels[::-1, :, : 4 if has_alpha else 3]
