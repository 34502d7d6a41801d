# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of long arrays, as many at once as there are cores: numpy lets other threads run meanwhile."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

BLOCK = 2**16
"""Elements whose intermediate values fit in a processor's cache."""


def at_once[Part, Result](work: Callable[[Part], Result], parts: Sequence[Part]) -> list[Result]:
    """What `work` makes of each of `parts`, in their order."""
    if len(parts) < 2:
        return list(map(work, parts))
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(threads.map(work, parts))


def each(count: int, work: Callable[[slice], None]) -> None:
    """Call `work` with slices of BLOCK that together cover `count` elements, each once and in no order."""
    at_once(work, [slice(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK)])
