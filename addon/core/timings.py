# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the seconds that the stages of a bake take."""

import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import TypeVar

Yielded = TypeVar("Yielded")
Result = TypeVar("Result")

STAGES = ("extract", "method", "tree", "upload", "distances", "draw", "pages", "read", "audit", "image")
"""In the order in which a report lists them."""


class Timings:
    """The seconds of each stage of a bake. The steps of the bake write to it."""

    def __init__(self):
        self.seconds = dict.fromkeys((*STAGES, "total"), 0.0)
        """By stage, and in total."""
        self._inside = 0.0
        """The seconds of stages inside the current one."""

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the time of the block to `stage`. The time of stages inside it counts only for those."""
        start, around, self._inside = time.perf_counter(), self._inside, 0.0
        try:
            yield
        finally:
            seconds = time.perf_counter() - start
            self.seconds[stage] += seconds - self._inside
            self._inside = around + seconds

    def counted(self, work: Generator[Yielded, None, Result]) -> Generator[Yielded, None, Result]:
        """`work`, with its time added to the total. The time between its steps does not count."""
        try:
            while True:
                with self.in_total():
                    step = next(work)
                yield step
        except StopIteration as end:
            return end.value
        finally:
            work.close()

    @contextmanager
    def in_total(self) -> Iterator[None]:
        """Add the time of the block to the total."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds["total"] += time.perf_counter() - start
