# SPDX-License-Identifier: GPL-3.0-or-later
"""The files with what each bake prints."""

from pathlib import Path

from ..plan.plans import Plan
from ..results import kept_files


def path_of(folder: str | None, plan: Plan) -> str:
    """The absolute path of a bake's log; empty without a folder."""
    return str(Path(folder).absolute() / f"{plan.number:06}_{kept_files.plain(plan.name)}.log") if folder else ""
