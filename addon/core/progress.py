# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs work in short slices, and reports progress between them."""

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, TypeVar

if TYPE_CHECKING:
    import gpu


@dataclass(frozen=True)
class Progress:
    """The state of a bake between two slices.

    what: the current step. done: the finished share of the whole, from 0 to 1. picture: the unfinished map as a texture for the
    screen, or None. finished: how many maps are done.
    """

    what: str
    done: float
    picture: "gpu.types.GPUTexture | None" = None
    finished: int = 0


Result = TypeVar("Result")
Task: TypeAlias = Generator[Progress, None, Result]
"""A generator that does one slice of the work for each step it yields."""


def part(work: Task[Result], start: float, stop: float) -> Task[Result]:
    """`work` as a part of a larger task: its progress goes from `start` to `stop`."""
    try:
        while True:
            step = next(work)
            yield replace(step, done=start + (stop - start) * step.done)
    except StopIteration as end:
        return end.value
    finally:
        work.close()


def finish(work: Task[Result], on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Run `work` to its end and return its result. on_progress: called after each step."""
    try:
        while True:
            step = next(work)
            if on_progress is not None:
                on_progress(step)
    except StopIteration as end:
        return end.value
    finally:
        work.close()


def run_for(work: Task[Result], seconds: float) -> Progress:
    """Run `work` for about `seconds`. Returns the last step. Raises StopIteration, with the result as value, at the end."""
    start = time.perf_counter()
    while True:
        step = next(work)
        if time.perf_counter() - start > seconds:
            return step


class Pace:
    """Divides rows of texels into slices that take about `seconds` each; None if no listener waits for the steps.

    has_picture: whether steps have pictures, a coarse one first.
    """

    LONGEST = 0.5
    """Seconds of a slice without a listener. Drivers reset a GPU that is busy for too long; on Windows, for 2 seconds."""
    FIRST = 64
    STEP = 8
    """The rows of a slice are a multiple of this, the height of the workgroups of compute shaders."""

    def __init__(self, seconds: float | None = None, *, has_picture: bool = True):
        self.has_listener, self.has_picture = seconds is not None, has_picture
        self.seconds = self.LONGEST if seconds is None else seconds
        self._rows = self.FIRST

    def slices(self, height: int) -> Iterator[range]:
        """Yield the rows of each slice. The time of a slice is that until the caller asks for the next one.

        The caller must wait for the GPU, as target.Target.finish does: drivers draw later than they are called.
        """
        start = 0
        while start < height:
            stop = min(height, start + self._rows)
            before = time.perf_counter()
            yield range(start, stop)
            # At most twice as many: a slice of empty texels takes less time than the next one.
            rate = (stop - start) / max(time.perf_counter() - before, 1e-4)
            rows = min(rate * self.seconds, 2 * self._rows)
            self._rows = max(self.STEP, int(rows) // self.STEP * self.STEP)
            start = stop
