# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `gpu`, which tests the GPU."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from ..core.progress import Progress
from . import interruption, option_types, run_report
from .arguments import Parser
from .blender_process import load_blender
from .options import CommandOption
from .run_report import DONE, GATE, NO_MACHINE, STDOUT
from .terminal import Meter

GPU_OPTIONS: dict[str, CommandOption] = {
    "report": CommandOption(
        f"Write what was found as JSON; {STDOUT} stands for standard output",
        {"type": option_types.path, "metavar": "OUT.json"},
        "none",
    ),
    "row": CommandOption("Print the row for the table in docs/platforms.md", {"action": "store_true"}),
}
"""The options without their dashes."""


def parser(program: str) -> argparse.ArgumentParser:
    """The parser of the arguments. It raises WrongUsage."""
    result = Parser(
        prog=program,
        description="Test the GPU: what it is, whether its driver does what Imprint relies on, whether small bakes of all "
        f"kinds are right, and how fast it is. Ends with 0 if all is right, {GATE} if not, {NO_MACHINE} without a GPU.",
        allow_abbrev=False,
    )
    for name, option in GPU_OPTIONS.items():
        result.add_argument(f"--{name}", **option.arguments)
    return result


def run(words: Sequence[str], program: str, meter: Meter) -> int:
    """Do what the arguments say. Returns the exit code. Raises SystemExit, WrongUsage, BakeError."""
    options = parser(program).parse_args(words)
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
        found = gpu_test.test(show)
    except interruption.Stopped:
        return interruption.code()
    finally:
        meter.clear()
    if options.report == STDOUT:
        print(run_report.as_text(found.to_dict()))
    else:
        print(found.row if options.row else found.text)
    if options.report and options.report != STDOUT:
        run_report.write_report(Path(os.path.abspath(options.report)), found.to_dict())
    for each in found.wrong:
        print(f"{program}: {each.text}", file=sys.stderr)
    return GATE if found.wrong else DONE
