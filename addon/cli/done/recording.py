# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the record of a bake that has ended."""

from collections.abc import Sequence
from dataclasses import replace

from ...core.errors import BakeError
from ..results.bake_result import Done
from ..results.run_report import State
from . import bake_record
from .bake_record import Draft
from .contents import Content, Contents


def finish(draft: Draft | None, done: Done, found: Sequence[Content], hashes: Contents) -> Done:
    """Write the record of a bake if it has one and is done. A record that cannot be written is a warning.

    found, hashes: as in bake_record.write.
    """
    if draft is None or done.entry.state not in {State.DONE, State.GATE}:
        return done
    try:
        bake_record.write(draft, done.entry.to_dict(), found, [each["path"] for each in done.entry.files], hashes)
    except BakeError as error:
        return replace(done, warnings=[*done.warnings, f"The bake has no record: {error}"])
    return done
