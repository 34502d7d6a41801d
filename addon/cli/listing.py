# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists what a call would do, and what is wrong with it: --list and --check. No file is opened in Blender."""

import argparse
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

from ..core import naming
from ..core.errors import BakeError
from ..core.file_formats import OPENED
from ..core.file_structure import blend_files, usd_layers, whole_files
from ..core.naming import match
from ..output.atomic_file import check_writable
from . import clashes, plans, run_report
from .clashes import InputFiles
from .options import RunOptions
from .plans import Plan
from .run_report import STDOUT


class InputProblems:
    """Looks at the files of bakes. Each file and each folder is looked at once."""

    def __init__(self, files: InputFiles, *, reads: bool):
        """reads: whether files, which must be trusted, are read as well, and not only their sizes."""
        self._files, self._reads = files, reads
        self._of_content, self._names = cache(self._of_content), cache(self._names)
        self._writable: set[str] = set()

    def of(self, plan: Plan) -> Iterator[str]:
        """Sentences."""
        if plan.problem:
            yield plan.problem
        options, missing = plan.options, False
        for path in dict.fromkeys(path for path, _ in plans.input_paths(options)):
            if problem := self._files.problem(path):
                missing = True
                yield problem
            elif path not in (options.convert, *options.file[:1]) and _ending(path) not in OPENED:
                yield f"{path!r} is not a supported mesh file. Supported: {', '.join(OPENED)}."
            elif self._reads and (problem := self._of_content(path, is_image=path == options.convert)):
                missing = True
                yield problem
        if not missing:
            yield from self._of_objects(options)
        for path in (options.output, options.export, options.save_blend, options.report):
            if path and path != STDOUT and (problem := self._of_folder(path)):
                yield problem

    def _of_content(self, path: str, *, is_image: bool) -> str:
        """Why a file, or a layer that a USD file is put together from, is not whole."""
        problem = whole_files.problem(path, is_image=is_image)
        return f"{path!r} {problem}." if problem else self._of_layers(path)

    def _of_layers(self, path: str) -> str:
        named = usd_layers.named(path)
        if named.has_variants:  # those that are not chosen may be missing
            return ""
        problems = ((layer, whole_files.problem(layer)) for layer in named.layers)
        return next((f"{path!r} refers to {layer!r}, which {problem}." for layer, problem in problems if problem), "")

    def _of_objects(self, options: argparse.Namespace) -> Iterator[str]:
        # Of several files, objects are renamed where names meet. Importers make names of their own.
        if len(options.file) != 1 or _ending(options.file[0]) in set(OPENED) - {".blend"}:
            return
        names = self._names(options.file[0])
        if names is None:
            yield blend_files.NOT_WHOLE.format(options.file[0])
        elif options.pairs:
            try:
                pairs, problems = match(names, options.suffixes)
            except BakeError as error:
                yield str(error)
                return
            if not pairs:
                yield " ".join(problems) or f"No object has a name that ends in {options.suffixes.low!r}."
        else:
            of_parts = (name for part in options.part for name in (*part.highs, part.cage))
            for name in dict.fromkeys(filter(None, (*options.low, *options.high, options.cage, *of_parts))):
                if name not in names:
                    yield naming.no_such_object(name, sorted(names))

    def _names(self, path: str) -> set[str] | None:
        return blend_files.object_names(Path(path))

    def _of_folder(self, path: str) -> str:
        """Why no file can be written to `path`. Where one can be written to a folder, others can."""
        folder = os.path.dirname(path)
        if not naming.has_low(folder) and folder not in self._writable:
            try:
                check_writable(Path(path).absolute())
            except BakeError as error:
                return str(error)
            self._writable.add(folder)
        return ""


def _ending(path: str) -> str:
    return os.path.splitext(path)[1].lower()


VERSION = 1
"""Version of the keys of the JSON."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f\u2028\u2029]")


def list_bakes(options: RunOptions, sets: Sequence[argparse.Namespace]) -> int:
    """List the bakes on standard output, or only check them, as the options say.

    sets: the options of each set. What is wrong goes to standard error, a line each. Returns the exit code.
    """
    listing = _Listing(options, sets)
    for problem in () if options.quiet else listing.warnings:
        print(f"{options.program}: warning: {problem}", file=sys.stderr)
    for problem in listing.all_problems:
        print(f"{options.program}: {problem}", file=sys.stderr)
    if options.list:
        print(json.dumps(listing.to_json(), indent=1) if options.json else "\n".join(map(listing.line, listing.chosen)))
    return listing.code


def problems_of(sets: Mapping[int, argparse.Namespace]) -> list[str]:
    """What is wrong with the files of some sets of a job file, by their numbers, whose other sets have mistakes."""
    inputs = InputProblems(InputFiles(), reads=False)
    named = [Plan(f"set {number} ({plans.subject(options)})", options) for number, options in sets.items()]
    return _grouped((plan.name, problem) for plan in named for problem in inputs.of(plan))


def _grouped(named: Iterable[tuple[str, str]]) -> list[str]:
    """Problems with the names of their bakes, equal ones once: "a and 3 more: There is no file 'b'."."""
    names: dict[str, list[str]] = {}
    for name, problem in named:
        names.setdefault(problem, []).append(name)
    more = {problem: f" and {len(bakes) - 1:,} more" if len(bakes) > 1 else "" for problem, bakes in names.items()}
    return [f"{bakes[0]}{more[problem]}: {problem}" if bakes[0] else problem for problem, bakes in names.items()]


class _Listing:
    """The bakes of a call, with what is known of them before they are done."""

    def __init__(self, options: RunOptions, sets: Sequence[argparse.Namespace]):
        self._options, self._files = options, InputFiles()
        self.planned, self.warnings, self._run, self.problems = clashes.plan_call(options, sets, self._files)
        self.costs = {plan.number: plans.cost(plan.options) for plan in self.planned}
        shares = plans.shares(self.planned) if options.shard else {}
        named = plans.named_plans(self.planned, options.only)
        self.chosen = plans.shard_part(named, options.shard, lambda plan: shares[plan.number])
        inputs = InputProblems(self._files, reads=options.check and self._run.bounds is None)
        is_refused = self._run.bounds is not None and bool(self.problems)  # nothing elsewhere is looked at
        self._of_bakes = {plan.number: [] if is_refused else list(inputs.of(plan)) for plan in self.chosen}

    @property
    def all_problems(self) -> list[str]:
        """What is wrong with all bakes together, and with each."""
        named = ((plan.name, problem) for plan in self.chosen for problem in self._of_bakes[plan.number])
        return [*self.problems, *_grouped(named)]

    @property
    def code(self) -> int:
        """The exit code that the bakes would end with, as far as that is known: only what is wrong with all of them together
        keeps those that are right from being done."""
        if self.problems:
            return run_report.WRONG_USAGE
        return run_report.FAILED if any(self._of_bakes.values()) else run_report.DONE

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
        return {
            "imprint_list": VERSION,
            "planned": len(self.planned),
            "shard": self._options.part or None,
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
