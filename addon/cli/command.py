# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one entry for `blender --command imprint`, scripts/bake.py and scripts/imprint.py bake."""

import argparse
import sys
import time
from collections.abc import Sequence
from typing import TextIO

import bpy

from ..core.errors import BakeError, WrongPlace, sentence
from ..core.progress import Progress
from . import batch, batch_results, interruption, standard_streams
from .batch_results import Result
from .plan import listing, plans, run_clashes, shards
from .plan.plans import Plan
from .scene_files import Stage
from .starting import lean_blender
from .terminal_progress import Meter
from .usage import arguments, job_file
from .usage.arguments import WrongUsage
from .usage.options import STDOUT

LOD = "lod"
"""The first argument for levels of detail."""
DONE, FAILED, WRONG_USAGE = 0, 1, 2


def run(words: Sequence[str], program: str = "imprint") -> int:
    """Bake according to `words`, the arguments, or make levels of detail if the first one is LOD.

    Returns the exit code; errors and warnings go to stderr, a line each.
    """
    with interruption.listening(), standard_streams.ours():
        done = _make_levels(words[1:], program) if words[:1] == [LOD] else _run(words, program)
        return interruption.code() or done


def _make_levels(words: Sequence[str], program: str) -> int:
    from .lod import lod_command  # here, since a bake does not need it

    return lod_command.run(words, f"{program} {LOD}")


def _run(words: Sequence[str], program: str) -> int:
    try:
        options, sets = _read(words, program)
        if options.list or options.check:
            return listing.run(options, sets, program)
        planned, problems, files = _plan(options, sets)
    except SystemExit as stop:  # argparse has printed the help
        return stop.code
    except WrongUsage as error:
        return _refuse(program, error, hint="" if isinstance(error, job_file.WrongJobs) else _see_help(error))
    except WrongPlace as error:
        return _refuse(program, error)
    except MemoryError as error:
        print(f"{program}: {sentence(error)}", file=sys.stderr)
        return FAILED
    with Meter(sys.stderr) as meter:
        try:
            if _are_many(options):
                _warn(program, problems)
                return _bake_many(planned, files, options.report, program, meter)
            return _bake_one(planned[0], files, program, meter)
        except WrongPlace as error:
            meter.clear()
            return _refuse(program, error)
        except interruption.Stopped:
            problem = "stopped, nothing was finished."
        except (BakeError, MemoryError) as error:
            problem = sentence(error)
        meter.clear()
        print(f"{program}: {problem}", file=sys.stderr)
        return FAILED


def _read(words: Sequence[str], program: str) -> tuple[argparse.Namespace, list[argparse.Namespace]]:
    """The options of the command line, and of each set to bake. Raises WrongUsage."""
    options = arguments.parse(words, program)
    if options.jobs:
        own, more = arguments.split_jobs(words)
        with Meter(sys.stderr) as meter:
            return own, job_file.read(own.jobs, more, lambda share: meter.show(own.jobs, Progress("Reading", share)))
    arguments.check(options)
    return options, [options]


def _are_many(options: argparse.Namespace) -> bool:
    return bool(options.jobs) or arguments.is_folder(options)


def _plan(
    options: argparse.Namespace, sets: Sequence[argparse.Namespace]
) -> tuple[list[Plan], list[str], run_clashes.Run]:
    """The bakes to do, sentences about unpaired files, and the files of all bakes.

    Raises WrongPlace with a line for each bake that would harm a file.
    """
    are_many = _are_many(options)
    planned, problems = plans.plans(sets, bpy.data.filepath) if are_many else ([Plan("", options)], [])
    files = run_clashes.Run(bpy.data.filepath)
    found = files.add(
        [(plan.name, plan.options) for plan in planned],
        options.jobs,
        options.report if are_many else None,
        [own.pairs for own in sets if arguments.is_folder(own)],
    )
    if found:
        raise WrongPlace("\n".join(found))
    if any(plan.options.save_blend or plan.options.export for plan in planned):
        lean_blender.complete()  # before a file is opened: Cycles brings its settings in old files up to date
    return shards.chosen(planned, options.only, options.shard), problems, files


def _refuse(program: str, error: Exception, hint: str = "") -> int:
    for line in str(error).splitlines():
        print(f"{program}: {line}{hint}", file=sys.stderr)
    return WRONG_USAGE


def _see_help(error: WrongUsage) -> str:
    return f"{'' if str(error).endswith('?') else '.'} See --help."


def _bake_one(plan: Plan, files: run_clashes.Run, program: str, meter: Meter) -> int:
    options, stage = plan.options, Stage()
    start, is_begun = time.perf_counter(), False
    try:
        opened = batch.open_files(plan, stage, files, meter)
        is_begun = True
        result = batch.run(opened, stage, files, meter)
    except (BakeError, MemoryError) as error:
        if isinstance(error, WrongPlace) and not is_begun:
            raise
        meter.clear()
        seconds = time.perf_counter() - start
        name = plans.subject(options, bpy.data.filepath)
        return _fail(Result(name, error=sentence(error), seconds=seconds), options.report, program)
    meter.clear()
    out = _out(options.report)
    _warn(program, result.unsaid)
    if result.is_stopped:
        print(f"{program}: stopped, the {result.are} before are kept.", file=sys.stderr)
    print("\n".join(batch_results.summary(result)), file=out)
    print(batch_results.wrote(result, None if result.is_stopped else opened.scene, opened.report), file=out)
    if options.report == STDOUT:
        print(batch_results.as_text(result.to_json()))
    return DONE


def _fail(result: Result, report: str | None, program: str) -> int:
    """Say why a single bake failed, on standard error and in its report."""
    print(f"{program}: {result.error}", file=sys.stderr)
    if path := batch_results.report_file(report):
        batch_results.write_failure(path, result)
    elif report:
        print(batch_results.as_text(batch_results.to_json([result])[0]))
    return FAILED


def _bake_many(planned: Sequence[Plan], files: run_clashes.Run, report: str | None, program: str, meter: Meter) -> int:
    """Bake all plans, then print a table, and write the report of all."""
    path = batch_results.report_file(report)
    file = batch_results.ReportFile(path) if path else None

    def on_result(done: Sequence[Result]) -> None:
        result = done[-1]
        if result.error:
            print(f"{program}: {result.name}: {result.error}", file=sys.stderr)
        _warn(f"{program}: {result.name}", result.unsaid)
        if file:
            file.update(done)

    found = batch.bake_all(planned, files, meter, on_result)
    meter.clear()
    finished = sum(1 for result in found if not result.is_stopped)
    if finished < len(planned):
        print(f"{program}: stopped, {finished} of {len(planned)} were finished.", file=sys.stderr)
    print("\n".join(batch_results.table(found, len(planned))), file=_out(report))
    if file:
        file.write(found)
        print(f"Wrote {path}")
    elif report:
        print(batch_results.as_text(batch_results.to_json(found)))
    return FAILED if any(result.error for result in found) else DONE


def _out(report: str | None) -> TextIO:
    """Where the summary goes: standard output, unless the report goes there."""
    return sys.stderr if report == STDOUT else sys.stdout


def _warn(program: str, warnings: Sequence[str]) -> None:
    for warning in warnings:
        print(f"{program}: warning: {warning}", file=sys.stderr)


_handles: list[object] = []
"""Blender's handle of the command, while it is registered."""


def is_registered() -> bool:
    """Whether the command is registered."""
    return bool(_handles)


def register() -> None:
    _handles.append(bpy.utils.register_cli_command("imprint", run))


def unregister() -> None:
    bpy.utils.unregister_cli_command(_handles.pop())
