# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `gpu`, which tests the GPU."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from ..core.progress import Progress
from . import interruption, run_report
from .blender_process import load_blender
from .commands import GPU
from .run_report import DONE, GATE, STDOUT
from .terminal import Meter


def run(words: Sequence[str], program: str, meter: Meter) -> int:
    """Do what the arguments say. Returns the exit code. Raises SystemExit, WrongUsage, BakeError."""
    options = GPU.parser(program).parse_args(words)
    if options.report and options.report != STDOUT:
        run_report.check_report(options.report, "the report")
    load_blender()
    from ..jobs import gpu_test  # needs Blender
    from .baker import start_gpu

    def show(step: Progress) -> None:
        interruption.check()
        meter.show(step.what, step)

    start_gpu()
    try:
        report = gpu_test.test(show)
    except interruption.Stopped:
        return interruption.code()
    finally:
        meter.clear()
    if options.report == STDOUT:
        print(run_report.as_text(report.to_dict()))
    else:
        print(report.row if options.row else report.text)
    if options.report and options.report != STDOUT:
        run_report.write_report(Path(os.path.abspath(options.report)), report.to_dict())
    for each in report.wrong:
        print(f"{program}: {each.text}", file=sys.stderr)
    return GATE if report.wrong else DONE
