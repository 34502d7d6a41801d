# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a single bake of the command line in this process, and reports the result."""

import sys
import time

import bpy

from ..core.errors import BakeError, WrongPlace
from ..core.naming import printable
from . import batch, blender_process, interruption
from .plan import clashes, plans
from .plan.plans import Plan
from .results import bake_result, report_file, run_report, terminal
from .results.bake_result import Result
from .results.terminal import Meter
from .scene_files import SceneLoader
from .usage.options import STDOUT
from .usage.run_options import RunOptions


def run(plan: Plan, files: clashes.RunFiles, run_options: RunOptions, meter: Meter) -> int:
    """Bake. files: must have the plan. Returns the exit code. Raises WrongPlace if the bake would harm a file."""
    options, program, loader = plan.options, run_options.program, SceneLoader()
    if batch.need_all([plan]):
        blender_process.complete()  # before a file is opened, as Baker does
    start, is_begun = time.perf_counter(), False
    meter.planned(1, 1)
    meter.begin(Plan(plans.subject(options, bpy.data.filepath), options))
    try:
        opened = batch.open_files(plan, loader, files, meter)
        is_begun = True
        result = batch.run(opened, loader, files, meter)
    except interruption.Stopped:
        meter.clear()
        print(f"{program}: stopped, nothing was finished.", file=sys.stderr)
        return run_report.FAILED
    except (BakeError, MemoryError) as error:
        if isinstance(error, WrongPlace) and not is_begun:
            raise
        meter.clear()
        result = bake_result.failure(plans.subject(options, bpy.data.filepath), error)
        result.seconds = time.perf_counter() - start
        return _fail(result, options.report, program, meter)
    meter.clear()
    out, entry = terminal.out(run_options), result.entry()
    for warning in result.unsaid:
        meter.report(f"{program}: warning: {warning}")
    if result.is_stopped:
        print(f"{program}: stopped, the {result.are} before are kept.", file=sys.stderr)
    for sentence in entry.gate:
        print(printable(f"{program}: {sentence}"), file=sys.stderr)
    lines = [
        *terminal.saved(result.maps),
        *terminal.summary(result),
        terminal.wrote(result, opened.report),
    ]
    print("\n".join(map(printable, lines)), file=out)
    if options.report == STDOUT:
        print(report_file.as_text(run_report.document([entry])))
    meter.ended(entry)
    return run_report.exit_code(entry)


def _fail(result: Result, report: str | None, program: str, meter: Meter) -> int:
    """Say why a bake failed, on standard error and in its report. Returns the exit code."""
    print(printable(f"{program}: {result.error}"), file=sys.stderr)
    entry = result.entry()
    meter.ended(entry)
    document = run_report.document([entry])
    if path := report_file.report_path(report):
        report_file.write_failure(path, document)
    elif report:
        print(report_file.as_text(document))
    return run_report.exit_code(entry)
