# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes levels of detail for an engine: all in one file, or a file for each."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ..core import file_formats, naming
from ..core.errors import BakeError
from ..core.report import Report
from ..output.files.atomic_file import all_or_none
from . import engine_files
from .engine_files import Exported


def check(path: str, count: int) -> None:
    """Raise BakeError if `path` cannot take `count` levels. It may be relative to the .blend file."""
    if path.startswith("//") and not bpy.data.filepath:
        raise BakeError(f"{path!r} is relative to a .blend file that was never saved: save it first.")
    engine_files.check(path)
    one_file = file_formats.MESHES[0]
    if count > 1 and naming.LOW not in path and Path(path).suffix.lower() != one_file:
        raise BakeError(f"Only {one_file} has levels in one file: put {naming.LOW} into the path of the export.")


def export(context: bpy.types.Context, reports: Sequence[Report], path: str) -> list[Exported]:
    """Write levels, from the finest, with their maps: a file for each if `path` has LOW. reports: of their maps.

    Raises BakeError, and then no file has changed.
    """
    groups = [[report] for report in reports] if naming.LOW in path else [list(reports)]
    done = []
    with all_or_none():
        for group in groups:
            target = Path(bpy.path.abspath(naming.fill(path, group[0].low))).absolute()
            bakes = [[report] for report in group]
            done += engine_files.export(context, bakes, target, are_levels=len(group) > 1)
    return done
