# SPDX-License-Identifier: GPL-3.0-or-later
"""The command report, which puts reports together. It does without Blender."""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import BakeError, sentence
from . import option_types, report_file, run_report, sheet, terminal
from .arguments import Parser, WrongUsage
from .options import STDOUT, CommandOption
from .report_file import LINES
from .run_report import WRONG_USAGE, Entry, Only, State

_RANKS = {State.STOPPED: 0, State.FAILED: 1, State.RESUMED: 2, State.GATE: 3, State.DONE: 3}
"""Of several entries of one bake, that with the highest rank counts, of equal ones the last."""


@dataclass(frozen=True)
class Part:
    """A report, or the lines that a call has left which did not end. The other values are as the report has them."""

    path: str
    planned: int
    only: Only | None
    imprint: str
    blender: str
    code: str
    """Empty in reports that were written before they had it."""
    entries: list[Entry]


@dataclass(frozen=True)
class Merged:
    """The report of all. wanted: how many bakes a call was for, which are all without --only. missing: the numbers of those
    that are in no report, or were stopped."""

    document: dict[str, Any]
    wanted: int
    missing: list[int]
    code: int
    """The exit code that one call for all would have had; FAILED if bakes are missing."""
    warnings: list[str]


def read_parts(path: str) -> list[Part]:
    """What was reported to a path: the report, what a call has left that did not end, both or nothing. Raises BakeError."""
    lines = path if path.endswith(LINES) else path + LINES
    found = [_report(path)] if path != lines and Path(path).exists() else []
    if Path(lines).exists():
        found.append(_lines(lines))
    return found


def merge_reports(paths: Sequence[str]) -> Merged:
    """Put reports together. Reports that are not there are named in warnings. Raises BakeError if none is, or if they are
    not of one job file."""
    parts, warnings = [], []
    for path in paths:
        found = read_parts(path)
        parts += found
        if not found:
            warnings.append(f"There is no report {path!r}.")
    if not parts:
        raise BakeError(" ".join(warnings))
    return _merged(parts, warnings)


def _merged(parts: Sequence[Part], warnings: list[str]) -> Merged:
    first = parts[0]
    best: dict[int, Entry] = {}
    for part in parts:
        if part.planned != first.planned:
            raise BakeError(f"{part.path!r} is of {part.planned} bakes, and {first.path!r} of {first.planned}.")
        if (part.imprint, part.blender) != (first.imprint, first.blender):
            warnings.append(
                f"{part.path!r} is by Imprint {part.imprint} in Blender {part.blender}, and {first.path!r} by Imprint "
                f"{first.imprint} in Blender {first.blender}."
            )
        elif part.code and first.code and part.code != first.code:
            warnings.append(f"{part.path!r} and {first.path!r} are by other code of Imprint {first.imprint}.")
        for entry in part.entries:
            known = best.setdefault(entry.number, entry)
            if known.name != entry.name:
                raise BakeError(f"Bake {entry.number} is {known.name!r} in one report, and {entry.name!r} in another.")
            if _RANKS[entry.state] >= _RANKS[known.state]:
                best[entry.number] = entry
    tally, entries = run_report.Tally(), [best[number] for number in sorted(best)]
    for entry in entries:
        tally.add(entry)
    is_there = {entry.number for entry in entries if entry.state != State.STOPPED}
    only = Only.union([part.only for part in parts])
    wanted = sorted(only.numbers) if only else range(1, first.planned + 1)
    missing = [number for number in wanted if number not in is_there]
    document = run_report.document(entries, run_report.head(first.planned, only=only))
    document.update(imprint=first.imprint, blender=first.blender, code=first.code)
    return Merged(document, len(wanted), missing, run_report.FAILED if missing else tally.code, warnings)


def _report(path: str) -> Part:
    values = _json(path, Path(path).read_bytes())
    return _part(path, values, values.get("bakes") if isinstance(values, dict) else None)


def _lines(path: str) -> Part:
    """The first line is the head of the report. The last one may have been cut off."""
    head, *lines = Path(path).read_bytes().split(b"\n")[:-1] or [b""]
    return _part(path, _json(path, head), [_json(path, line) for line in lines])


def _json(path: str, content: bytes) -> Any:
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BakeError(f"{path!r} is no report: it is not JSON.") from error


def _part(path: str, head: Any, entries: Any) -> Part:
    try:
        if head["imprint_report"] != run_report.VERSION:
            raise BakeError(f"{path!r} is a report of version {head['imprint_report']!r}, not {run_report.VERSION}.")
        planned = int(head["planned"])
        only = Only.from_dict(head.get("only"), planned)
        made_by = str(head["imprint"]), str(head["blender"]), str(head.get("code", ""))
        return Part(path, planned, only, *made_by, list(map(Entry.from_dict, entries)))
    except (KeyError, TypeError, ValueError) as error:
        raise BakeError(f"{path!r} is no report of Imprint.") from error


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


def run_report_command(words: Sequence[str], program: str) -> int:
    """Do what the arguments say. Returns the exit code: 1 if bakes are missing."""
    try:
        options = parser(program).parse_intermixed_args(words)
        if not (options.merge or options.sheet):
            raise WrongUsage("--merge OUT.json or --sheet OUT.html is required")
        merged = merge_reports(options.reports)
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
        print(f"{program}: missing: {run_report.ranges(merged.missing)}", file=sys.stderr)
    return merged.code


def _write(options: argparse.Namespace, merged: Merged) -> None:
    out = sys.stderr if options.merge == STDOUT else sys.stdout
    if options.merge == STDOUT:
        print(report_file.as_text(merged.document))
    elif options.merge:
        report_file.check_report(options.merge, "the report")
        report_file.write_report(Path(os.path.abspath(options.merge)), merged.document)
    if options.sheet:
        report_file.check_page(options.sheet, "the page of results")
        bakes = merged.document["bakes"]
        rows = (sheet.row(entry, sheet.read_picture(entry["picture"])) for entry in bakes)
        sheet.write(Path(os.path.abspath(options.sheet)), merged.document, rows)
    print(terminal.total(merged.document["summary"], merged.wanted), file=out)
