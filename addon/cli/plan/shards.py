# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses the bakes of a run that one machine does, by rules alone: machines agree on them without asking each other."""

import fnmatch
from collections.abc import Callable, Sequence

from ..usage.arguments import WrongUsage
from .plans import Plan


def named(planned: Sequence[Plan], patterns: Sequence[str]) -> list[Plan]:
    """The plans whose names match a pattern; all without patterns. Capitals count. Raises WrongUsage if none matches one."""
    if not patterns:
        return list(planned)
    matches = [[fnmatch.fnmatchcase(plan.name, each) for plan in planned] for each in patterns]
    for pattern, found in zip(patterns, matches, strict=True):
        if not any(found):
            raise WrongUsage(f"--only: no bake has a name that matches {pattern!r}")
    return [plan for plan, *found in zip(planned, *matches, strict=True) if any(found)]


def part(planned: Sequence[Plan], shard: tuple[int, int] | None, cost: Callable[[Plan], int]) -> list[Plan]:
    """Part K of N, in the order of the plans; all without `shard`.

    The parts take turns at the plans, of which the most expensive ones come first, and of equal ones the first one. Plans of a
    chain stay together.
    """
    if shard is None:
        return list(planned)
    number, count = shard
    units: dict[int, list[Plan]] = {}  # a chain needs one process
    for plan in planned:
        units.setdefault(plan.chain or plan.number, []).append(plan)
    by_cost = sorted((-sum(map(cost, unit)), first) for first, unit in units.items())
    mine = (plan for _, first in by_cost[number - 1 :: count] for plan in units[first])
    return sorted(mine, key=lambda plan: plan.number)
