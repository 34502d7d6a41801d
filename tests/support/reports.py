# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads reports of the command line, and makes one up."""

import json
from pathlib import Path

from addon.cli import run_report
from addon.cli.run_report import Entry, State
from addon.core.report import Report

EVIL = '<script>document.title="bad"</script>"\'&<img src=x onerror=alert(1)>'


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


def of_three():
    """A report of three bakes with other states, whose names and errors have characters of HTML."""
    bake = Report("CAST", "TANGENT", (16, 16), "low", ["high"], missed=0.5, deviation={"percentile_99": 2.25}).to_dict()
    file = {"path": f"/maps/{EVIL.replace('/', '')}.png", "bytes": 1, "sha256": "0" * 64, "what": "map"}
    entries = [
        Entry(1, f"b {EVIL}", seconds=2.0, files=[file], reports=[bake]),
        Entry(2, "a", State.FAILED, EVIL, seconds=10.0),
        Entry(3, "c", State.GATE, gate=["missed is 50 %."], seconds=1.0, reports=[{**bake, "missed": 0.125}]),
    ]
    return json.loads(json.dumps(run_report.document(entries, run_report.head(3))))
