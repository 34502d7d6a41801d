# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs work in short slices, with progress and a picture between them, and measures the seconds of its stages."""

import bisect
import itertools
import math
import os
import time
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, TypeVar

if TYPE_CHECKING:
    import gpu
    import numpy as np

    from .report import Report


@dataclass(frozen=True)
class Progress:
    """The state of a bake between two slices."""

    what: str
    """The current step."""
    done: float
    """The finished share of the whole, from 0 to 1."""
    picture: "gpu.types.GPUTexture | None" = None
    """The unfinished map, for the screen."""
    finished: int = 0
    """How many maps are done."""
    low: str = ""
    """The low object of the bake, if it is one of several."""
    warnings: tuple[str, ...] = ()
    """About the objects, in sentences, in a step before maps are drawn."""
    report: "Report | None" = None
    """Of a bake that has just been finished: its maps stay, also if the work is closed now."""
    failure: tuple[str, str] | None = None
    """The low object of a bake that has just failed, and why, where the next ones are baked all the same."""
    is_before_long: bool = False
    """Whether a slice follows that may take long and cannot be divided: the window looks at its events before."""


Step = TypeVar("Step")
Result = TypeVar("Result")
Task: TypeAlias = Generator[Progress, None, Result]
"""A generator that does one slice of the work for each step it yields."""


def relay(
    work: Generator[Step, None, Result],
    change: Callable[[Step], Step] = lambda step: step,
    within: Callable[[], AbstractContextManager] = nullcontext,
) -> Generator[Step, None, Result]:
    """`work`, with its result, whose steps are changed on their way. It is closed with this task.

    Args:
        change: returns what to yield in place of a step.
        within: makes a context manager for each slice, such as a timer. It is left while the caller has the step.
    """
    try:
        while True:
            with within():
                step = next(work)
            yield change(step)
    except StopIteration as end:
        return end.value
    finally:
        work.close()


def part(work: Task[Result], start: float, stop: float) -> Task[Result]:
    """`work` as a part of a larger task: its progress goes from `start` to `stop`."""
    return relay(work, lambda step: replace(step, done=start + (stop - start) * step.done))


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


def aside(work: Callable[[], Result], step: Progress) -> Task[Result]:
    """The result of `work`, which runs on a thread of its own: numpy's long steps have none in between.

    If the task is closed early, the thread goes on to its end: `work` changes nothing that others see, and calls no Blender.

    Args:
        step: yielded every LONGEST seconds until then.
    """
    pool = ThreadPoolExecutor(1, "imprint aside")
    job = pool.submit(work)
    pool.shutdown(wait=False)  # the thread ends with its work
    while not wait([job], LONGEST).done:
        yield step
    return job.result()


def run_for(work: Task[Result], seconds: float) -> Progress:
    """Run `work` for about `seconds`, or until a long operation follows. Returns the last step. Raises StopIteration, with the
    result as value, at the end."""
    start = time.perf_counter()
    while True:
        step = next(work)
        if step.is_before_long or time.perf_counter() - start > seconds:
            return step


# Slices of what the GPU draws. Work is counted in rays: in the time that a GPU takes for one ray of a bake. A pass declares
# how many of them a texel takes.

SLOWEST = 10e6
"""The rays that the slowest GPU casts in a second."""
LONGEST = 0.1
"""Seconds of a slice. Windows resets a GPU that is busy for 2 seconds, other systems for 1 to 10; desktops stutter sooner."""
SLICE_ROWS = 8
"""The rows of a slice are a multiple of this, the height of the workgroups of compute shaders."""
EMPTY = 1.0 / 64.0
"""The rays of a texel in which nothing is to be drawn."""


def pieces(count: int, cost: float, step: int = 1) -> list[range]:
    """Divide `count` things into pieces that the slowest GPU draws in LONGEST each. Where it draws them in that time, there is
    one piece.

    Args:
        cost: the rays of one of them, at most.
        step: the size of a piece is a multiple of this.
    """
    most = max(step, int(SLOWEST * LONGEST / max(cost, 1e-9)) // step * step)
    return [range(start, min(start + most, count)) for start in range(0, count, most)]


def costs_of_rows(covered: "np.ndarray", width: int, cost: float) -> "np.ndarray":
    """The rays of each SLICE_ROWS rows of a map, as Pace.slices takes them.

    Args:
        covered: (N,), how many texels of each SLICE_ROWS rows have something to draw.
        cost: the rays of such a texel.
    """
    return covered * cost + SLICE_ROWS * width * EMPTY


class Pace:
    """Divides rows of texels into slices of about `seconds`; None if no listener waits for the steps.

    has_picture: whether steps have pictures, a coarse one first.
    """

    PICTURES = 0.25
    """Seconds between two pictures: the screen shows no more."""
    EARLY = 1.0 / 8.0
    """How much smaller the first slice for a listener is: software draws slower than the slowest GPU."""
    GROWTH, BEYOND_SURE = 2.0, 4.0
    """How many times as much as the slice before a slice may have, and as the last one that took SURE seconds."""
    SURE = 0.005
    """A shorter time tells little: it is that of starting and waiting, or of rays that end at once."""

    def __init__(self, seconds: float | None = None, *, has_picture: bool = True):
        self.has_listener, self.has_picture = seconds is not None, has_picture
        self.seconds = LONGEST if seconds is None else seconds
        self._first = SLOWEST * self.seconds * (self.EARLY if self.has_listener else 1.0)
        self._next: dict[str, float] = {}
        """The rays of the next slice, by the name of the work."""
        self._sure: dict[str, float] = {}
        """Those of the last slice that took SURE seconds."""
        self._next_picture = -math.inf

    def takes_picture(self) -> bool:
        """Whether the next step needs a new picture. At most one in PICTURES seconds does."""
        if not (self.has_listener and self.has_picture and time.perf_counter() >= self._next_picture):
            return False
        self._next_picture = time.perf_counter() + self.PICTURES
        return True

    def slices(
        self, work: str, costs: Collection[float], height: int, draw: Callable[[range], None]
    ) -> Iterator[range]:
        """Draw rows in slices. Yields the rows of each slice after it was drawn.

        Args:
            work: the name of what is drawn. The first slice has as many rays as suited it before.
            costs: the rays of each SLICE_ROWS rows.
            height: the number of rows.
            draw: draws the rows that it gets, of which the first is a multiple of SLICE_ROWS, and waits for the GPU, as
                target.Target.finish does: drivers draw later than they are called.
        """
        sums = list(itertools.accumulate(costs))
        start, before = 0, 0.0
        while start < len(costs):
            wanted = self._next.get(work, self._first)
            stop = max(start + 1, bisect.bisect_right(sums, before + wanted))
            rows = range(start * SLICE_ROWS, min(stop * SLICE_ROWS, height))
            began = time.perf_counter()
            draw(rows)
            stop = min(stop, len(costs))
            self._learn(work, sums[stop - 1] - before, time.perf_counter() - began, is_whole=stop < len(costs))
            yield rows
            start, before = stop, sums[stop - 1]

    def _learn(self, work: str, cost: float, seconds: float, *, is_whole: bool) -> None:
        """Note how long a slice took. is_whole: whether it was not cut off by the end of the map."""
        if seconds >= self.SURE:
            self._sure[work] = cost
        fits = self.seconds * cost / max(seconds, 1e-4)
        if is_whole:
            sure = self._sure.get(work, SLOWEST * LONGEST)
            self._next[work] = min(fits, self.GROWTH * cost, self.BEYOND_SURE * sure)
        elif seconds >= self.SURE:
            self._next[work] = min(fits, self._next.get(work, self._first))


class Redraws:
    """The redraws of editors, which may take longer than a slice of the bake.

    clock: seconds, from any time.
    """

    EVERY = 0.25
    """Seconds between two redraws."""
    SHARE = 0.1
    """The largest share of the time that redraws may take."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._asked: float | None = None
        """When the last redraw was asked for; None if it is done."""
        self._next = clock()

    def are_due(self) -> bool:
        """Whether to ask for a redraw now. If so, call `note_done` when it is done."""
        now = self._clock()
        if now < self._next:
            return False
        self._asked, self._next = now, now + self.EVERY
        return True

    def note_done(self) -> None:
        """Note that the screen shows what was asked for. Without such a request, nothing happens."""
        if self._asked is not None:
            now = self._clock()
            self._next = max(self._next, now + (now - self._asked) * (1.0 / self.SHARE - 1.0))
            self._asked = None


STAGES = ("extract", "orient", "method", "tree", "upload", "distances", "draw", "textures", "read", "audit", "image")
"""In the order in which a report lists them."""

STARTUP = ("launcher", "bpy", "imprint", "gpu", "opening", "shaders")
"""What a bake without a window needs before it draws, in order: scripts/imprint.py until Python runs in Blender's process,
Blender's package and numpy, Imprint's modules, the GPU, the files, and the shaders."""
BEGUN = "IMPRINT_BEGUN"
"""The environment variable in which scripts/imprint.py leaves the time of its start, in seconds since 1970."""


class Timings:
    """The seconds of each stage of a bake. The steps of the bake write to it."""

    def __init__(self, stages: Sequence[str] = STAGES):
        self.seconds: dict[str, float] = dict.fromkeys((*stages, "total"), 0.0)
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

    def counted(self, work: Task[Result]) -> Task[Result]:
        """`work`, with its time added to the total. The time between its steps does not count."""
        return relay(work, within=self.in_total)

    @contextmanager
    def in_total(self) -> Iterator[None]:
        """Add the time of the block to the total."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds["total"] += time.perf_counter() - start


class Startup:
    """The seconds of STARTUP that no bake has reported yet."""

    def __init__(self):
        self._seconds: dict[str, float] = dict.fromkeys(STARTUP, 0.0)

    def add_launcher(self) -> None:
        """Count from the start of scripts/imprint.py until now, if it started this process."""
        with suppress(KeyError, ValueError):
            self._seconds["launcher"] += max(0.0, time.time() - float(os.environ[BEGUN]))

    @contextmanager
    def spent(self, stage: str) -> Iterator[None]:
        """Add the time of the block to `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._seconds[stage] += time.perf_counter() - start

    def take(self) -> dict[str, float]:
        """The seconds by stage since the last call."""
        taken = self._seconds.copy()
        self._seconds.update(dict.fromkeys(STARTUP, 0.0))
        return taken


startup = Startup()
"""Of this process."""
