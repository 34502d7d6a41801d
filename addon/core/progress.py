# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in slices: what a bake says between two of them, and how large they are."""

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, TypeVar

if TYPE_CHECKING:
    import gpu


@dataclass(frozen=True)
class Progress:
    """Said between two slices: what is going on, how much of the whole is done (0 to 1), and the map as far as it is.

    picture: a texture for the screen, or None where there is nothing to see yet. finished: how many maps are done.
    """

    what: str
    done: float
    picture: "gpu.types.GPUTexture | None" = None
    finished: int = 0


Result = TypeVar("Result")
Task: TypeAlias = Generator[Progress, None, Result]
"""Work that is done as far as the next step whenever it is asked for one."""


def part(work: Task[Result], start: float, stop: float) -> Task[Result]:
    """`work` as the part from `start` to `stop` of something larger."""
    try:
        while True:
            step = next(work)
            yield replace(step, done=start + (stop - start) * step.done)
    except StopIteration as end:
        return end.value
    finally:
        work.close()


def finish(work: Task[Result], tell: Callable[[Progress], None] | None = None) -> Result:
    """Do all of `work`; `tell` hears of each step."""
    try:
        while True:
            step = next(work)
            if tell is not None:
                tell(step)
    except StopIteration as end:
        return end.value
    finally:
        work.close()


def run_for(work: Task[Result], seconds: float) -> Progress:
    """As much of `work` as takes about `seconds`. Raises StopIteration at its end, with the result as value."""
    start = time.perf_counter()
    while True:
        step = next(work)
        if time.perf_counter() - start > seconds:
            return step


class Pace:
    """Cuts rows of texels into slices that take about `seconds` each; without a number nobody waits for their steps.

    looks: whether somebody looks at the picture of each step, and wants to see a coarse one first.
    """

    LONGEST = 0.5
    """Seconds, where nobody waits: a driver takes the GPU away from who keeps it for longer than it allows, which is 2 seconds
    on Windows."""
    FIRST = 64
    STEP = 8
    """Slices are made of this many rows: workgroups of compute shaders do not straddle them."""

    def __init__(self, seconds: float | None = None, *, looks: bool = True):
        self.is_heard, self.looks = seconds is not None, looks
        self.seconds = self.LONGEST if seconds is None else seconds
        self._rows = self.FIRST

    def slices(self, height: int) -> Iterator[range]:
        """The rows of one slice after another; the time until the next is asked for is what one takes.

        Who draws has to wait for what was drawn, as with target.Target.finish: drivers work later than they are called.
        """
        start = 0
        while start < height:
            stop = min(height, start + self._rows)
            before = time.perf_counter()
            yield range(start, stop)
            # At most double: one slice over empty texels says little of the next.
            rate = (stop - start) / max(time.perf_counter() - before, 1e-4)
            rows = min(rate * self.seconds, 2 * self._rows)
            self._rows = max(self.STEP, int(rows) // self.STEP * self.STEP)
            start = stop
