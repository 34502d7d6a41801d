# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the record of a bake that has ended."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from ...core.errors import BakeError
from ..bounds import Bounds
from ..plan import plans
from ..plan.plans import Plan
from ..results import bake_result, run_report
from ..results.bake_result import Done
from ..results.run_report import Entry, State
from . import bake_record
from .bake_record import Draft
from .contents import Content, Contents


def finish(
    draft: Draft | None, done: Done, found: Sequence[Content], hashes: Contents, not_followed: Sequence[str] = ()
) -> Done:
    """Write the record of a bake if it has one and is done. A record that cannot be written is a warning.

    found, hashes: as in bake_record.write. not_followed: why files that the bake read are not known, in clauses.
    """
    if draft is None or done.entry.state not in {State.DONE, State.GATE}:
        return done
    try:
        if not_followed:
            raise BakeError(f"{not_followed[0]}, so --resume does it again.")
        files = [each["path"] for each in done.entry.files]
        bake_record.write(draft, done.entry.to_dict(), found, files, hashes, picture=done.picture)
    except BakeError as error:
        return replace(done, warnings=[*done.warnings, f"The bake has no record: {error}"])
    return done


def finish_untrusted(
    draft: Draft | None,
    plan: Plan,
    done: Done,
    bounds: Bounds,
    unplanned: Callable[[Sequence[str]], Sequence[str]],
    *,
    check: Callable[[], None] = lambda: None,
) -> Done:
    """As `finish`, by the parent of the process that did the bake and may lie: what it says of files is compared with them. A
    bake has failed if its process names what it may not have written or read.

    unplanned: returns the paths among others to which the bake may not have written, as clashes.RunFiles.unplanned.
    check: as in Contents.
    """
    entry = done.entry
    entry.number, entry.name, entry.signal, entry.log, entry.picture = plan.number, plan.name, "", "", ""
    hashes = Contents(check)
    try:
        _check_written(entry, bounds, unplanned, hashes)
        for each in entry.inputs:
            bounds.check_read(each["path"], each["what"])
    except BakeError as error:
        return Done.of(
            bake_result.failure(plan.name, BakeError(f"Its process gave a wrong result: {error}")), plan.number
        )
    named = {os.path.abspath(path) for path, _ in plans.input_paths(plan.options)}
    found = [hashes.of(each["path"], each["what"]) for each in entry.inputs]
    for said, content in zip(entry.inputs, found, strict=True):
        if content.facts() != said:
            why = " and the bake has no record" if draft else ""
            return replace(done, warnings=[*done.warnings, f"{content.path!r} is not as it was in the bake{why}."])
    return finish(draft, done, [each for each in found if each.path not in named], hashes)


def _check_written(
    entry: Entry, bounds: Bounds, unplanned: Callable[[Sequence[str]], Sequence[str]], hashes: Contents
) -> None:
    """Raise BakeError unless the files that a bake is said to have written are those that it may write, and have the content
    that is said."""
    if entry.state == State.RESUMED:
        raise BakeError("it was not done by an earlier call.")
    if entry.state in {State.DONE, State.GATE} and not entry.files:
        raise BakeError("it names no file.")
    paths = {each["path"] for each in entry.files}
    for each in entry.files:
        bounds.check_write(each["path"], "a file")
    for path in unplanned(sorted(paths)):
        raise BakeError(f"{path!r} is no file that it was to write.")
    if more := {path for each in entry.reports for path in run_report.paths(each)} - paths:
        raise BakeError(f"a report names {min(more)!r}, which is not among its files.")
    for each in entry.files:
        content = hashes.of(each["path"], each["what"])
        if not os.path.isfile(each["path"]) or content.facts() != each:
            raise BakeError(f"{content.path!r} is not as it says.")
