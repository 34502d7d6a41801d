# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of more folders than Python's functions may call themselves for."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

DEEP = "/".join(["d"] * 250)
"""A path of 250 folders, which all systems take."""
CALLS = 120
"""Calls within each other that are enough for code that does not call itself for each folder."""


@contextmanager
def few_calls() -> Iterator[None]:
    """While the block runs, Python ends code that calls itself for each folder of DEEP."""
    before, depth = sys.getrecursionlimit(), 0
    frame = sys._getframe()
    while frame is not None:
        frame, depth = frame.f_back, depth + 1
    sys.setrecursionlimit(depth + CALLS)
    try:
        yield
    finally:
        sys.setrecursionlimit(before)
