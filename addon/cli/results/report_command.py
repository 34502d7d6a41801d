# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `report`: puts reports together. It does without Blender."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from ...core.errors import BakeError, sentence
from ..usage import option_types
from ..usage.arguments import Parser, WrongUsage
from ..usage.options import STDOUT, CommandOption
from . import only, own_files, report_file, report_merge, terminal_text
from .exit_codes import WRONG_USAGE
from .sheets import picture_files, result_sheet, sheet_file

REPORT_OPTIONS: dict[str, CommandOption] = {
    "merge": CommandOption(
        f"Write one report of all; {STDOUT} stands for standard output",
        {"type": option_types.path, "metavar": "OUT.json"},
        "none",
    ),
    "sheet": CommandOption(
        "Write a page for a browser, with a row for each bake, and its picture if --pictures kept it",
        {"type": option_types.page, "metavar": "OUT.html"},
        "none",
    ),
}
"""The options without their dashes."""


def parser(program: str) -> argparse.ArgumentParser:
    """The parser of the arguments. It raises WrongUsage."""
    result = Parser(
        prog=program,
        usage="%(prog)s [--merge OUT.json] [--sheet OUT.html] IN.json ...",
        description="Put the reports of the parts of a job file together, say which bakes are missing, and end with the exit "
        "code that one call for all bakes would have had.",
        allow_abbrev=False,
    )
    result.add_argument("reports", nargs="+", type=option_types.path, metavar="IN.json")
    for name, option in REPORT_OPTIONS.items():
        result.add_argument(f"--{name}", **option.arguments)
    return result


def run(words: Sequence[str], program: str) -> int:
    """Do what the arguments say. Returns the exit code: 1 if bakes are missing."""
    try:
        options = parser(program).parse_intermixed_args(words)
        if not (options.merge or options.sheet):
            raise WrongUsage("--merge OUT.json or --sheet OUT.html is required")
        merged = report_merge.merge(options.reports)
        _write(options, merged)
    except SystemExit as stop:  # argparse has printed the help
        return stop.code
    except WrongUsage as error:
        print(f"{program}: {error}. See --help.", file=sys.stderr)
        return WRONG_USAGE
    except (BakeError, OSError, MemoryError) as error:
        text = str(error) if isinstance(error, OSError) else sentence(error)
        print(f"{program}: {text}", file=sys.stderr)
        return WRONG_USAGE
    for warning in merged.warnings:
        print(f"{program}: warning: {warning}", file=sys.stderr)
    for entry in merged.document["bakes"]:
        for text in filter(None, (entry["error"], *entry["gate"])):
            print(f"{program}: {entry['name']}: {text}", file=sys.stderr)
    if merged.missing:
        print(f"{program}: missing: {only.ranges(merged.missing)}", file=sys.stderr)
    return merged.code


def _write(options: argparse.Namespace, merged: report_merge.Merged) -> None:
    out = sys.stderr if options.merge == STDOUT else sys.stdout
    if options.merge == STDOUT:
        print(report_file.as_text(merged.document))
    elif options.merge:
        own_files.check_report(options.merge, "the report")
        report_file.write(Path(os.path.abspath(options.merge)), merged.document)
    if options.sheet:
        own_files.check_page(options.sheet, "the page of results")
        bakes = merged.document["bakes"]
        rows = (result_sheet.row(entry, picture_files.read(entry["picture"])) for entry in bakes)
        sheet_file.write(Path(os.path.abspath(options.sheet)), merged.document, rows)
    print(terminal_text.total(merged.document["summary"], merged.wanted), file=out)
