# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of a whole run, which are no keys of job files: what is listed or checked, and which of its bakes are done."""

import argparse
from collections.abc import Iterator

from . import option_types
from .options import CommandOption

TITLE = "many bakes"
"""The title of their group in --help."""
RUN_OPTIONS: dict[str, CommandOption] = {
    "list": CommandOption(
        "List the bakes with their numbers, costs and files, and bake nothing. All that can be checked without a GPU is "
        "checked",
        {"action": "store_true"},
    ),
    "json": CommandOption("With --list: print one JSON object", {"action": "store_true"}),
    "check": CommandOption(
        "Check as --list does, print only what is wrong, and bake nothing", {"action": "store_true"}
    ),
    "shard": CommandOption(
        "Do only part K of N of the bakes. The parts cost about the same, and are the same on every machine",
        {"type": option_types.shard, "metavar": "K/N"},
        "all",
    ),
    "only": CommandOption(
        "Do only the bakes whose names match. * stands for any text, ? for a character, and the option may be repeated",
        {"type": option_types.text, "action": "append", "default": [], "metavar": "PATTERN"},
        "all",
    ),
    "resume": CommandOption(
        "Leave out bakes that are done and still true: a record beside the map has what decided it. Processes on any machine "
        "can do one job at once, and do each bake once",
        {"action": "store_true"},
    ),
    "force": CommandOption("Do all bakes, and write the records for --resume", {"action": "store_true"}),
    "records": CommandOption(
        "With --resume or --force: folder for all records, which --untrusted needs",
        {"type": option_types.path, "metavar": "DIR"},
        "beside the maps",
    ),
    "workers": CommandOption(
        "Bake in so many processes at once, each with a Blender of its own, so that a crash ends one bake alone. 0: in this "
        "process",
        {"type": option_types.workers, "default": 1, "metavar": "N"},
        "1",
    ),
    "timeout": CommandOption(
        "End a bake that takes longer, with opening its files",
        {"type": option_types.seconds, "metavar": "SECONDS"},
        "never",
    ),
    "max-memory": CommandOption(
        "End a bake whose process takes more memory, as 4G or 800M",
        {"type": option_types.size_of_memory, "metavar": "SIZE"},
        "never",
    ),
    "log": CommandOption(
        "Folder for a file of each bake with all that is printed in it",
        {"type": option_types.path, "metavar": "DIR"},
        "none",
    ),
    "sheet": CommandOption(
        "Write a page for a browser, with a row and a picture for each bake",
        {"type": option_types.page, "metavar": "OUT.html"},
        "none",
    ),
    "pictures": CommandOption(
        "Folder for a picture of each bake, with its map, the low mesh with it, and its deviations, for pages that are "
        "written later",
        {"type": option_types.path, "metavar": "DIR"},
        "none",
    ),
    "untrusted": CommandOption(
        "Bake files of other people: only the input folder is read, only the output folder is written, in a process with few "
        "rights and limits of time and memory",
        {"action": "store_true"},
    ),
    "input-folder": CommandOption(
        "With --untrusted: the folder with all that may be read",
        {"type": option_types.path, "metavar": "DIR"},
        "that of the job file, of --pairs, or of the first file",
    ),
    "output-folder": CommandOption(
        "With --untrusted: the folder with all that may be written. It is made if it is missing",
        {"type": option_types.path, "metavar": "DIR"},
        "out beside the job file; without a job file, that of --output",
    ),
    "progress": CommandOption(
        "Write what happens to standard error as JSON, an object a line, and nothing else",
        {"type": option_types.json_alone, "metavar": "json"},
        "a line on a terminal",
    ),
    "quiet": CommandOption("Print errors alone", {"action": "store_true"}),
    "version": CommandOption(
        "Print the versions of Imprint and of Blender, and the hash of the code, and do nothing else",
        {"action": "store_true"},
    ),
}
"""The options without their dashes."""
OF_MANY = ("shard", "only")
"""Those that are for many bakes alone."""
OF_RECORDS = ("resume", "force")
"""Those with which each bake has a record."""
OF_WORKERS = ("timeout", "max_memory", "log", "untrusted")
"""Those for which a single bake has a process of its own, too."""


def mistakes(options: argparse.Namespace, are_many: bool) -> Iterator[str]:
    """What contradicts among these options. are_many: whether the run may have several bakes. Without a full stop."""
    given = vars(options)
    if not are_many:
        wrong = (name.replace("_", "-") for name in OF_MANY if given[name])
        yield from (f"--{name} is for many bakes: use --jobs or --pairs DIR" for name in wrong)
    if options.resume and options.force:
        yield "--force does all bakes: leave out --resume"
    if options.records and not has_records(options):
        yield "--records is for --resume and --force"
    if options.untrusted and has_records(options) and not options.records:
        named = next(name for name in OF_RECORDS if given[name])
        yield f"--{named} needs --records DIR with --untrusted: records beside the maps could come with the files"
    if options.list and options.check:
        yield "--list checks as well: leave out --check"
    if options.json and not options.list:
        yield "--json is for --list"
    if needs_worker(options) and not options.workers:
        needs = next(name.replace("_", "-") for name in OF_WORKERS if given[name])
        yield f"--{needs} needs a process for the bakes: leave out --workers 0"
    if (options.input_folder or options.output_folder) and not options.untrusted:
        yield "--input-folder and --output-folder are for --untrusted"
    if options.untrusted and not (are_many or options.file or options.low_file):
        yield "--untrusted needs FILE or --low-file: the open file has been opened already"


def has_records(options: argparse.Namespace) -> bool:
    """Whether the options ask for records of the bakes."""
    return any(vars(options)[name] for name in OF_RECORDS)


def wants_pictures(options: argparse.Namespace) -> bool:
    """Whether bakes have pictures."""
    return bool(options.sheet or options.pictures)


def needs_worker(options: argparse.Namespace) -> bool:
    """Whether the options ask for a process of its own, also for a single bake."""
    return any(vars(options)[name] for name in OF_WORKERS)
