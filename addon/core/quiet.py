# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps what Blender prints, also in C, from the standard streams."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout


@contextmanager
def silence(*numbers: int, into: int | None = None) -> Iterator[None]:
    """Discard what the block prints, from C as well, on the streams `numbers`, or on both standard streams.

    Exceptions say what matters. into: the descriptor of an open file that receives it.
    """
    flush()
    kept = {number: os.dup(number) for number in numbers or (1, 2)}
    try:
        file = os.devnull if into is None else into
        with (
            open(file, "w", encoding="utf-8", closefd=into is None) as nowhere,
            redirect_stdout(nowhere),
            ExitStack() as more,
        ):
            if 2 in kept:
                more.enter_context(redirect_stderr(nowhere))
            for number in kept:
                os.dup2(nowhere.fileno(), number)
            yield
    finally:
        flush()
        for number, copy in kept.items():
            os.dup2(copy, number)
            os.close(copy)


def flush() -> None:
    """Write what Python and C hold back."""
    for stream in filter(None, (sys.stdout, sys.stderr)):
        stream.flush()
    ctypes.CDLL("ucrtbase" if os.name == "nt" else None).fflush(None)
