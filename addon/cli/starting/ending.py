# SPDX-License-Identifier: GPL-3.0-or-later
"""Ends a process whose bakes are done and whose files are written."""

import os
import sys
from contextlib import suppress

from .. import standard_streams

TEMPORARY = "blender_"
"""The start of the name of the folder that each process of Blender makes for its temporary files."""


def end(code: int) -> None:
    """End the process at once, with this exit code, where Blender is a Python package: it unloads for a quarter of a second.

    In Blender this returns: what its add-ons do at the end is theirs.
    """
    bpy = sys.modules.get("bpy")
    if bpy is None or not bpy.app.module:
        return
    standard_streams.flush()
    _remove_temporary(bpy.app.tempdir)
    os._exit(code)


def _remove_temporary(folder: str) -> None:
    """Remove Blender's temporary folder if it is empty, as bakes leave it.

    Never with its content: where Blender could not make a folder, this is the one that all programs share.
    """
    folder = os.path.normpath(folder)
    if os.path.basename(folder).startswith(TEMPORARY):
        with suppress(OSError):
            os.rmdir(folder)
