# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakes of a run, one after the other."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from ..plan.plans import Plan
from .bake_record import Draft


@dataclass(frozen=True)
class Resumed:
    """A bake that need not be done."""

    plan: Plan
    result: dict[str, Any]
    """Its entry of the report of the run that did it."""
    is_elsewhere: bool = False
    """Whether another process did it while this run waited."""


@dataclass(frozen=True)
class ToDo:
    """A bake that this process has to do."""

    plan: Plan
    draft: Draft | None = None
    """For the record; None for a bake without one, or that cannot be done."""
    why: str = ""
    """A sentence."""


class Turns:
    """All bakes of a run in their order, without records. Use it in a `with` block.

    This process works off what `next` returns:

        with turns:
            for done in turns.done: ...
            while turns.count:
                turn = turns.next()
                if turn is None: wait a moment, since other processes have those that are left
                elif isinstance(turn, Resumed): ...
                else: bake, recording.finish(...) in any process, and turns.release(turn.plan.number)
    """

    def __init__(self, planned: Sequence[Plan]):
        self.done: list[Resumed] = []
        """The bakes that were done before."""
        self._left = [ToDo(plan, why=plan.problem) for plan in planned]

    def __enter__(self) -> "Turns":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    @property
    def count(self) -> int:
        """The bakes that `next` has to return, now or later."""
        return len(self._left)

    @property
    def left(self) -> list[ToDo]:
        """These bakes. They have no drafts yet."""
        return list(self._left)

    def next(self, taken: Collection[int] = ()) -> ToDo | Resumed | None:
        """The next bake, which this process has from now on, or one that another process has done.

        taken: chains that wait for another worker of this process. None while others do all that are left.
        """
        for turn in self._left:
            if turn.plan.chain not in taken:
                self._left.remove(turn)
                return turn
        return None

    def release(self, number: int) -> None:
        """Let other processes have a bake that was done, or failed. number: of its plan."""

    def stop(self) -> None:
        """Return no more bakes."""
        self._left.clear()

    def close(self) -> None:
        """Let other processes have all bakes. Can be called more than once."""
