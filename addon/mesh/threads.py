# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs numpy work on blocks of long arrays in threads. numpy releases Python's lock, so all cores work."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

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


def for_blocks(count: int, work: Callable[[slice], None]) -> None:
    """Call `work` with slices of BLOCK that together cover `count` elements, each once and in no order."""
    map_parallel(work, [slice(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK)])
