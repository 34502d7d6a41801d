# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one entry for `blender --command imprint`, scripts/bake.py and scripts/imprint.py bake."""

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import bpy

from . import arguments, batch, jobfile
from .arguments import WrongUsage
from .bake.errors import BakeError
from .bake.files import check_writable
from .batch import Plan, Result
from .importing import Stage
from .meter import Meter

DONE, FAILED, WRONG_USAGE = 0, 1, 2


def run(words: Sequence[str], program: str = "imprint") -> int:
    """Bake as `words`, the arguments, say. Returns the exit code; what went wrong is told on stderr, a line each."""
    try:
        options, sets = _read(words, program)
    except SystemExit as stop:  # argparse has printed the help
        return stop.code
    except WrongUsage as error:
        arguments.parser(program).print_usage(sys.stderr)
        for line in str(error).splitlines():
            print(f"{program}: error: {line}", file=sys.stderr)
        return WRONG_USAGE
    with _stoppable(), Meter(sys.stderr) as meter:
        try:
            if options.jobs or arguments.is_folder(options):
                return _bake_many(sets, options.report, program, meter)
            return _bake_one(options, program, meter)
        except KeyboardInterrupt:
            problem = "stopped, the frames before are kept." if options.frames else "stopped, nothing was finished."
        except BakeError as error:
            problem = str(error)
        meter.clear()
        print(f"{program}: {problem}", file=sys.stderr)
        return FAILED


def _read(words: Sequence[str], program: str) -> tuple[argparse.Namespace, list[argparse.Namespace]]:
    """The options of the command line, and of each set to bake. Raises WrongUsage."""
    options = arguments.parse(words, program)
    if options.jobs:
        own, more = arguments.split_jobs(words)
        return own, jobfile.read(own.jobs, more)
    arguments.check(options)
    return options, [options]


def _bake_one(options: argparse.Namespace, program: str, meter: Meter) -> int:
    result = batch.bake(Plan("", options), Stage(), meter)
    meter.clear()
    _warn(program, result.warnings)
    print("\n".join(line for report in result.reports for line in report.summary()))
    print("Wrote", ", ".join(path for path in (*result.maps, options.save_blend, options.report) if path))
    return DONE


def _bake_many(sets: Sequence[argparse.Namespace], report: str | None, program: str, meter: Meter) -> int:
    """Each for itself; in the end a table, and the report of all."""

    def tell(result: Result) -> None:
        if result.error:
            print(f"{program}: {result.name}: {result.error}", file=sys.stderr)
        _warn(f"{program}: {result.name}", result.warnings)

    if report:
        check_writable(Path(report).absolute())
    plans, problems = batch.plans(sets)
    _warn(program, problems)
    results, is_stopped = batch.bake_all(plans, meter, tell)
    meter.clear()
    if is_stopped:
        print(f"{program}: stopped, {len(results)} of {len(plans)} were finished.", file=sys.stderr)
    print("\n".join(batch.table(results)))
    if report:
        batch.write_json(Path(report).absolute(), batch.to_json(results))
        print("Wrote", report)
    return FAILED if is_stopped or any(result.error for result in results) else DONE


def _warn(program: str, warnings: Sequence[str]) -> None:
    for warning in warnings:
        print(f"{program}: warning: {warning}", file=sys.stderr)


@contextmanager
def _stoppable() -> Iterator[None]:
    """Ctrl-C stops the bake in good order: Blender's own handler would not reach Python."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        if before is not None:  # one of C, which Python cannot set again
            signal.signal(signal.SIGINT, before)


_handle = None


def register() -> None:
    global _handle  # noqa: PLW0603 - Blender gives a handle to take the command back with
    _handle = bpy.utils.register_cli_command("imprint", run)


def unregister() -> None:
    bpy.utils.unregister_cli_command(_handle)
