# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakers that take turns, so that a disturbance of the machine affects all of them."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from addon.core.errors import BakeError

PATIENCE = 10.0
"""Seconds. A baker outside Blender bakes only once if its first bake takes longer."""


@dataclass
class Contender:
    """A baker of one pair at one size. `bake` returns the seconds of one bake, `normals` its map.

    patience: it bakes only once if its first bake takes more seconds than this.
    """

    name: str
    bake: Callable[[], float]
    normals: Callable[[], np.ndarray]
    patience: float = float("inf")

    def median_stages(self) -> dict[str, float]:
        """Median seconds of each stage, without the first bake; empty if the baker does not report them."""
        return {}


@dataclass
class Timed:
    """The seconds of one baker: for the first bake, and for one bake per round. gap: why there are no more."""

    first: float = 0.0
    seconds: list[float] = field(default_factory=list)
    stages: dict[str, float] = field(default_factory=dict)
    gap: str = ""

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)


def clocked(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def race(contenders: Sequence[Contender], rounds: int, *, warm_up: bool = True) -> dict[str, Timed]:
    """Bake in rounds. Each contender bakes once per round, so that a disturbance affects all.

    warm_up: bake once more before the rounds; that bake does not count.
    """
    result = {contender.name: Timed() for contender in contenders}
    for turn in range(-warm_up, rounds):
        for contender in contenders:
            timed = result[contender.name]
            if timed.gap:
                continue
            try:
                seconds = contender.bake()
            except (BakeError, RuntimeError) as error:  # Blender's operators raise RuntimeError
                timed.gap = str(error).strip().splitlines()[0]
                timed.seconds.clear()
                continue
            if turn >= 0:
                timed.seconds.append(seconds)
            timed.first = timed.first or seconds
            if turn < 0 and seconds > contender.patience:
                timed.gap = f"its first bake took {seconds:.0f} s, so it did not bake again"
    for contender in contenders:
        if not result[contender.name].gap:
            result[contender.name].stages = contender.median_stages()
    return result
