# SPDX-License-Identifier: GPL-3.0-or-later
"""Long arrays in blocks that fit in a processor's cache, as many at once as there are cores: numpy lets threads run."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

BLOCK = 2**16


def each(count: int, work: Callable[[slice], None]) -> None:
    """Call `work` with slices that together cover `count` elements, each once and in no order."""
    parts = [slice(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK)]
    if len(parts) < 2:
        for part in parts:
            work(part)
        return
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(work, parts))
