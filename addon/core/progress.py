# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs work in short slices, with progress and a picture between them, and measures the seconds of its stages."""

import math
import os
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, TypeVar

if TYPE_CHECKING:
    import gpu


@dataclass(frozen=True)
class Progress:
    """The state of a bake between two slices.

    what: the current step. done: the finished share of the whole, from 0 to 1. picture: the unfinished map as a texture for the
    screen, or None. finished: how many maps are done. warnings: about the objects, in sentences, in a step before maps are
    drawn.
    """

    what: str
    done: float
    picture: "gpu.types.GPUTexture | None" = None
    finished: int = 0
    warnings: tuple[str, ...] = ()


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

    PICTURES = 0.25
    """Seconds between two pictures: the screen shows no more."""

    LONGEST = 0.5
    """Seconds of a slice without a listener. Drivers reset a GPU that is busy for too long; on Windows, for 2 seconds."""
    FIRST = 64
    """The rows of the first slice without a listener."""
    STEP = 8
    """The rows of a slice are a multiple of this, the height of the workgroups of compute shaders."""

    def __init__(self, seconds: float | None = None, *, has_picture: bool = True):
        self.has_listener, self.has_picture = seconds is not None, has_picture
        self.seconds = self.LONGEST if seconds is None else seconds
        self._rows: dict[str, int] = {}
        self._next_picture = -math.inf

    def takes_picture(self) -> bool:
        """Whether the next step needs a new picture. At most one in PICTURES seconds does."""
        if not (self.has_listener and self.has_picture and time.perf_counter() >= self._next_picture):
            return False
        self._next_picture = time.perf_counter() + self.PICTURES
        return True

    def slices(self, height: int, work: str = "") -> Iterator[range]:
        """Yield the rows of each slice. The time of a slice is that until the caller asks for the next one.

        The caller must wait for the GPU, as target.Target.finish does: drivers draw later than they are called. work: its
        name; the first slice has as many rows as suited the same work before.
        """
        start, rows = 0, self._rows.get(work, self.STEP if self.has_listener else self.FIRST)
        while start < height:
            stop = min(height, start + rows)
            before = time.perf_counter()
            yield range(start, stop)
            # At most twice as many: a slice of empty texels takes less time than the next one.
            rate = (stop - start) / max(time.perf_counter() - before, 1e-4)
            rows = max(self.STEP, int(min(rate * self.seconds, 2 * rows)) // self.STEP * self.STEP)
            self._rows[work] = rows
            start = stop


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

    def __init__(self):
        self.seconds: dict[str, float] = dict.fromkeys((*STAGES, "total"), 0.0)
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
