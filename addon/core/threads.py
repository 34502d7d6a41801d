# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs numpy work on blocks of long arrays in threads. numpy releases Python's lock, so all cores work."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

Part = TypeVar("Part")
Result = TypeVar("Result")

BLOCK = 2**16
"""Elements per block, so that intermediate values fit in a processor's cache."""


def map_parallel(work: Callable[[Part], Result], parts: Sequence[Part]) -> list[Result]:
    """Call `work` with each of `parts` in threads. Returns the results in the order of `parts`."""
    if len(parts) < 2:
        return list(map(work, parts))
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(threads.map(work, parts))


def for_blocks(count: int, work: Callable[[slice], None], block: int | None = None) -> None:
    """Call `work` with slices of `block`, or else BLOCK, that together cover `count` elements, each once and in no order."""
    map_parallel(work, blocks(count, block or BLOCK))


def for_shares(count: int, block: int, work: Callable[[Iterator[slice]], None]) -> None:
    """Call `work` once in each thread, with an iterator of slices of `block` that it shares with the others.

    Together they cover `count` elements, each once. For work that keeps its arrays for the next slice.
    """
    found = blocks(count, block)
    shared = iter(found)  # `next` of a list's iterator is one step for all threads
    map_parallel(work, [shared] * min(os.cpu_count() or 1, len(found)))


def blocks(count: int, block: int) -> list[slice]:
    """Slices of `block` that cover `count` elements in order; the last one may be shorter."""
    return [slice(start, min(start + block, count)) for start in range(0, count, block)]


def take(rows: np.ndarray, places: np.ndarray) -> np.ndarray:
    """rows[places], for places of any shape."""
    found = np.empty((*places.shape, *rows.shape[1:]), rows.dtype)

    def take_part(part: slice) -> None:
        np.take(rows, places[part], axis=0, out=found[part], mode="clip")

    for_blocks(len(places), take_part)
    return found
