# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits drawing to a part of targets."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from . import blender_gpu as gpu

_part: ContextVar[tuple[range, range] | None] = ContextVar("columns and rows to draw", default=None)


@contextmanager
def limited_to(columns: range, rows: range) -> Iterator[None]:
    """In this block, drawing and clearing leave all other texels of targets as they are. Compute shaders are not limited."""
    token = _part.set((columns, rows))
    try:
        yield
    finally:
        _part.reset(token)


def of(width: int, height: int) -> tuple[range, range]:
    """The columns and rows that are drawn of targets of this size."""
    return _part.get() or (range(width), range(height))


def begin(width: int, rows: range | None = None) -> bool:
    """Limit the bound framebuffer, of this width, to the part, and to these rows. Returns whether there is a limit, which
    `end` removes."""
    part = _part.get()
    if part is None and rows is None:
        return False
    columns, of_part = part or (range(width), rows)
    of_both = of_part if rows is None else range(max(rows.start, of_part.start), min(rows.stop, of_part.stop))
    gpu.state.scissor_test_set(True)
    gpu.state.scissor_set(columns.start, of_both.start, len(columns), len(of_both))
    return True


def end() -> None:
    """Draw everywhere again."""
    gpu.state.scissor_test_set(False)
