# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `farm`: sends a job file to a render farm."""

import argparse
import os
import re
from collections.abc import Sequence
from pathlib import Path

from .. import flamenco
from . import arguments, job_file, untrusted
from .commands import FARM, WrongUsage
from .run_report import DONE


def run(words: Sequence[str], program: str) -> int:
    """Send the job that `words` describe, and print the address of its page. Returns the exit code.

    Raises SystemExit, WrongUsage, BakeError.
    """
    options = FARM.parser(program).parse_args(words)
    _check(options)
    print(flamenco.submit(options.flamenco, _job(options)))
    return DONE


def _check(options: argparse.Namespace) -> None:
    """Check the job file with the options for its bakes. Raises WrongUsage, WrongPlace."""
    quoted = re.findall(r'"[^"]*"|\S+', _options(options))  # as imprint_bake.js divides them
    words = [re.sub('^"(.*)"$', r"\1", word) for word in quoted]
    for name in FARM.refused:
        if any(word.partition("=")[0] == f"--{name}" for word in words):
            raise WrongUsage(FARM.refusal.format(f"--{name}"))
    run, more = arguments.split_jobs(["--jobs", options.jobs, *words, "--force" if options.force else "--resume"])
    if run.untrusted:
        untrusted.check_job_file(options.jobs)
    job_file.read(options.jobs, more, is_untrusted=run.untrusted)


def _options(options: argparse.Namespace) -> str:
    """The options of all bakes, as one text."""
    return " ".join(filter(None, ("--untrusted" if options.untrusted else "", options.options)))


def _job(options: argparse.Namespace) -> flamenco.Job:
    given = {
        "jobs": os.path.abspath(options.jobs),
        "shards": options.shards,
        "force": options.force or None,
        "options": _options(options) or None,
        "reports": options.reports and os.path.abspath(options.reports),
        "command": options.command,
    }
    settings = {key: value for key, value in given.items() if value is not None}
    return flamenco.Job(options.name or Path(options.jobs).stem, settings, options.priority)
