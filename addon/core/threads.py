# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs numpy work on blocks of long arrays in threads. numpy releases Python's lock, so all cores work."""

import functools
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import numpy as np

Part = TypeVar("Part")
Result = TypeVar("Result")

ELEMENTS_AT_ONCE = 2**16
"""Elements per block, so that intermediate values fit in a processor's cache."""


QUOTA = Path("/sys/fs/cgroup/cpu.max")
"""On Linux in a container: the microseconds of all processors that it may have in so many microseconds, or "max"."""
_of_pool = threading.local()
"""Has `is_own` in the threads of the pool."""


def processors() -> int:
    """How many processors this process may use: those of its affinity, and as many as its container has."""
    own_count = getattr(os, "process_cpu_count", None)  # from Python 3.13 on
    if own_count is not None:
        count = own_count()
    else:
        count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    with suppress(OSError, ValueError):  # "max" is no number
        quota, period = map(int, QUOTA.read_text(encoding="ascii").split())
        count = min(count or 1, -(-quota // period))
    return max(1, count or 1)


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(processors(), "imprint", lambda: setattr(_of_pool, "is_own", True))


def map_parallel(work: Callable[[Part], Result], parts: Sequence[Part]) -> list[Result]:
    """Call `work` with each of `parts` in threads. Returns the results in the order of `parts`.

    If one raises, no other goes on afterwards. Within `work`, another call goes through its parts one by one.
    """
    # A thread that waits for others of its pool may wait for ever.
    if len(parts) < 2 or getattr(_of_pool, "is_own", False):
        return list(map(work, parts))
    jobs = [_pool().submit(work, part) for part in parts]
    try:
        return [job.result() for job in jobs]
    finally:
        for job in jobs:
            job.cancel()
        wait(jobs)


def for_blocks(count: int, work: Callable[[slice], None], block: int | None = None) -> None:
    """Call `work` with slices of `block`, or else ELEMENTS_AT_ONCE, that cover all `count` elements once and in no order."""
    map_parallel(work, blocks(count, block or ELEMENTS_AT_ONCE))


def for_shares(count: int, block: int, work: Callable[[Iterator[slice]], None]) -> None:
    """Call `work` once in each thread, with an iterator of slices of `block` that it shares with the others.

    Together they cover `count` elements, each once. For work that keeps its arrays for the next slice.
    """
    pieces = blocks(count, block)
    shared = iter(pieces)  # `next` of a list's iterator is one step for all threads
    map_parallel(work, [shared] * min(processors(), len(pieces)))


def blocks(count: int, block: int) -> list[slice]:
    """Slices of `block` that cover `count` elements in order; the last one may be shorter."""
    return [slice(start, min(start + block, count)) for start in range(0, count, block)]


def take(rows: np.ndarray, places: np.ndarray) -> np.ndarray:
    """rows[places], for places of any shape."""
    taken = np.empty((*places.shape, *rows.shape[1:]), rows.dtype)

    def take_part(part: slice) -> None:
        np.take(rows, places[part], axis=0, out=taken[part], mode="clip")

    for_blocks(len(places), take_part)
    return taken
