# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the seconds that the stages of a bake take."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from .progress import Result, Task, relay

STAGES = ("extract", "method", "tree", "upload", "distances", "draw", "pages", "read", "audit", "image")
"""In the order in which a report lists them."""

STARTUP = ("launcher", "bpy", "imprint", "gpu", "opening", "shaders")
"""What a bake without a window needs before it draws, in order: scripts/imprint.py until Python runs in Blender's process,
Blender's package and numpy, Imprint's modules, the GPU, the files, and the shaders."""
BEGUN = "IMPRINT_BEGUN"
"""The environment variable in which scripts/imprint.py leaves the time of its start, in seconds since 1970."""


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
        self._seconds = dict.fromkeys(STARTUP, 0.0)

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
        taken, self._seconds = self._seconds, dict.fromkeys(STARTUP, 0.0)
        return taken


startup = Startup()
"""Of this process."""
