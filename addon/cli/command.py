# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one entry for `blender --command imprint`, scripts/bake.py and scripts/imprint.py bake.

This module does not need Blender. It loads it for a bake in this process; many bakes are done in processes of their own. What
only some calls need is imported by them, since a farm starts many processes.
"""

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace

from ..core import versions
from ..core.errors import BakeError, NoGpu, NoGpuMemory, WrongPlace, sentence
from ..core.processes import CONNECTION
from ..core.progress import Progress, startup
from . import (
    arguments,
    clashes,
    interruption,
    job_file,
    plans,
    run_report,
    set_options,
    standard_streams,
    terminal,
    untrusted,
    worker_process,
)
from .blender_process import load_blender
from .clashes import InputFiles
from .commands import BAKE, CHECK, COMMANDS, FARM, GPU, LOD, MCP, REPORT, Command, WrongUsage
from .options import RunOptions
from .run_report import DONE, FAILED, NO_MACHINE, WRONG_USAGE, Only, ThisCall
from .terminal import Meter

VERSION = "--version"
"""An argument of all commands."""


def run(words: Sequence[str], program: str = "imprint", *, may_start_processes: bool = False) -> int:
    """Bake according to `words`, the arguments, or do what the command says that is the first of them.

    may_start_processes: whether many bakes are done in processes of their own. Returns the exit code; errors and warnings go to
    stderr, a line each.
    """
    with interruption.listening():
        if words == [worker_process.WORD] and CONNECTION in os.environ:
            return _work()
        with (
            standard_streams.redirect_blender(interruption.blender_output()) as blender_lines,
            terminal.meter(words) as meter,
            warnings.catch_warnings(),
        ):
            warnings.showwarning = lambda text, *_: meter.report(f"{program}: warning: {text}")
            if VERSION in words:
                print(versions.line())
                return DONE
            call = ThisCall.of(words)
            if gone := _has_no_folder():
                meter.finished(_refuse(program, gone))
                return WRONG_USAGE
            done = _run(words, program, meter, call, may_start_processes=may_start_processes)
            code = interruption.code() or done
            for line in blender_lines():
                meter.report(f"{program}: Blender: {line}")
            meter.finished(code)
            return code


def _work() -> int:
    load_blender()
    with startup.spent("imprint"):
        from . import worker  # needs Blender

    return worker.run_worker()


def _run(words: Sequence[str], program: str, meter: Meter, call: ThisCall, *, may_start_processes: bool) -> int:
    """Run the command that `words` begin with. Returns the exit code, also of errors, which are printed. call: for reports."""
    command = COMMANDS.get(words[0], BAKE) if words else BAKE
    if command is not BAKE:
        program, words = f"{program} {command.name}", words[1:]
    try:
        if command in (FARM, REPORT, MCP, GPU):
            return _without_bakes(command, words, program, meter, call)
        if command is CHECK:
            run, options = arguments.read_check(words, program)
            if run.untrusted:
                from . import check_in_sandbox

                return check_in_sandbox.run(words, run, options)
            load_blender()
            from . import baker  # needs Blender

            return baker.look_at(options)
        options, sets = _read(command, words, program, meter)
        if arguments.asks_for_sets(sets[0]):
            return set_options.print_sets(sets[0], as_json=options.json)
        if any(each.set for each in sets):
            if options.untrusted:
                raise WrongUsage("--set reads the scene before it is baked: with --untrusted, name objects")
            own = {} if options.jobs else arguments.given(words)
            sets = set_options.expanded(sets, own, is_of_run=options.has_sets)
        return _bake(replace(options, call=call), sets, meter, may_start_processes=may_start_processes)
    except SystemExit as stop:  # argparse has printed the help
        return stop.code
    except WrongUsage as error:
        return _refuse(program, error, hint="" if isinstance(error, job_file.WrongJobs) else _see_help(error))
    except WrongPlace as error:
        meter.clear()
        return _refuse(program, error)
    except (BakeError, MemoryError) as error:
        meter.clear()
        print(f"{program}: {sentence(error)}", file=sys.stderr)
        return NO_MACHINE if isinstance(error, NoGpu | NoGpuMemory | MemoryError) else FAILED


def _without_bakes(command: Command, words: Sequence[str], program: str, meter: Meter, call: ThisCall) -> int:
    """Run a command that has an own module. Returns the exit code, and raises what `_run` prints."""
    if command is FARM:
        from . import farm_command

        return farm_command.run(words, program)
    if command is REPORT:
        from . import report_command

        return report_command.run(words, program, call)
    if command is MCP:
        from . import mcp_command

        return mcp_command.run(words, program)
    from . import gpu_command

    return gpu_command.run(words, program, meter)


def _bake(options: RunOptions, sets: Sequence[argparse.Namespace], meter: Meter, *, may_start_processes: bool) -> int:
    """Do or list the bakes of all sets. Returns the exit code. Raises WrongUsage, BakeError."""
    if options.quiet:
        meter.be_quiet()
    if options.list or options.check:
        from . import listing

        return listing.list_bakes(options, sets)
    planned, problems, files, conflicts = clashes.plan_call(options, sets, InputFiles())
    if conflicts:
        raise WrongPlace("\n".join(conflicts))
    named = plans.named_plans(planned, options.only)
    shares = plans.shares(planned) if options.shard else {}
    chosen = plans.shard_part(named, options.shard, lambda plan: shares[plan.number])
    if options.has_table:
        for problem in problems:
            meter.report(f"{options.program}: warning: {problem}")
        from . import many_bakes

        only = Only.of(options.only, (plan.number for plan in named))
        head = run_report.head(len(planned), options.part, only, call=options.call)
        return many_bakes.run(options, chosen, head, files, meter, may_start_processes=may_start_processes)
    load_blender()
    with startup.spent("imprint"):
        from . import baker  # needs Blender

    return baker.bake_one(planned[0], files, options, meter)


def _read(
    command: Command, words: Sequence[str], program: str, meter: Meter
) -> tuple[RunOptions, list[argparse.Namespace]]:
    """The options of the command line, and of each set to bake. Raises WrongUsage."""
    if command is not BAKE:
        options, of_bake = (arguments.read_lod if command is LOD else arguments.read_asset)(words, program)
        return options, [of_bake]
    options = arguments.parse(words, program)
    if options.jobs:
        own, more = arguments.split_jobs(words, program)
        if own.untrusted:
            untrusted.check_job_file(own.jobs)

        def show(share: float) -> None:
            meter.show(own.jobs, Progress("Reading", share))

        try:
            return own, job_file.read(own.jobs, more, show, is_untrusted=own.untrusted)
        except job_file.WrongJobs as error:
            if error.right and (own.list or own.check) and not own.untrusted:
                from . import listing

                error.told += listing.problems_of(error.right)
            raise
        finally:
            meter.clear()
    return arguments.check(options, program), [options]


def _has_no_folder() -> str:
    """A sentence if the folder in which this was started is gone, where no path can be made absolute."""
    try:
        os.getcwd()
    except OSError as error:
        return f"The folder in which this was started cannot be read: {error.strerror}. Start it in another one."
    return ""


def _refuse(program: str, error: Exception | str, hint: str = "") -> int:
    for line in error.told if isinstance(error, job_file.WrongJobs) else str(error).splitlines():
        print(f"{program}: {line}{hint}", file=sys.stderr)
    return WRONG_USAGE


def _see_help(error: WrongUsage) -> str:
    return f"{'' if str(error).endswith('?') else '.'} See --help."


def _run_in_blender(words: Sequence[str]) -> int:
    import bpy

    if words[:1] == [FARM.name] and not bpy.app.online_access:
        print("imprint farm: Blender has no online access: add --online-mode before --command", file=sys.stderr)
        return WRONG_USAGE
    return run(words, may_start_processes=True)


_handles: list[object] = []
"""Blender's handle of the command, while it is registered."""


def is_registered() -> bool:
    """Whether the command is registered."""
    return bool(_handles)


def register() -> None:
    import bpy

    _handles.append(bpy.utils.register_cli_command("imprint", _run_in_blender))


def unregister() -> None:
    import bpy

    bpy.utils.unregister_cli_command(_handles.pop())
