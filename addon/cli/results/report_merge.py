# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts the reports of several calls for one job file together, as of its parts on several machines."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.errors import BakeError
from . import exit_codes, run_report
from .only import Only
from .report_file import LINES
from .run_report import Entry, State

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


def read(path: str) -> list[Part]:
    """What was reported to a path: the report, what a call has left that did not end, both or nothing. Raises BakeError."""
    lines = path if path.endswith(LINES) else path + LINES
    found = [_report(path)] if path != lines and Path(path).exists() else []
    if Path(lines).exists():
        found.append(_lines(lines))
    return found


def merge(paths: Sequence[str]) -> Merged:
    """Put reports together. Reports that are not there are named in warnings. Raises BakeError if none is, or if they are
    not of one job file."""
    parts, warnings = [], []
    for path in paths:
        found = read(path)
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
    tally, entries = exit_codes.Tally(), [best[number] for number in sorted(best)]
    for entry in entries:
        tally.add(entry)
    is_there = {entry.number for entry in entries if entry.state != State.STOPPED}
    only = Only.union([part.only for part in parts])
    wanted = sorted(only.numbers) if only else range(1, first.planned + 1)
    missing = [number for number in wanted if number not in is_there]
    document = run_report.document(entries, first.planned, only=only)
    document.update(imprint=first.imprint, blender=first.blender, code=first.code)
    return Merged(document, len(wanted), missing, exit_codes.FAILED if missing else tally.code, warnings)


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
