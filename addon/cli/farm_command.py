# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `farm`: sends a job file to a render farm."""

import argparse
import os
import re
from collections.abc import Sequence
from pathlib import Path

from .. import flamenco
from . import arguments, job_file, option_types, untrusted
from .arguments import Parser, WrongUsage
from .options import CommandOption
from .run_report import DONE


def _number(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


FARM_OPTIONS: dict[str, CommandOption] = {
    "flamenco": CommandOption(
        "Address of the Flamenco Manager, as http://flamenco.local:8080",
        {"type": option_types.text, "required": True, "metavar": "URL"},
    ),
    "shards": CommandOption("Number of parts, each a task", {"type": _number, "metavar": "N"}, "16"),
    "force": CommandOption("Bake again what is already done", {"action": "store_true"}),
    "untrusted": CommandOption(
        "Bake files of other people, as bake --untrusted does on each machine; needs --records DIR in --options",
        {"action": "store_true"},
    ),
    "options": CommandOption(
        "Further options for all bakes, as one text, with absolute paths",
        {"type": option_types.text, "metavar": "TEXT"},
        "none",
    ),
    "reports": CommandOption(
        "Folder for reports and logs",
        {"type": option_types.path, "metavar": "DIR"},
        "beside the job file, with -reports after its name",
    ),
    "command": CommandOption(
        "What starts Imprint on the machines of the farm",
        {"type": option_types.text, "metavar": "TEXT"},
        "Blender with the extension",
    ),
    "name": CommandOption("Name of the job", {"type": option_types.text, "metavar": "TEXT"}, "that of the job file"),
    "priority": CommandOption("Priority of the job", {"type": _number, "default": 50, "metavar": "N"}, "50"),
}
"""The options without their dashes."""
OF_TASKS = ("jobs", "shard", "resume", "force", "report", "log", "list", "check")
"""Options of a run that the tasks of a farm have already."""


def parser(program: str) -> argparse.ArgumentParser:
    """The parser of the command's options. It raises WrongUsage."""
    result = Parser(
        prog=program,
        description="Send a job file to a render farm. All its machines must see the file and what it names.",
        allow_abbrev=False,
    )
    result.add_argument("jobs", type=option_types.path, metavar="JOBS", help="job file, .toml or .json")
    for name, option in FARM_OPTIONS.items():
        result.add_argument(f"--{name}", **option.arguments)
    return result


def run(words: Sequence[str], program: str) -> int:
    """Send the job that `words` describe, and print the address of its page. Returns the exit code.

    Raises SystemExit, WrongUsage, BakeError.
    """
    options = parser(program).parse_args(words)
    _check(options)
    print(flamenco.submit(options.flamenco, _job(options)))
    return DONE


def _check(options: argparse.Namespace) -> None:
    """Check the job file with the options for its bakes. Raises WrongUsage, WrongPlace."""
    found = re.findall(r'"[^"]*"|\S+', _options(options))  # as imprint_bake.js divides them
    words = [re.sub('^"(.*)"$', r"\1", word) for word in found]
    for name in OF_TASKS:
        if any(word.partition("=")[0] == f"--{name}" for word in words):
            raise WrongUsage(f"--options: leave out --{name}, which the tasks of a farm have already")
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
