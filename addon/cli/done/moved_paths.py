# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths as they are written to files that may be moved, or seen at another place by another machine."""

import os
from pathlib import PurePath


def written(path: str, folder: str) -> str:
    """An absolute path, relative to `folder` if both are below one folder, with slashes on each system.

    What has only the root in common with `folder` may be at the same place on another machine where `folder` is not.
    """
    try:
        common = os.path.commonpath([path, folder])
    except ValueError:  # on other drives
        common = ""
    is_apart = not common or common == os.path.dirname(common)
    return PurePath(path if is_apart else os.path.relpath(path, folder)).as_posix()


def read(text: str, folder: str) -> str:
    """The absolute path that was written as `text` to a file in `folder`."""
    return os.path.normpath(os.path.join(folder, text))
