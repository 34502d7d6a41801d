# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of a whole run, which are no keys of job files: what is listed or checked, and which of its bakes are done."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, fields

from . import option_types, run_report
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
_OF_RECORDS = ("resume", "force")
"""Those with which each bake has a record."""
_OF_WORKERS = ("timeout", "max_memory", "log", "untrusted")
"""Those for which a single bake has a process of its own, too."""


@dataclass(frozen=True)
class RunOptions:
    """The options of a whole run, and what follows from them. Those of each bake are in its plan."""

    program: str = "imprint"
    """What messages begin with."""
    call: run_report.ThisCall = field(default_factory=run_report.noted)
    """For reports, also those that workers write."""
    jobs: str | None = None
    folder: str | None = None
    """The folder of mesh files whose pairs are baked."""
    report: str | None = None
    """The file of the report of all bakes, or STDOUT."""
    list: bool = False
    json: bool = False
    check: bool = False
    shard: tuple[int, int] | None = None
    """The part of the bakes, and the number of parts."""
    only: tuple[str, ...] = ()
    """The patterns of names of bakes."""
    resume: bool = False
    force: bool = False
    records: str | None = None
    workers: int = 1
    timeout: float | None = None
    """Seconds that a bake may take, with opening its files."""
    max_memory: int | None = None
    """Bytes that the process of a bake may have."""
    log: str | None = None
    sheet: str | None = None
    pictures: str | None = None
    untrusted: bool = False
    input_folder: str | None = None
    output_folder: str | None = None
    quiet: bool = False

    @classmethod
    def of(cls, given: argparse.Namespace, program: str = "imprint") -> "RunOptions":
        """From what the parser of the command line has read."""
        words = vars(given)
        values = {each.name: words[each.name] for each in fields(cls) if each.name in words}
        folder = words.get("pairs")
        own = {"program": program, "only": tuple(given.only), "folder": folder if isinstance(folder, str) else None}
        return cls(**(values | own))

    @property
    def may_have_many(self) -> bool:
        """Whether the run may have several bakes."""
        return bool(self.jobs or self.folder)

    @property
    def has_records(self) -> bool:
        """Whether each bake has a record."""
        return self.resume or self.force

    @property
    def has_pictures(self) -> bool:
        """Whether bakes have pictures, for a page of results or for later."""
        return bool(self.sheet or self.pictures)

    @property
    def has_hashes(self) -> bool:
        """Whether the files of bakes are hashed: for a report, and to compare them with what untrusted processes report."""
        return bool(self.report or self.pictures or self.untrusted)

    @property
    def needs_worker(self) -> bool:
        """Whether also a single bake has a process of its own."""
        return any(getattr(self, name) for name in _OF_WORKERS)

    @property
    def has_workers(self) -> bool:
        """Whether bakes have processes of their own. A single one with a record does not, as one without."""
        return bool(self.workers) and (self.may_have_many or self.needs_worker)

    @property
    def has_table(self) -> bool:
        """Whether bakes are done as those of a job file are: several, or a single one with a record, with pictures, or in a
        process of its own."""
        return self.may_have_many or self.has_records or self.has_pictures or self.needs_worker

    @property
    def part(self) -> str:
        """The part of the bakes, as K/N; empty for all."""
        return "/".join(map(str, self.shard or ()))

    def mistakes(self, *, has_files: bool) -> Iterator[str]:
        """What contradicts among these options, without a full stop. has_files: whether the bakes name files to open."""
        if not self.may_have_many:
            wrong = (name for name in ("shard", "only") if getattr(self, name))
            yield from (f"--{name} is for many bakes: use --jobs or --pairs DIR" for name in wrong)
        if self.resume and self.force:
            yield "--force does all bakes: leave out --resume"
        if self.records and not self.has_records:
            yield "--records is for --resume and --force"
        if self.untrusted and self.has_records and not self.records:
            named = next(name for name in _OF_RECORDS if getattr(self, name))
            yield f"--{named} needs --records DIR with --untrusted: records beside the maps could come with the files"
        if self.list and self.check:
            yield "--list checks as well: leave out --check"
        if self.json and not self.list:
            yield "--json is for --list"
        if self.needs_worker and not self.workers:
            needs = next(name.replace("_", "-") for name in _OF_WORKERS if getattr(self, name))
            yield f"--{needs} needs a process for the bakes: leave out --workers 0"
        if (self.input_folder or self.output_folder) and not self.untrusted:
            yield "--input-folder and --output-folder are for --untrusted"
        if self.untrusted and not (self.may_have_many or has_files):
            yield "--untrusted needs FILE or --low-file: the open file has been opened already"
