# SPDX-License-Identifier: GPL-3.0-or-later
"""Searches the smallest number of triangles within a limit."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from ..progress import Task

FEWER = 0.95
"""A search ends with a number of triangles within the limit, and with this share of it beyond the limit."""
STRIDE = 0.25
"""While nothing is known to be beyond the limit, the next number is this share of the last one."""
LEAST = 4
"""The fewest triangles that enclose a volume. No coarser mesh is looked for."""
ODD = 2
"""How many triangles more than asked for still count as what was asked for."""
INNER = 0.3
"""The next number stays this far from both ends of what is not known, as a share of its logarithm."""


@dataclass
class Tried:
    """What was measured so far: values that grow as triangles become fewer, by the number of triangles.

    floor: fewer triangles than this cannot be had.
    """

    values: dict[int, float] = field(default_factory=dict)
    floor: int = LEAST


@dataclass(frozen=True)
class Found:
    """The number of triangles within the limit, and FEWER of it, beyond the limit: 0 if there is no coarser mesh."""

    triangles: int
    beyond: int


def search(tried: Tried, limit: float, attempt: Callable[[int], Task[int]]) -> Task[Found]:
    """The smallest number of triangles whose value is within `limit`, down to FEWER of it.

    tried: has at least one number within the limit, and learns all that is measured. attempt: makes a mesh with about as many
    triangles as it is given, puts its value into `tried`, and returns its number of triangles.
    """
    is_stuck = False
    while True:
        within = min(number for number, value in tried.values.items() if value <= limit)
        if within <= tried.floor:
            return Found(within, 0)
        beyond = max((number for number in tried.values if number < within), default=0)
        last = max(int(FEWER * within), tried.floor)
        wanted = last if is_stuck else max(min(_next(within, beyond, tried.values, limit), last), tried.floor)
        number = wanted if wanted in tried.values else (yield from attempt(wanted))
        if number > wanted + ODD:  # the rest of the mesh is kept
            tried.floor = max(tried.floor, number)
            if number >= within:
                return Found(within, 0)
        if tried.values[number] > limit and max(wanted, number) >= last:
            return Found(within, number)
        is_stuck = number <= beyond


def _next(within: int, beyond: int, values: dict[int, float], limit: float) -> int:
    """The number of triangles where the value is about the limit, by the two numbers on either side."""
    if not beyond:
        return int(STRIDE * within)
    fine, coarse = math.log(within), math.log(beyond)
    low, high = (math.log(max(values[number], 1e-9)) for number in (within, beyond))
    share = (math.log(limit) - low) / (high - low) if high > low else 0.5
    share = min(max(share, INNER), 1.0 - INNER)
    return round(math.exp(fine + share * (coarse - fine)))
