# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs and writes files in threads, while the caller draws the next map."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core import threads
from .atomic_file import Partial

MOST_UNFINISHED = 2
"""The files that may be in memory at once, packed or not."""
PREPARED_BYTES = 1 << 18
"""Bytes of the rows that are prepared at a time: few enough for the cache, and enough that threads seldom wait for
each other."""


@dataclass(frozen=True)
class Content:
    """A file to write.

    Attributes:
        parts: Functions that can run in threads, in any order. Each packs a part of the file.
        write: Writes the file at a path that exists, from the results of `parts` in their order.
    """

    parts: Sequence[Callable[[], Any]]
    write: Callable[[Path, Iterator[Any]], None]


class WriteQueue:
    """Writes files one after the other, packed by all processors. Use it in a `with` block, or call `close` at the end.

    A thread that packs needs Python's lock only between its parts: Blender holds it while it draws.
    """

    def __init__(self):
        self._packing = ThreadPoolExecutor(threads.processors(), "imprint-pack")
        self._writing = ThreadPoolExecutor(1, "imprint-write")
        self._unfinished: deque[Future] = deque()

    def __enter__(self) -> "WriteQueue":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def add(self, make: Callable[[], Content], partial: Partial) -> Future:
        """Write what `make` returns to the temporary file of `partial`, which must be reserved.

        Waits while MOST_UNFINISHED files are not finished, and then calls `make`. The result of the future is None; it raises
        BakeError if the file could not be written. This raises the same for a file that was added before.
        """
        while self._unfinished and (len(self._unfinished) >= MOST_UNFINISHED or self._unfinished[0].done()):
            self._unfinished.popleft().result()
        content = make()
        parts = deque(self._packing.submit(part) for part in content.parts)
        job = self._writing.submit(_write, content, parts, partial)
        self._unfinished.append(job)
        return job

    def close(self) -> None:
        """Stop. Files that are not finished stay as they are. Can be called more than once."""
        for each in (self._packing, self._writing):
            each.shutdown(cancel_futures=True)


def _write(content: Content, parts: deque[Future], partial: Partial) -> None:
    with partial.writing():
        content.write(partial.temporary, _results(parts))


def _results(parts: deque[Future]) -> Iterator[Any]:
    """The results of `parts` in their order. Each can be freed when the next one is asked for."""
    while parts:
        yield parts.popleft().result()


def for_rows(height: int, row_bytes: int, work: Callable[[Iterator[slice]], None]) -> None:
    """Call `work` with iterators of slices of rows that cover `height`, as threads.for_shares does."""
    threads.for_shares(height, max(1, PREPARED_BYTES // row_bytes), work)


def top_first(texels: np.ndarray, has_alpha: bool, *, is_gray: bool = False) -> np.ndarray:
    """`texels` (height, width, 4) with the highest row first, as files have them, with or without alpha. No copy.

    is_gray: whether red stands for all colors, as a single channel.
    """
    if is_gray:
        return texels[::-1, :, ::3] if has_alpha else texels[::-1, :, :1]
    return texels[::-1, :, : 4 if has_alpha else 3]
