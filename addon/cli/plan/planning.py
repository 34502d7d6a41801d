# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakes of a call, with all files that they read and write."""

import argparse
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial

from .. import bounds
from ..usage import arguments, run_options
from . import plans
from .input_files import InputFiles
from .plans import Plan
from .run_clashes import Run


def are_many(options: argparse.Namespace) -> bool:
    """Whether the bakes of a call are done as those of a job file are: several, or a single one with a record, with a page of
    results, or in a process of its own."""
    asks = run_options.has_records, run_options.wants_pictures, run_options.needs_worker
    return arguments.are_many(options) or any(ask(options) for ask in asks)


def _of_record(records: str | None, options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    from ..done import bake_record  # here, since most calls keep no records

    yield from bake_record.files(options, records)


def plan(
    options: argparse.Namespace, sets: Sequence[argparse.Namespace], inputs: InputFiles
) -> tuple[list[Plan], list[str], Run, list[str]]:
    """The bakes, sentences about unpaired files, the files of all bakes, and a sentence for each bake that would harm a file.

    options: of the call. sets: those of each set. inputs: as in Run. Raises WrongPlace for folders that an
    untrusted call cannot use.
    """
    open_file, within = plans.open_file(), bounds.of(options)
    if within is not None:
        within.check_sets(sets)
    warnings: list[str] = []
    if arguments.are_many(options):
        planned, warnings = plans.plans_of(sets, open_file)
    elif are_many(options):
        own = copy(options)
        own.report = None  # it is that of the call
        planned = [Plan(plans.subject(options, open_file), own)]
    else:
        planned = [Plan("", options)]
    of_record = partial(_of_record, options.records) if run_options.has_records(options) else None
    files = Run(open_file, within, inputs, of_record)
    found = files.add(
        [(each.name, each.options) for each in planned],
        options.jobs,
        options.report if are_many(options) else None,
        [own.pairs for own in sets if arguments.is_folder(own)],
        options.sheet,
    )
    options_of = {each.name: each.options for each in planned} if files.rivals else {}
    for place, each in enumerate(planned if files.rivals else ()):
        rivals = tuple(options_of[name] for name in files.rivals.get(each.name, ()))
        planned[place] = replace(each, rivals=rivals)
    return planned, warnings, files, found
