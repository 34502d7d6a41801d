# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders that a run fills with a file for each bake, as of logs and pictures."""

import re
from pathlib import Path

from ...core.errors import WrongPlace
from ...output.files.atomic_file import make_folder, reason
from ...output.files.temporary_paths import check_folder

LONGEST = 80
"""Characters of a bake's name in the name of its file."""


def prepare(option: str, folder: str | None) -> None:
    """Make the folder that `option` names, if it does. Raises WrongPlace unless files can be written there."""
    if not folder:
        return
    try:
        make_folder(Path(folder).absolute())
        check_folder(Path(folder))
    except OSError as error:
        raise WrongPlace(f"{option}: no files can be written to {folder!r}: {reason(error)}.") from error


def plain(name: str) -> str:
    """The name of a bake for the name of a file."""
    return re.sub(r"[^\w.-]+", "_", name).strip("_")[:LONGEST]
