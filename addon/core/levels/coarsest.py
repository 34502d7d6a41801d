# SPDX-License-Identifier: GPL-3.0-or-later
"""Searches the coarsest mesh within a limit: step by step, each mesh made from the last one that was within it."""

import math
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from ..progress import Task

STRIDE = 0.5
"""The share of triangles that the first steps leave. After a step beyond the limit, they become smaller."""
FEWER = 0.95
"""The share of triangles that the last step leaves: a search ends when this one is beyond the limit."""
LEAST = 4
"""The fewest triangles that enclose a volume. No coarser mesh is looked for."""
ODD = 2
"""The triangles that an edge inside a mesh takes along when it collapses."""


class Measured(Protocol):
    """A mesh that was measured. excess: how much of the limit it takes, more than 1 beyond it. spent: the share of texels that
    are beyond it, of which a few may be."""

    triangles: int
    excess: float
    spent: float


Candidate = TypeVar("Candidate", bound=Measured)


def search(
    start: Candidate, attempt: Callable[[Candidate, int, bool], Task[Sequence[Candidate]]]
) -> Task[tuple[Candidate, Candidate | None]]:
    """The coarsest mesh within the limit, and the mesh with FEWER of its triangles that is beyond it; None if there is none.

    start: a mesh within the limit. attempt: makes coarser meshes of one of about as many triangles as it is given, in one or
    several ways, or with more if it cannot; it is also told whether the step is the last one.
    """
    within, share = start, STRIDE
    while True:
        wanted = max(min(int(share * within.triangles), within.triangles - ODD), LEAST)
        made = yield from attempt(within, wanted, share >= FEWER)
        coarser = [each for each in made if each.triangles < within.triangles]
        good = [each for each in coarser if each.excess <= 1.0]
        if good:
            within = min(good, key=lambda each: (each.spent, each.excess))
        elif share >= FEWER:
            return within, min(coarser, key=lambda each: each.excess, default=None)
        else:
            share = min(math.sqrt(share), FEWER)
