# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the manual's tables of settings, options, formats, maps and programs from their declarations. Needs no Blender.

In the pages, a table stands between the lines `<!-- table: NAME -->` and `<!-- end -->`; `<!-- options -->` starts that of the
command line's options.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.cli.commands import FARM  # noqa: E402
from addon.cli.limits import LENGTH, METRICS, SHARE, TARGETS  # noqa: E402
from addon.cli.option_types import word_for  # noqa: E402
from addon.cli.options import FILE, JOBS, OBJECTS, OPTIONS, RUN_OPTIONS, RUN_TITLE, CommandOption, option_word  # noqa: E402
from addon.core import file_formats, map_types, udim  # noqa: E402
from addon.core.declarations import kinds, targets  # noqa: E402
from addon.core.declarations.all_settings import DECLARED, PANELS, PanelSettings  # noqa: E402
from addon.core.declarations.choices import Pack  # noqa: E402
from addon.core.map_types import CUSTOM_SUFFIX, PACKINGS, RGBA, Channel, Packing  # noqa: E402
from addon.core.naming import USUAL  # noqa: E402

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PLACE = re.compile(r"^(<!-- (?:table: ([\w-]+)|(options)) -->\n).*?^(<!-- end -->)$", re.MULTILINE | re.DOTALL)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |" for cells in lines) + "\n"


def code(text: object) -> str:
    return f"`{text}`"


def sentence(text: str) -> str:
    """A sentence with its full stop. Placeholders and options in it become code."""
    text = re.sub(r"(?<![\w-])(<[A-Z]+>|\{\w+\}|###|--[a-z][a-z-]*)", r"`\1`", text)
    return f"{text}." if text and not text.endswith(".") else text


# Panels


def default_of(setting: kinds.Setting) -> str:
    """What a panel shows at first, in words."""
    if setting.empty:
        return setting.empty[0].upper() + setting.empty[1:]
    if isinstance(setting, kinds.Switch):
        return "On" if setting.default else "Off"
    if isinstance(setting, kinds.Flags | kinds.ObjectSlot | kinds.FilePath):
        return "None"
    if isinstance(setting, kinds.Choice):
        return next(item.label for item in setting.items if item.value == setting.default)
    if isinstance(setting, kinds.Color):
        return ", ".join(map(str, setting.default))
    return str(setting.default)


def meaning_of(setting: kinds.Setting) -> str:
    """The tooltip, and that of each item of a choice with its word on the command line."""
    lines = [sentence(setting.tooltip)]
    if isinstance(setting, kinds.Choice) and (setting.option is None or setting.option.explains):
        lines += [f"**{item.label}**{word_of(setting, item)}: {sentence(item.tooltip)}" for item in setting.items]
    if setting.option and setting.option.note:
        lines.append(sentence(setting.option.note))
    return "<br>".join(lines)


def word_of(setting: kinds.Setting, item: kinds.Item) -> str:
    """The word of an item on the command line, in brackets, unless it is the label in small letters."""
    word = word_for(item.value)
    return "" if setting.option is None or word == item.label.lower() else f" ({code(word)})"


def option_of(name: str, setting: kinds.Setting) -> str:
    """The option of a setting, without the list of its values. Empty without an option."""
    if setting.option is None:
        return ""
    word, metavar = (
        option_word(name),
        "" if isinstance(setting, kinds.Switch) else setting.option.metavar or setting.metavar,
    )
    return code(f"--{word} {metavar}".strip())


def panel(shown: PanelSettings) -> str:
    """The settings of a panel, from top to bottom."""
    switches = [one.switch for one in shown.settings.values()]
    rows = (
        (f"**{one.label}** {option_of(name, one)}".rstrip(), default_of(one), MEANINGS.get(name) or meaning_of(one))
        for name, one in shown.settings.items()
        if switches.count(name) != 1  # its number says what holds without it
    )
    return table(("setting", "default", "what it does"), rows)


MEANINGS = {
    "pack": f"{sentence(DECLARED['pack'].tooltip)} See [the layouts](maps.md#several-maps-in-one-image).",
    "maps": f"{sentence(DECLARED['maps'].tooltip)} See [all maps](maps.md#all-maps).",
    "targets": f"{sentence(DECLARED['targets'].tooltip)} See [the names](engines.md#engines).",
    "from_basis": f"{sentence(DECLARED['from_basis'].tooltip)} See [Basis](#map).",
}
"""What settings do whose values stand in another table."""


# The command line


def option_row(word: str, option: CommandOption) -> tuple[str, str, str]:
    metavar = option.parsing.get("metavar", "")
    said = f"{word} [{metavar}]" if option.parsing.get("nargs") == "?" else f"{word} {metavar}".strip()
    lines = [option.tooltip, *(f"{code(word)}: {meaning}" for word, meaning in option.items), option.note]
    return code(said), option.default_text, "<br>".join(map(sentence, filter(None, lines)))


def options() -> str:
    """The options that are no settings of a panel, in the groups of --help."""
    settings = {option_word(name) for name, setting in DECLARED.items() if setting.option}
    own = (
        option_row("FILE ...", CommandOption(FILE.tooltip, {}, FILE.default_text)),
        option_row("--jobs", JOBS),
        *(option_row(f"--{word}", option) for word, option in OBJECTS.items() if word not in settings),
    )
    beside = [
        option_row(f"--{word}", option)
        for title, group in OPTIONS.items()
        if title != "what to bake"
        for word, option in group.items()
        if word not in settings
    ]
    runs = [option_row(f"--{word}", option) for word, option in RUN_OPTIONS.items()]
    groups = (
        ("What to bake", own),
        ("What a bake writes beside its maps", beside),
        (RUN_TITLE[0].upper() + RUN_TITLE[1:], runs),
    )
    return "\n".join(f"**{title}**\n\n{table(('option', 'default', 'what it does'), rows)}" for title, rows in groups)


def farm_options() -> str:
    """The options of the command `farm`."""
    rows = [option_row(f"--{word}", option) for word, option in FARM.options.items()]
    return table(("option", "default", "what it does"), rows)


# Files and maps


def formats() -> str:
    """The file formats, by their endings."""
    rows = (
        (
            ", ".join(map(code, one.endings)),
            one.label,
            " or ".join(map(str, one.depths)),
            str(one.usual_depth),
            "as they are" if one.is_float else "from 0 to 1, in steps",
        )
        for one in file_formats.FORMATS
    )
    return table(("ending", "format", "bits per channel", "default", "values"), rows)


def maps() -> str:
    """The maps beside the normal map, with the endings of their names."""
    rows = (
        (
            one.label,
            code(word_for(one.name)),
            endings_of(one),
            sentence(one.tooltip),
        )
        for one in map_types.OTHERS
    )
    return table(("map", "`--maps`", "ending", "what it holds"), rows)


def endings_of(one: map_types.MapType) -> str:
    """The ending of a map's names, and the short one if it has one."""
    return " or ".join(map(code, filter(None, (one.suffix, one.short_suffix))))


def channel_of(channel: Channel) -> str:
    """What a channel of a packed image holds."""
    if not channel.map:
        return f"{channel.constant:g}"
    name = map_types.BY_NAME[channel.map].label
    return f"1 - {name}" if channel.is_inverted else name


def layouts() -> str:
    """The layouts of packed images; those that are alike in one row."""
    labels = {item.value: item.label for item in DECLARED["pack"].items}
    names: dict[Packing, list[str]] = {}
    for pack, layout in PACKINGS.items():
        names.setdefault(layout, []).append(labels[pack])
    rows = [(", ".join(same), code(layout.suffix), *map(channel_of, layout.channels)) for layout, same in names.items()]
    own = (labels[Pack.CUSTOM], code(CUSTOM_SUFFIX), *["as set"] * len(RGBA))
    return table(("**Pack**", "ending", *RGBA), [*rows, own])


def tiles() -> str:
    """The limits of UDIM."""
    rows = (
        ("Tiles", f"{udim.TILES[0]} to {udim.TILES[-1]}: {udim.COLUMNS} along U and {udim.ROWS} along V"),
        ("Number of a tile", f"{udim.FIRST} + U + {udim.COLUMNS} V, for the tile that starts at U and V"),
        ("Tiles of one bake", f"{udim.MOST_BAKED} at most, unless `--tiles` names more"),
        ("In paths", f"{code(udim.TOKEN)} stands for the number"),
    )
    return table(("UDIM", "limit"), rows)


# Programs that read maps


def engines() -> str:
    """The choices of the setting Engine: the target engines of each, the options that do the same, and what else it needs."""
    rows = []
    for preset, engine in targets.CHOICES.items():
        own = [one for one in targets.TARGETS if one.preset == preset]
        names = ", ".join(code(one.name) if one.label == preset else f"{one.label} {code(one.name)}" for one in own)
        rows.append((preset, names, options_of(engine), z_of(own), *files_of(own), settings_of(own)))
    return table(("In the panel", "Names", "Options", "Z", "Names of maps", "Export", "Import settings"), rows)


def options_of(engine: targets.Engine) -> str:
    """The options that do the same as a choice of the setting Engine."""
    values = engine.values
    said = f"--green {values['green'].lower()} --basis {word_for(values['basis'])} --depth {values['depth']}"
    said += "" if values["pack"] == Pack.NONE else f" --pack {word_for(values['pack'])}"
    return code(said + ("" if values["alpha"] else " --no-alpha"))


def z_of(own: Sequence[targets.TargetEngine]) -> str:
    return "rebuilt" if any(one.rebuilds_z for one in own) else "read"


def files_of(own: Sequence[targets.TargetEngine]) -> tuple[str, str]:
    """The names of maps and the file of the mesh of engines that share a choice."""
    return (code(own[0].names), code(own[0].export) if own[0].export else "") if own else (code(USUAL), "")


def settings_of(own: Sequence[targets.TargetEngine]) -> str:
    """What to set in engines that share a choice."""
    settings = {one.settings: one.label for one in own}
    if len(settings) < 2:
        return next(iter(settings), "Imprint sets up the material")
    return "; ".join(f"{label}: {each}" for each, label in settings.items())


UNITS = {SHARE: "%", LENGTH: "scene units"}
"""Of figures whose meaning does not say it."""


def figures() -> str:
    """The figures that can have limits, with their units. Those that differ in their end alone are in one row."""
    rows: dict[str, list[str]] = {}
    for figure in METRICS.values():
        name, meaning = figure.name, figure.meaning
        if name.startswith(TARGETS):
            _, _, *end = name.split(".")
            name, meaning = ".".join((TARGETS, "NAME", *end)), "degrees by which an engine of --targets is off"
            meaning += ", at least, once its compressor has encoded the map" if len(end) > 1 else ""
        unit = f" ({UNITS[figure.unit]})" if figure.unit in UNITS else ""
        names = rows.setdefault(f"{sentence(meaning[0].upper() + meaning[1:])[:-1]}{unit}", [])
        if code(name) not in names:
            names.append(code(name))
    return table(("metric", "what it is"), ((", ".join(names), meaning) for meaning, names in rows.items()))


TABLES: dict[str, Callable[[], str]] = {
    **{name: lambda shown=shown: panel(shown) for name, shown in PANELS.items()},
    "options": options,
    "farm-options": farm_options,
    "figures": figures,
    "file-formats": formats,
    "map-types": maps,
    "packing": layouts,
    "udim": tiles,
    "engines": engines,
}


def filled(text: str) -> str:
    """A page with its tables as they are to be. Raises KeyError for an unknown name."""
    return PLACE.sub(lambda found: f"{found[1]}\n{TABLES[found[2] or found[3]]()}\n{found[4]}", text)


def outdated() -> list[Path]:
    """The pages whose tables differ from the declarations."""
    return [page for page in PAGES if filled(text := page.read_text(encoding="utf-8")) != text]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="name the pages that differ, and write nothing")
    options = parser.parse_args()
    pages = outdated()
    for page in pages:
        print(page.relative_to(ROOT))
        if not options.check:
            page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")
    return 1 if pages and options.check else 0


if __name__ == "__main__":
    sys.exit(main())
