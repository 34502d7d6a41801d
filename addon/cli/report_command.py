# SPDX-License-Identifier: GPL-3.0-or-later
"""The command report, which puts reports together. It does without Blender."""

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import BakeError
from . import run_report, sheet, terminal
from .commands import REPORT, WrongUsage
from .run_report import FAILED, LINES, STDOUT, WRONG_USAGE, Entry, Only, State, ThisCall, Totals

_RANKS = {State.STOPPED: 0, State.FAILED: 1, State.RESUMED: 2, State.GATE: 3, State.DONE: 3}
"""Of several entries of one bake, that with the highest rank counts, of equal ones the last."""


@dataclass(frozen=True)
class _Part:
    """A report, or the lines that a call has left which did not end."""

    path: str
    head: dict[str, Any]
    only: Only | None
    entries: list[Entry]

    @property
    def versions(self) -> str:
        return f"Imprint {self.head['imprint']} in Blender {self.head['blender']}"

    @property
    def started(self) -> str:
        """When its call began, as a text that sorts by time; empty where it does not say."""
        return self.head["started"]

    @property
    def code(self) -> str:
        """The hash of the code; empty in reports that were written before they had it."""
        return self.head["code"]


def _read_parts(path: str) -> list[_Part]:
    """What was reported to a path: the report, what a call has left that did not end, both or nothing. Raises BakeError.

    A report of an earlier second than that call is not read: the call would have replaced it.
    """
    lines = path if path.endswith(LINES) else path + LINES
    parts = []
    if path != lines and Path(path).exists():
        values = _json(path, Path(path).read_bytes())
        parts.append(_part(path, values, values.get("bakes") if isinstance(values, dict) else None))
    if Path(lines).exists():
        # The first line is the head of the report. The last one may have been cut off.
        first, *rest = Path(lines).read_bytes().split(b"\n")[:-1] or [b""]
        left = _part(lines, _json(lines, first), [_json(lines, line) for line in rest])
        parts = [*(part for part in parts if part.started >= left.started), left]
    return parts


def _json(path: str, content: bytes) -> Any:
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BakeError(f"{path!r} is not a report: it is not JSON.") from error


def _part(path: str, head: Any, entries: Any) -> _Part:
    try:
        if head["imprint_report"] != run_report.VERSION:
            raise BakeError(f"{path!r} is a report of version {head['imprint_report']!r}, not {run_report.VERSION}.")
        known = {"planned": int(head["planned"]), **{key: str(head[key]) for key in ("imprint", "blender")}}
        only = Only.from_dict(head.get("only"), known["planned"])
        known |= {key: str(head.get(key, "")) for key in ("code", "started")}
        return _Part(path, known, only, list(map(Entry.from_dict, entries)))
    except (KeyError, TypeError, ValueError) as error:
        raise BakeError(f"{path!r} is not a report of Imprint.") from error


def _all_parts(paths: Sequence[str]) -> tuple[list[_Part], list[str]]:
    """The reports, and a sentence for each that is not there. Raises BakeError if none is."""
    by_path = {path: _read_parts(path) for path in paths}
    warnings = [f"There is no report {path!r}." for path, of_path in by_path.items() if not of_path]
    parts = [part for of_path in by_path.values() for part in of_path]
    if not parts:
        raise BakeError(" ".join(warnings))
    return parts, warnings


def _check_same(part: _Part, first: _Part) -> Iterator[str]:
    """Sentences about versions that differ. Raises BakeError for reports of different job files."""
    if part.head["planned"] != first.head["planned"]:
        counts = part.head["planned"], first.head["planned"]
        raise BakeError(f"{part.path!r} is of {counts[0]} bakes, and {first.path!r} of {counts[1]}.")
    if part.versions != first.versions:
        yield f"{part.path!r} is by {part.versions}, and {first.path!r} by {first.versions}."
    elif part.code and first.code and part.code != first.code:
        yield f"{part.path!r} and {first.path!r} are by other code of Imprint {first.head['imprint']}."


def _best_entries(parts: Sequence[_Part]) -> list[Entry]:
    """The entry that counts of each bake. Raises BakeError for reports of different job files."""
    best: dict[int, Entry] = {}
    for entry in (entry for part in parts for entry in part.entries):
        known = best.setdefault(entry.number, entry)
        if known.name != entry.name:
            raise BakeError(f"Bake {entry.number} is {known.name!r} in one report, and {entry.name!r} in another.")
        if _RANKS[entry.state] >= _RANKS[known.state]:
            best[entry.number] = entry
    return [best[number] for number in sorted(best)]


def run(words: Sequence[str], program: str, call: ThisCall) -> int:
    """Do what the arguments say. Returns the exit code: 1 if bakes are missing. Raises SystemExit, WrongUsage, MemoryError."""
    options = REPORT.parser(program).parse_intermixed_args(words)
    if not (options.merge or options.sheet):
        raise WrongUsage("--merge OUT.json or --sheet OUT.html is required")
    try:
        parts, warnings = _all_parts(options.reports)
        warnings += [text for part in parts for text in _check_same(part, parts[0])]
        entries, first, only = _best_entries(parts), parts[0].head, Only.union([part.only for part in parts])
        head = run_report.head(first["planned"], only=only, call=call) | first
        wanted = sorted(only.numbers) if only else range(1, first["planned"] + 1)
        _write(options, run_report.document(entries, head), len(wanted))
    except (BakeError, OSError) as error:
        print(f"{program}: {error}", file=sys.stderr)
        return WRONG_USAGE
    for warning in warnings:
        print(f"{program}: warning: {warning}", file=sys.stderr)
    for entry in entries:
        for text in filter(None, (entry.error, *entry.gate)):
            print(f"{program}: {entry.name}: {text}", file=sys.stderr)
    finished = {entry.number for entry in entries if entry.state != State.STOPPED}
    if missing := [number for number in wanted if number not in finished]:
        print(f"{program}: missing: {run_report.ranges(missing)}", file=sys.stderr)
        return FAILED
    return Totals(entries).exit_code


def _write(options: argparse.Namespace, document: dict[str, Any], wanted: int) -> None:
    """Write what the options name, and print a line about so many bakes that the calls were for."""
    out = sys.stderr if options.merge == STDOUT else sys.stdout
    if options.merge == STDOUT:
        print(run_report.as_text(document))
    elif options.merge:
        run_report.check_report(options.merge, "the report")
        run_report.write_report(Path(os.path.abspath(options.merge)), document)
    if options.sheet:
        run_report.check_page(options.sheet, "the page of results")
        rows = (sheet.row(entry, sheet.read_picture(entry["picture"])) for entry in document["bakes"])
        sheet.write(Path(os.path.abspath(options.sheet)), document, rows)
    print(terminal.total(document["summary"], wanted), file=out)
