# SPDX-License-Identifier: GPL-3.0-or-later
"""What scripts for farms say to the command line: checked by its own parsers."""

import os

from addon.cli import arguments
from addon.cli.commands import REPORT
from scripts import imprint

FARM = imprint.ROOT / "scripts" / "farm"
JOBS = "/a folder/jobs.toml"
REPORTS = "/a folder/jobs-reports"


def add_program(folder, monkeypatch, name, text):
    """Put a program before those of the system."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH'].removeprefix(f'{folder}{os.pathsep}')}")


def check_shard(words, shard, shards, *, jobs=JOBS, reports=REPORTS, is_forced=False, size=None):
    """The words of a part are the command line's, and say what they should."""
    run, rest = arguments.split_jobs(words)
    assert (run.jobs, run.shard, run.report) == (jobs, (shard, shards), f"{reports}/report.{shard}.json")
    assert (run.resume, run.force, run.log) == (not is_forced, is_forced, f"{reports}/logs")
    assert arguments.parse(rest).size == (size or arguments.parse([]).size)


def check_first(words, size=None):
    """The words check all bakes with their options."""
    run, rest = arguments.split_jobs(words)
    assert (run.jobs, run.check, run.shard) == (JOBS, True, None)
    assert arguments.parse(rest).size == (size or arguments.parse([]).size)


def check_merge(words, shards, reports=REPORTS):
    """The words merge the reports of all parts."""
    assert words[0] == REPORT.name
    merge = REPORT.parser("imprint").parse_intermixed_args(words[1:])
    parts = [f"{reports}/report.{shard}.json" for shard in range(1, shards + 1)]
    assert (merge.merge, merge.sheet) == (f"{reports}/report.json", f"{reports}/report.html")
    assert merge.reports == parts
