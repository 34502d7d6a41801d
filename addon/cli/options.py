# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of the command line: those of a bake, which are the keys of job files, and those of a whole run."""

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

from ..core.declarations import kinds
from ..core.declarations.all_settings import DECLARED, PANELS
from ..core.file_formats import OPENED, SMOOTH_BELOW
from ..core.naming import Suffixes
from . import option_types, run_report
from .run_report import STDOUT, ThisCall


@dataclass(frozen=True)
class CommandOption:
    """An option of the command line, which is a key of job files as well."""

    tooltip: str
    """What it does, without a full stop."""
    parsing: dict[str, Any]
    """What argparse.add_argument takes beside the help."""
    default_text: str = ""
    """What is used where the option is not given, in words."""
    items: tuple[tuple[str, str], ...] = ()
    """The words that it takes, with what each means."""
    note: str = ""
    """A further sentence."""

    @property
    def arguments(self) -> dict[str, Any]:
        """All that argparse.add_argument takes."""
        sentences = [self.tooltip, *(f"{word}: {meaning}" for word, meaning in self.items), self.note]
        text = ". ".join(filter(None, sentences)) + (f" (default: {self.default_text})" if self.default_text else "")
        return {**self.parsing, "help": text.replace("%", "%%")}

    @property
    def is_path(self) -> bool:
        """Whether it takes a path."""
        return self.parsing.get("type") is option_types.path

    @property
    def is_text(self) -> bool:
        """Whether it takes text that is not read further."""
        return self.parsing.get("type") in (option_types.text, option_types.path, option_types.part)

    @property
    def takes_tables(self) -> bool:
        """Whether job files may have tables for it."""
        return self.parsing.get("type") is option_types.part

    @property
    def is_flag(self) -> bool:
        """Whether it takes no value."""
        return self.parsing.get("action", "").startswith("store_")

    @property
    def may_be_flag(self) -> bool:
        """Whether it may be given without a value."""
        return self.is_flag or self.parsing.get("nargs") == "?"

    @property
    def may_repeat(self) -> bool:
        """Whether it takes several values."""
        return self.parsing.get("action") == "append" or self.parsing.get("nargs") == "*"

    @property
    def value(self) -> str:
        """The value that a job file takes, in words."""
        if self.is_flag:
            return "true or false"
        if self.is_text:
            return "text, or a list of it" if self.may_repeat else "text"
        return "a number or text"


def _parsing(setting: kinds.Setting) -> dict[str, Any]:
    """What argparse.add_argument takes for a declaration of any kind."""
    match setting:
        case kinds.Switch():
            return {"action": "store_false" if setting.default else "store_true"}
        case kinds.Flags():
            return {"type": option_types.some_of(setting)}
        case kinds.Choice():
            metavar = "|".join(map(option_types.word_for, setting.values))
            if isinstance(setting.default, int):
                return {"type": option_types.whole_number, "choices": setting.values, "metavar": metavar}
            return {"type": option_types.one_of(setting), "metavar": metavar}
        case kinds.WholeNumber():
            word = setting.none_word
            return {"type": option_types.number_or(word) if word else option_types.whole_number}
        case kinds.Distance() | kinds.Amount():
            return {"type": option_types.number}
        case kinds.Color():
            return {"type": option_types.color}
        case kinds.FilePath():
            return {"type": option_types.path}
        case kinds.Tiles():
            return {"type": option_types.tiles}
        case kinds.ObjectSlots():
            return {"type": option_types.text, "action": "append"}
        case kinds.Text() | kinds.ObjectSlot():
            return {"type": option_types.text}
    raise TypeError(f"no option is known for {setting!r}")


def _usual(setting: kinds.Setting) -> str:
    """What is used where the option is not given."""
    default = setting.default
    if setting.option.default is not None or setting.empty:
        return setting.empty if setting.option.default is None else setting.option.default
    if default is None or default == () or isinstance(setting, kinds.Switch | kinds.Text):
        return ""
    if isinstance(setting, kinds.Color):
        return ",".join(f"{part:g}" for part in default)
    return option_types.word_for(default)


def _option(name: str, **more: Any) -> CommandOption:
    """The option for the setting `name`; `more` are other arguments of argparse."""
    setting = DECLARED[name]
    parsing = _parsing(setting)
    if "action" not in parsing or parsing["action"] == "append":
        metavar = setting.option.metavar or parsing.get("metavar") or setting.metavar
        parsing = {"default": setting.default, **parsing, "metavar": metavar}
    option, items = setting.option, ()
    if isinstance(setting, kinds.Choice) and option.explains:
        items = tuple((option_types.word_for(item.value), item.tooltip) for item in setting.items)
    return CommandOption(
        option.off or setting.tooltip, {**parsing, "dest": name, **more}, _usual(setting), items, option.note
    )


def option_word(name: str) -> str:
    """The option of the setting `name`, without its dashes."""
    return DECLARED[name].option.word or name.replace("_", "-")


_SIZE = DECLARED["size"].default
_BESIDE = {
    "size": {"type": option_types.size, "default": (_SIZE, _SIZE)},
    "depth": {"default": None},  # it depends on the format
    "low": {"action": "append", "default": []},
    "highs": {"default": [], "dest": "high"},
    "output": {"default": None},
    "export": {"default": None},
}
"""What argparse takes otherwise than by the rules of the kinds."""
_OBJECTS = ("low", "highs", "cage")
"""The settings that name objects."""


OBJECTS = {
    **{option_word(name): _option(name, **_BESIDE.get(name, {})) for name in _OBJECTS},
    "scene": CommandOption(
        "Scene of the .blend that is baked in",
        {"type": option_types.text, "default": "", "metavar": "NAME"},
        "the one that was open when the file was saved",
    ),
    "low-file": CommandOption(
        "Mesh file to bake onto, instead of --low. It must contain one mesh",
        {"type": option_types.path, "metavar": "FILE"},
    ),
    "high-file": CommandOption(
        "Mesh file with the detail, instead of --high. It may contain several meshes, and the option may be repeated",
        {"type": option_types.path, "action": "append", "default": [], "metavar": "FILE"},
    ),
    "cage-file": CommandOption(
        "Mesh file of the cage, instead of --cage. It must contain one mesh",
        {"type": option_types.path, "metavar": "FILE"},
    ),
    "floater": CommandOption(
        "High object that gives detail and shades nothing, beside those that the file marks. The option may be repeated",
        {"type": option_types.text, "action": "append", "default": [], "metavar": "NAME"},
    ),
    "high-up": CommandOption(
        "Axis that points up in high files that do not say it: .obj, .ply and .stl",
        {"type": option_types.axis, "metavar": "y|z"},
        "y in .obj, z in .ply and .stl",
    ),
    "smooth-files": CommandOption(
        "Shade high meshes of files without normals smooth, with edges hard from this many degrees on. 0 leaves them flat",
        {"type": option_types.degrees, "default": SMOOTH_BELOW, "metavar": "N"},
        str(SMOOTH_BELOW),
    ),
    "origin": CommandOption(
        "Point of .obj and .ply files, in their own coordinates, that becomes the scene's origin, where the low mesh has it",
        {"type": option_types.point, "metavar": "X,Y,Z"},
        "files stay where they are",
    ),
    "name": CommandOption(
        "Name of the bake in messages, reports and pages, and for --only",
        {"type": option_types.text, "default": "", "metavar": "TEXT"},
        "that of the low object or its file",
    ),
    "allow-missing-files": CommandOption(
        "Bake although files are missing or not whole, or Blender leaves out modifiers: each is a warning then",
        {"action": "store_true"},
    ),
    "pairs": CommandOption(
        "Bake all pairs: x_low with x_high, x_high_2, ... and x_cage. Pairs are objects of FILE or, with DIR, the mesh files "
        "in that folder. {low} in --output makes a map for each pair; without it, they share one",
        {"type": option_types.path, "nargs": "?", "const": True, "metavar": "DIR"},
    ),
    "part": CommandOption(
        "A low object of several with its high ones, as crate_low=crate_high,bolts. The option may be repeated. In job files "
        "also a table with low, high, cage, size, distance, sizes of materials and on",
        {"type": option_types.part, "action": "append", "default": [], "metavar": "LOW=HIGH,..."},
    ),
    "set": CommandOption(
        "Bake this set of each .blend with its own settings, which other options override. The option may be repeated, * "
        "stands for all sets that are on, and FILE may be a folder",
        {"type": option_types.text, "action": "append", "default": [], "metavar": "NAME"},
    ),
    "suffixes": CommandOption(
        "Endings of names for --pairs",
        {"type": option_types.suffixes, "default": Suffixes(), "metavar": "LOW,HIGH,CAGE"},
        "_low,_high,_cage",
    ),
    "pack-uvs": CommandOption(
        "Give several low objects a UV map, Atlas, in which the islands of all lie side by side, and bake into it. "
        "Those that have it keep their places",
        {"action": "store_true"},
    ),
    "convert": CommandOption(
        "Convert this normal map of the low mesh instead of baking: an image file, with <UDIM> for tiles. --space, --basis "
        "and others say what the new map is, --from-space, --from-basis and others what this one is",
        {"type": option_types.path, "metavar": "MAP"},
    ),
    "frames": CommandOption(
        "Bake a map for each of these frames. The frame's number replaces ### in --output, or goes before the ending",
        {"type": option_types.frames, "metavar": "1-48"},
    ),
}
"""What to bake."""
STRICT = CommandOption(
    "Limits on metrics, as in missed<0.1%,overlap=0,deviation.p99<2deg. A bake over a limit keeps its files; "
    f"the exit code is then {run_report.GATE}",
    {"type": option_types.limits, "default": (), "metavar": "LIMIT,LIMIT..."},
    "none",
)
FILES = {
    "save-blend": CommandOption(
        "Save the scene with the map in its material", {"type": option_types.path, "metavar": "OUT.blend"}
    ),
    "join": CommandOption("With --one-material: join the low objects in the saved scene", {"action": "store_true"}),
    "report": CommandOption(
        f"Write a report as JSON; {STDOUT} stands for standard output",
        {"type": option_types.path, "metavar": "REPORT.json"},
    ),
    "strict": STRICT,
}
"""What a bake writes beside its maps."""


def _options() -> Iterator[tuple[str, dict[str, CommandOption]]]:
    """The options by the titles of their groups."""
    yield "what to bake", OBJECTS
    for key in ("map", "channels", "maps", "output", "rays", "convert"):
        panel = PANELS[key]
        names = [name for name, setting in panel.settings.items() if setting.option and name not in _OBJECTS]
        options = {option_word(name): _option(name, **_BESIDE.get(name, {})) for name in names}
        yield panel.title.lower(), options | (FILES if key == "output" else {})


OPTIONS = dict(_options())
"""The options without their dashes, by the groups of --help, which are those of the panels."""
FILE = CommandOption(
    f"A .blend to open, or mesh files to import into an empty scene: {', '.join(OPENED[1:])}",
    {"nargs": "*", "type": option_types.path, "metavar": "FILE"},
    "the open file",
)
JOBS = CommandOption(
    "Bake the sets in a .toml or .json file. Other options count for all sets, over what the file says",
    {"type": option_types.path, "metavar": "FILE"},
)
SUBJECTS = ("low", "high", "cage", "low-file", "high-file", "cage-file", "pairs", "part", "set")
"""The options that name what to bake."""


RUN_TITLE = "many bakes"
"""The title of their group in --help."""
RUN_OPTIONS: dict[str, CommandOption] = {
    "list": CommandOption(
        "List the bakes with their numbers, costs and files, check what needs no GPU, and bake nothing",
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
        "Leave out bakes that are done and still true, by a record beside each map. Several machines can do one job at once",
        {"action": "store_true"},
    ),
    "changed": CommandOption(
        "As --resume, and bake of several low objects only those whose maps a bake would change. What a part reads is compared "
        "with its record or the .blend",
        {"action": "store_true"},
    ),
    "force": CommandOption("Do all bakes, and write the records for --resume", {"action": "store_true"}),
    "records": CommandOption(
        "With --resume or --force: folder for all records, which --untrusted needs",
        {"type": option_types.path, "metavar": "DIR"},
        "beside the maps",
    ),
    "workers": CommandOption(
        "Bake in so many processes at once, each with a Blender of its own. 0: in this process",
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
        "Folder for a picture of each bake, for pages that are written later",
        {"type": option_types.path, "metavar": "DIR"},
        "none",
    ),
    "untrusted": CommandOption(
        "Bake files of other people in a process with few rights, which reads the input folder alone and writes the output "
        "folder alone",
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
_OF_RECORDS = ("resume", "changed", "force")
"""Those with which each bake has a record."""
_OF_WORKERS = ("timeout", "max_memory", "log", "untrusted")
"""Those for which a single bake has a process of its own, too."""


@dataclass(frozen=True)
class RunOptions:
    """The options of a whole run, and what follows from them. Those of each bake are in its plan."""

    program: str = "imprint"
    """What messages begin with."""
    call: ThisCall = field(default_factory=ThisCall.of)
    """For reports, also those that workers write."""
    jobs: str | None = None
    """The job file."""
    folder: str | None = None
    """The folder of mesh files whose pairs are baked."""
    has_sets: bool = False
    """Whether several sets of scenes are baked."""
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
    changed: bool = False
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
    """With --untrusted: all that may be read."""
    output_folder: str | None = None
    """With --untrusted: all that may be written."""
    quiet: bool = False

    @classmethod
    def of(cls, given: argparse.Namespace, program: str = "imprint") -> "RunOptions":
        """From what the parser of the command line has read."""
        words = vars(given)
        values = {each.name: words[each.name] for each in fields(cls) if each.name in words}
        folder, names = words.get("pairs"), words.get("set", ())
        own = {"program": program, "only": tuple(given.only), "folder": folder if isinstance(folder, str) else None}
        own["has_sets"] = len(names) > 1 or "*" in names or (bool(names) and any(map(os.path.isdir, given.file)))
        return cls(**(values | own))

    @property
    def may_have_many(self) -> bool:
        """Whether the run may have several bakes."""
        return bool(self.jobs or self.folder or self.has_sets)

    @property
    def has_records(self) -> bool:
        """Whether each bake has a record."""
        return self.resume or self.changed or self.force

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
        if self.force and (self.resume or self.changed):
            yield f"--force does all bakes: leave out {'--resume' if self.resume else '--changed'}"
        if self.records and not self.has_records:
            yield "--records is for --resume and --force"
        if self.untrusted and self.has_records and not self.records:
            named = next(name for name in _OF_RECORDS if getattr(self, name))
            yield f"--{named} needs --records DIR with --untrusted: records beside the maps could come with the files"
        if self.list and self.check:
            yield "--list checks as well: leave out --check"
        for name in ("report", "sheet") if self.list else ():
            if getattr(self, name):
                yield f"--{name} is of bakes, and --list does none: leave it out"
        if self.json and not self.list:
            yield "--json is for --list"
        if self.needs_worker and not self.workers:
            needs = next(name.replace("_", "-") for name in _OF_WORKERS if getattr(self, name))
            yield f"--{needs} needs a process for the bakes: leave out --workers 0"
        if (self.input_folder or self.output_folder) and not self.untrusted:
            yield "--input-folder and --output-folder are for --untrusted"
        if self.untrusted and not (self.may_have_many or has_files):
            yield "--untrusted needs FILE or --low-file: the open file has been opened already"
