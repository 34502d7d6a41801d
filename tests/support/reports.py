# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the reports of the command line."""

import json
from pathlib import Path


def bakes(path: Path) -> list[dict]:
    """The entries of a report."""
    return json.loads(path.read_text(encoding="utf-8"))["bakes"]


def bake(path: Path) -> dict:
    """The only entry of a report."""
    (entry,) = bakes(path)
    return entry


def one(path: Path) -> dict:
    """The only report of the only bake."""
    (report,) = bake(path)["reports"]
    return report
