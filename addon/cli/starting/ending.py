# SPDX-License-Identifier: GPL-3.0-or-later
"""Ends a process whose bakes are done and whose files are written."""

import os
import shutil

from .. import standard_streams


def end(code: int) -> None:
    """End the process at once, with this exit code, where Blender is a Python package: it unloads for a quarter of a second.

    In Blender this returns: what its add-ons do at the end is theirs.
    """
    import bpy  # here, since this module is imported before Blender is loaded

    if not bpy.app.module:
        return
    standard_streams.flush()
    shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
    os._exit(code)
