# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the record of a bake that has ended."""

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...core.errors import BakeError
from ..plan.plans import Plan
from ..results.bake_result import Done
from ..results.run_report import State
from ..trust.bounds import Bounds
from . import bake_key, bake_record
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


def finish_untrusted(draft: Draft | None, plan: Plan, done: Done, bounds: Bounds) -> Done:
    """As `finish`, by the parent of the process that did the bake and may lie: what it says of files is compared with them."""
    done.entry.number, done.entry.name = plan.number, plan.name
    hashes = Contents()
    try:
        found = list(_found(plan.options, done, bounds, hashes)) if draft else []
    except BakeError as error:
        return replace(done, warnings=[*done.warnings, f"The bake has no record: {error}"])
    return finish(draft, done, found, hashes)


def _found(options: argparse.Namespace, done: Done, bounds: Bounds, hashes: Contents) -> Iterator[Content]:
    """The files that a bake read beside those that its options name. Raises BakeError if one, or one that it wrote, is in
    another folder, or not as the result says."""
    named = {os.path.abspath(path) for path, _ in bake_key.inputs(options)}
    for each in done.entry.files:
        bounds.check_write(each["path"], "a file")
        _check(each, hashes.of(each["path"], each["what"]))
    for each in done.entry.inputs:
        bounds.check_read(each["path"], each["what"])
        content = hashes.of(each["path"], each["what"])
        _check(each, content)
        if each["path"] not in named:
            yield content


def _check(said: dict, content: Content) -> None:
    if content.facts() != said:
        raise BakeError(f"{content.path!r} is not as it was in the bake.")
