# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists what a call would do, and what is wrong with it: --list and --check. No file is opened in Blender."""

import argparse
import json
import os
import re
import sys
from collections.abc import Sequence

from ..results import exit_codes
from . import clashes, plans
from .clashes import InputFiles
from .input_problems import InputProblems
from .plans import Plan

VERSION = 1
"""Version of the keys of the JSON."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f\u2028\u2029]")


def run(options: argparse.Namespace, sets: Sequence[argparse.Namespace], program: str) -> int:
    """List the bakes on standard output, or only check them, as the options say.

    sets: the options of each set. What is wrong goes to standard error, a line each. Returns the exit code.
    """
    listing = _Listing(options, sets)
    for problem in () if options.quiet else listing.warnings:
        print(f"{program}: warning: {problem}", file=sys.stderr)
    for problem in listing.all_problems:
        print(f"{program}: {problem}", file=sys.stderr)
    if options.list:
        print(json.dumps(listing.to_json(), indent=1) if options.json else "\n".join(map(listing.line, listing.chosen)))
    return listing.code


class _Listing:
    """The bakes of a call, with what is known of them before they are done."""

    def __init__(self, options: argparse.Namespace, sets: Sequence[argparse.Namespace]):
        self._options, self._files = options, InputFiles()
        self.planned, self.warnings, self._run, self.problems = clashes.plan_call(options, sets, self._files)
        self.costs = {plan.number: plans.cost(plan.options) for plan in self.planned}
        self.chosen = plans.shard_part(
            plans.named_plans(self.planned, options.only), options.shard, lambda plan: self.costs[plan.number]
        )
        found = InputProblems(self._files, reads=options.check and self._run.bounds is None)
        is_refused = self._run.bounds is not None and bool(self.problems)  # nothing elsewhere is looked at
        self._of_bakes = {plan.number: [] if is_refused else list(found.of(plan)) for plan in self.chosen}

    @property
    def all_problems(self) -> list[str]:
        """What is wrong with all bakes together, and with each."""
        named = [
            f"{plan.name}: {problem}" if plan.name else problem
            for plan in self.chosen
            for problem in self._of_bakes[plan.number]
        ]
        return [*self.problems, *named]

    @property
    def code(self) -> int:
        """The exit code that the bakes would end with, as far as that is known: only what is wrong with all of them together
        keeps those that are right from being done."""
        if self.problems:
            return exit_codes.WRONG_USAGE
        return exit_codes.FAILED if any(self._of_bakes.values()) else exit_codes.DONE

    def line(self, plan: Plan) -> str:
        """A bake in one line: its number, cost, name and files, between tabs."""
        files = [os.path.abspath(path) for path in self._run.outputs(plan.name, plan.options)]
        if plan.options.frames and len(files) > 2:
            files = [f"{len(files)} files from {files[0]} to {files[-1]}"]
        name = plan.name or plans.subject(plan.options, plans.open_file())
        cells = str(plan.number), str(self.costs[plan.number]), name, ", ".join(files)
        return "\t".join([cell if cell.isprintable() else _CONTROL.sub("?", cell) for cell in cells])

    def to_json(self) -> dict:
        """Plain data for json.dump."""
        shard = self._options.shard
        return {
            "imprint_list": VERSION,
            "planned": len(self.planned),
            "shard": f"{shard[0]}/{shard[1]}" if shard else None,
            "bakes": [self._entry(plan) for plan in self.chosen],
            "problems": self.problems,
            "warnings": self.warnings,
        }

    def _entry(self, plan: Plan) -> dict:
        return {
            "number": plan.number,
            "name": plan.name or plans.subject(plan.options, plans.open_file()),
            "cost": self.costs[plan.number],
            "inputs": list(dict.fromkeys(os.path.abspath(path) for path, _ in plans.input_paths(plan.options))),
            "outputs": [os.path.abspath(path) for path in self._run.outputs(plan.name, plan.options)],
            "problems": self._of_bakes[plan.number],
        }
