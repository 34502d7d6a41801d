# SPDX-License-Identifier: GPL-3.0-or-later
"""The files with what each bake prints."""

import os
import re
from pathlib import Path

from ...core.errors import WrongPlace
from ...output.files.atomic_file import reason
from ...output.files.temporary_paths import check_folder
from ..plan.plans import Plan


def prepare(folder: str | None) -> None:
    """Make the folder for logs. Raises WrongPlace unless files can be written there."""
    if not folder:
        return
    try:
        os.makedirs(folder, exist_ok=True)
        check_folder(Path(folder))
    except OSError as error:
        raise WrongPlace(f"--log: no files can be written to {folder!r}: {reason(error)}.") from error


def path_of(folder: str | None, plan: Plan) -> str:
    """The absolute path of a bake's log; empty without a folder."""
    if not folder:
        return ""
    name = re.sub(r"[^\w.-]+", "_", plan.name).strip("_")[:80]
    return str(Path(folder).absolute() / f"{plan.number:06}_{name}.log")
