# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one entry for `blender --command imprint`, scripts/bake.py and scripts/imprint.py bake."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import bpy

from ..core.errors import BakeError, WrongPlace, sentence
from ..core.progress import Progress
from . import batch, interruption, run_clashes, standard_streams
from .batch import Plan, Result
from .mesh_import import Stage
from .terminal_progress import Meter
from .usage import arguments, job_file
from .usage.arguments import WrongUsage
from .usage.options import STDOUT

DONE, FAILED, WRONG_USAGE = 0, 1, 2


def run(words: Sequence[str], program: str = "imprint") -> int:
    """Bake as `words`, the arguments, say. Returns the exit code; what went wrong is told on stderr, a line each."""
    with interruption.listening(), standard_streams.ours():
        done = _run(words, program)
        return interruption.code() or done


def _run(words: Sequence[str], program: str) -> int:
    try:
        options, sets = _read(words, program)
        plans, problems, files = _plan(options, sets)
    except SystemExit as stop:  # argparse has printed the help
        return stop.code
    except WrongUsage as error:
        arguments.parser(program).print_usage(sys.stderr)
        return _refuse(program, error)
    except WrongPlace as error:
        return _refuse(program, error)
    except MemoryError as error:
        print(f"{program}: {sentence(error)}", file=sys.stderr)
        return FAILED
    with Meter(sys.stderr) as meter:
        try:
            if _are_many(options):
                _warn(program, problems)
                return _bake_many(plans, files, options.report, program, meter)
            return _bake_one(plans[0], files, program, meter)
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
            return own, job_file.read(own.jobs, more, lambda share: meter.tell(own.jobs, Progress("Reading", share)))
    arguments.check(options)
    return options, [options]


def _are_many(options: argparse.Namespace) -> bool:
    return bool(options.jobs) or arguments.is_folder(options)


def _plan(
    options: argparse.Namespace, sets: Sequence[argparse.Namespace]
) -> tuple[list[Plan], list[str], run_clashes.Run]:
    """The bakes to come, sentences about files left over, and the files of all. Raises WrongPlace, a line for each."""
    are_many = _are_many(options)
    plans, problems = batch.plans(sets) if are_many else ([Plan("", options)], [])
    files = run_clashes.Run()
    found = files.add(
        [(plan.name, plan.options) for plan in plans],
        options.jobs,
        options.report if are_many else None,
        [own.pairs for own in sets if arguments.is_folder(own)],
    )
    if found:
        raise WrongPlace("\n".join(found))
    return plans, problems, files


def _refuse(program: str, error: Exception) -> int:
    for line in str(error).splitlines():
        print(f"{program}: error: {line}", file=sys.stderr)
    return WRONG_USAGE


def _bake_one(plan: Plan, files: run_clashes.Run, program: str, meter: Meter) -> int:
    options, out = plan.options, _out(plan.options.report)
    result = batch.bake(plan, Stage(), files, meter)
    meter.clear()
    _warn(program, result.warnings)
    if result.is_stopped:
        print(f"{program}: stopped, the {result.are} before are kept.", file=sys.stderr)
    print("\n".join(line for report in result.reports for line in report.summary()), file=out)
    scene = None if result.is_stopped else options.save_blend
    print("Wrote", ", ".join(filter(None, (*result.maps, scene, _file(options.report)))), file=out)
    if options.report == STDOUT:
        print(batch.as_text(result.to_json()))
    return DONE


def _bake_many(plans: Sequence[Plan], files: run_clashes.Run, report: str | None, program: str, meter: Meter) -> int:
    """Each for itself; in the end a table, and the report of all."""

    file = batch.ReportFile(Path(report).absolute()) if _file(report) else None

    def tell(results: Sequence[Result]) -> None:
        result = results[-1]
        if result.error:
            print(f"{program}: {result.name}: {result.error}", file=sys.stderr)
        _warn(f"{program}: {result.name}", result.warnings)
        if file:
            file.update(results)

    results = batch.bake_all(plans, files, meter, tell)
    meter.clear()
    done = sum(1 for result in results if not result.is_stopped)
    if done < len(plans):
        print(f"{program}: stopped, {done} of {len(plans)} were finished.", file=sys.stderr)
    print("\n".join(batch.table(results, len(plans))), file=_out(report))
    if file:
        file.write(results)
        print("Wrote", report)
    elif report:
        print(batch.as_text(batch.to_json(results)))
    return FAILED if any(result.error for result in results) else DONE


def _file(report: str | None) -> str | None:
    """The file that a report goes to, if it is one."""
    return None if report == STDOUT else report


def _out(report: str | None) -> TextIO:
    """Where a person is told what was done: standard output, unless the report has that for itself."""
    return sys.stderr if report == STDOUT else sys.stdout


def _warn(program: str, warnings: Sequence[str]) -> None:
    for warning in warnings:
        print(f"{program}: warning: {warning}", file=sys.stderr)


_handles: list[object] = []
"""What Blender removes the command by, while it is registered."""


def is_registered() -> bool:
    """Whether Blender knows the command."""
    return bool(_handles)


def register() -> None:
    _handles.append(bpy.utils.register_cli_command("imprint", run))


def unregister() -> None:
    bpy.utils.unregister_cli_command(_handles.pop())
