# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of the command line, which are the keys of job files: the settings, and what only the command line has."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

from ..core.declarations import kinds
from ..core.declarations.all_settings import DECLARED, PANELS
from ..core.naming import Suffixes
from . import option_types, run_report

STDOUT = "-"
"""A report's path that stands for standard output."""


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
        return self.parsing.get("type") in (option_types.text, option_types.path)

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


@singledispatch
def _parsing(setting: kinds.Setting) -> dict[str, Any]:
    """What argparse.add_argument takes for a declaration of any kind."""
    raise TypeError(f"no option is known for {setting!r}")


@_parsing.register
def _(setting: kinds.Switch):
    return {"action": "store_false" if setting.default else "store_true"}


@_parsing.register
def _(setting: kinds.Choice):
    metavar = "|".join(map(option_types.word_for, setting.values))
    if isinstance(setting.default, int):
        return {"type": option_types.whole_number, "choices": setting.values, "metavar": metavar}
    return {"type": option_types.one_of(setting), "metavar": metavar}


@_parsing.register
def _(setting: kinds.Flags):
    return {"type": option_types.some_of(setting)}


@_parsing.register
def _(setting: kinds.WholeNumber):
    return {"type": option_types.number_or(setting.none_word) if setting.none_word else option_types.whole_number}


@_parsing.register
def _(_setting: kinds.Distance):
    return {"type": option_types.number}


@_parsing.register
def _(_setting: kinds.Color):
    return {"type": option_types.color}


@_parsing.register
def _(_setting: kinds.Text):
    return {"type": option_types.text}


@_parsing.register
def _(_setting: kinds.FilePath):
    return {"type": option_types.path}


@_parsing.register
def _(_setting: kinds.Tiles):
    return {"type": option_types.tiles}


@_parsing.register
def _(_setting: kinds.ObjectSlot):
    return {"type": option_types.text}


@_parsing.register
def _(_setting: kinds.ObjectSlots):
    return {"type": option_types.text, "action": "append"}


def _metavar(setting: kinds.Setting) -> str:
    return setting.option.metavar or _parsing(setting).get("metavar") or setting.metavar


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
        parsing = {"default": setting.default, **parsing, "metavar": _metavar(setting)}
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
    "highs": {"default": [], "dest": "high"},
    "output": {"default": None},
    "export": {"default": None},
}
"""What argparse takes otherwise than by the rules of the kinds."""
_OBJECTS = ("low", "highs", "cage")
"""The settings that name objects."""


OBJECTS = {
    **{option_word(name): _option(name, **_BESIDE.get(name, {})) for name in _OBJECTS},
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
    "high-up": CommandOption(
        "Axis that points up in high files that do not say it: .obj, .ply and .stl. Scans often have Z up in an .obj",
        {"type": option_types.axis, "metavar": "y|z"},
        "y in .obj, z in .ply and .stl",
    ),
    "origin": CommandOption(
        "Point that becomes the scene's origin in .obj and .ply files far from it, in their own coordinates, for a low mesh "
        "that was moved by the same distance",
        {"type": option_types.point, "metavar": "X,Y,Z"},
        "files stay where they are",
    ),
    "name": CommandOption(
        "Name of the bake in messages, reports and pages, and for --only",
        {"type": option_types.text, "default": "", "metavar": "TEXT"},
        "that of the low object or its file",
    ),
    "allow-missing-pages": CommandOption(
        "Bake although files are missing or not whole, as images of the high meshes, caches and fonts, or although Blender "
        "leaves out modifiers: each is a warning then",
        {"action": "store_true"},
    ),
    "pairs": CommandOption(
        "Bake all pairs: x_low with x_high, x_high_2, ... and x_cage. Pairs are objects of FILE or, with DIR, the mesh files "
        "in that folder. {low} in --output makes a map for each pair; without it, they share one",
        {"type": option_types.path, "nargs": "?", "const": True, "metavar": "DIR"},
    ),
    "suffixes": CommandOption(
        "Endings of names for --pairs",
        {"type": option_types.suffixes, "default": Suffixes(), "metavar": "LOW,HIGH,CAGE"},
        "_low,_high,_cage",
    ),
    "convert": CommandOption(
        "Convert this normal map of the low mesh instead of baking: an image file, with <UDIM> for tiles. --space, --basis, "
        "--green and others say what the new map is, --from-space, --from-basis, --from-green and others what this one is. It "
        "keeps its size",
        {"type": option_types.path, "metavar": "MAP"},
    ),
    "frames": CommandOption(
        "Bake a map for each of these frames. The frame's number replaces ### in --output, or goes before the ending",
        {"type": option_types.frames, "metavar": "1-48"},
    ),
}
"""What to bake."""
STRICT = CommandOption(
    "Limits for figures, as in missed<0.1%,overlap=0,deviation.p99<2deg. A bake over a limit keeps its files; "
    f"the exit code is then {run_report.GATE}",
    {"type": option_types.limits, "default": (), "metavar": "LIMIT,LIMIT..."},
    "none",
)
FILES = {
    "save-blend": CommandOption(
        "Save the scene with the map in its material", {"type": option_types.path, "metavar": "OUT.blend"}
    ),
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
    "A .blend to open, or mesh files to import into an empty scene: .obj, .ply, .stl, .gltf, .glb, .fbx, .usd, .usda, .usdc",
    {"nargs": "*", "type": option_types.path, "metavar": "FILE"},
    "the open file",
)
JOBS = CommandOption(
    "Bake the sets in a .toml or .json file. Other options count for all sets, over what the file says",
    {"type": option_types.path, "metavar": "FILE"},
)
SUBJECTS = ("low", "high", "cage", "low-file", "high-file", "cage-file", "pairs")
"""The options that name what to bake."""
