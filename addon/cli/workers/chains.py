# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes that follow each other in one scene, which a later one of them saves."""

from ...core.errors import BakeError
from ..plan.plans import Plan
from ..results import bake_result
from ..results.bake_result import Done, Result
from ..results.run_report import State


class Chains:
    """The chains of a run in which a bake has failed. Its scene is opened again, without the maps of the bakes before."""

    def __init__(self):
        self._broken: set[int] = set()

    def ended(self, plan: Plan, done: Done) -> None:
        """A bake has ended."""
        if plan.chain and done.entry.state == State.FAILED:
            self._broken.add(plan.chain)

    def refusal(self, plan: Plan) -> Result | None:
        """The result of a bake that would save a scene without the maps of earlier ones; None for one that can be done."""
        if plan.chain not in self._broken or not plan.options.save_blend:
            return None
        error = BakeError("An earlier bake of the same scene has failed, so that it would be saved without all maps.")
        return bake_result.failure(plan.name, error)
