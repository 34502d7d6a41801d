# SPDX-License-Identifier: GPL-3.0-or-later
"""The words of the command line: one table for its options, from which job files are read as well."""

import argparse
import difflib
import functools
import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import PurePath

from ..core import file_formats, map_types, udim
from ..core.errors import BakeError
from ..core.name_matching import Suffixes
from ..core.settings import (
    AXES,
    BASES,
    DIRECTIONS,
    MARGINS,
    MAX_MIPS,
    METHODS,
    MODIFIERS,
    SAMPLES,
    SPACES,
    Settings,
    is_number,
)

LAST_FRAME = 1_048_574
"""Blender knows no frame after it."""
MANY_FRAMES = 100_000
"""More frames than this are a slip of the keyboard: all that they write is compared before the first is baked."""
STDOUT = "-"
"""A report's path that is none: standard output."""


class WrongUsage(Exception):
    """What was asked for cannot be understood, or contradicts itself. Its text is for the person, without a full stop."""


def text(value: str) -> str:
    """A name, or a path."""
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise argparse.ArgumentTypeError(f"{value!r} is not UTF-8, as all names in Blender are") from error
    if "\0" in value:
        raise argparse.ArgumentTypeError(f"{value!r} holds a zero")
    return value


def path(value: str) -> str:
    """A path. In a job file it starts at the job file's folder."""
    if not value:
        raise argparse.ArgumentTypeError("a path is empty")
    # Two slashes are one to the system, and the folder of the open file to Blender. On Windows they start a server's name.
    return text(value if os.name == "nt" else re.sub("^//+", "/", value))


def _size(value: str) -> tuple[int, int]:
    sides = value.lower().split("x")
    if len(sides) > 2 or not all(map(is_number, sides)):
        raise argparse.ArgumentTypeError(f"{value!r} is neither a number of texels nor two of them as 4096x1024")
    return int(sides[0]), int(sides[-1])


def _margin(value: str) -> int | None:
    if value.lower() == "unlimited":
        return None
    try:
        return int(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{value!r} is neither a number of texels nor unlimited") from error


def _frames(value: str) -> tuple[int, int]:
    first, _, last = value.partition("-")
    if not (is_number(first) and is_number(last)) or int(first) > int(last):
        raise argparse.ArgumentTypeError(f"{value!r} is not a range of frames as 1-48")
    if int(last) > LAST_FRAME or int(last) - int(first) >= MANY_FRAMES:
        raise argparse.ArgumentTypeError(
            f"{value!r} is too long: frames go up to {LAST_FRAME}, and {MANY_FRAMES} of them are baked at a time"
        )
    return int(first), int(last)


def _suffixes(value: str) -> Suffixes:
    parts = value.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"{value!r} is not three endings as _low,_high,_cage")
    return Suffixes(*parts)


def _colour(value: str) -> tuple[float, float, float]:
    try:
        red, green, blue = (float(part) for part in value.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{value!r} is not three numbers as 1,0,1") from error
    return red, green, blue


def _tiles(value: str) -> tuple[int, ...]:
    try:
        return udim.parse(value)
    except BakeError as error:
        raise argparse.ArgumentTypeError(str(error).rstrip(".")) from error


def _word(name: str) -> str:
    """What a person types for one of the settings' names."""
    return name.lower().replace("_", "-")


def _name_among(names: Collection[str]) -> Callable[[str], str]:
    """Takes a word to one of the settings' names."""
    words = {_word(name): name for name in names}

    def name(value: str) -> str:
        if _word(value) not in words:
            raise argparse.ArgumentTypeError(f"{value!r} is not one of {', '.join(words)}")
        return words[_word(value)]

    return name


def _maps(value: str) -> tuple[str, ...]:
    name = _name_among(map_types.NAMES)
    wanted = {name(part.strip()) for part in value.split(",")}
    return tuple(name for name in map_types.NAMES if name in wanted)


def _one_of(names: Sequence[str], **more) -> dict:
    """An option that takes one of the settings' names."""
    return {"type": _name_among(names), "metavar": "|".join(map(_word, names)), **more}


_FORMATS = ", ".join(
    f"{ending} ({' or '.join(map(str, one.depths))} bits)" for ending, one in file_formats.BY_ENDING.items()
)
_USUAL = Settings()

OPTIONS: dict[str, dict[str, dict]] = {
    "what to bake": {
        "low": {"type": text, "metavar": "NAME", "help": "the object that gets the map"},
        "high": {
            "type": text,
            "action": "append",
            "default": [],
            "metavar": "NAME",
            "help": "an object with detail; may be given again (default: the low object with its modifiers)",
        },
        "cage": {"type": text, "metavar": "NAME", "help": "a mesh with the low one's topology: rays start on it"},
        "low-file": {"type": path, "metavar": "FILE", "help": "instead of names: the file of the one low mesh"},
        "high-file": {
            "type": path,
            "action": "append",
            "default": [],
            "metavar": "FILE",
            "help": "a file whose meshes have detail; may be given again",
        },
        "cage-file": {"type": path, "metavar": "FILE", "help": "the file of the one mesh that is the cage"},
        "pairs": {
            "type": path,
            "nargs": "?",
            "const": True,
            "metavar": "DIR",
            "help": "bake x_low against x_high, x_high_2, ... with x_cage, for every x: objects of FILE, or with DIR the files "
            "in that folder",
        },
        "suffixes": {
            "type": _suffixes,
            "default": Suffixes(),
            "metavar": "LOW,HIGH,CAGE",
            "help": "what --pairs looks for at the end of names (default: _low,_high,_cage)",
        },
        "uv": {
            "type": text,
            "dest": "uv_layer",
            "default": _USUAL.uv_layer,
            "metavar": "NAME",
            "help": "the low mesh's UV map (default: its active one)",
        },
        "modifiers": _one_of(
            MODIFIERS, default=_USUAL.modifiers, help="whose levels and visibility count (default: render)"
        ),
    },
    "rays": {
        "method": _one_of(
            METHODS,
            default=_USUAL.method,
            help="flatten draws meshes that share UVs, cast sends rays, auto (default) measures which of them fits",
        ),
        "extrusion": {"type": float, "metavar": "D", "help": "where rays start, outside the low mesh (measured)"},
        "max-distance": {"type": float, "metavar": "D", "help": "how far rays go from there (measured)"},
        "directions": _one_of(
            DIRECTIONS,
            default=_USUAL.directions,
            help="which of the low mesh's normals rays follow (default: smooth)",
        ),
        "facing-only": {"action": "store_true", "help": "rays pass through triangles seen from behind"},
        "limit": {
            "type": float,
            "metavar": "D",
            "help": "how far high and low surface may lie apart before it is told (default: 5 %% of the low mesh's radius)",
        },
    },
    "map": {
        "space": _one_of(SPACES, default=_USUAL.space, help="what normals are relative to (default: tangent)"),
        "basis": _one_of(
            BASES,
            default=_USUAL.basis,
            help="what reads the tangent-space map: blender is Cycles' Normal Map node, mikktspace EEVEE's and that of game "
            "engines; auto (default) is what the scene's render engine reads, for mesh files mikktspace",
        ),
        "size": {
            "type": _size,
            "default": (_USUAL.width, _USUAL.height),
            "metavar": "2048|4096x1024",
            "help": f"in texels (default: {_USUAL.width})",
        },
        "samples": {
            "type": int,
            "choices": SAMPLES,
            "default": _USUAL.samples,
            "help": "a texel; several are antialiased (default: %(default)s)",
        },
        **{
            channel: {
                "type": _name_among(AXES),
                "default": getattr(_USUAL, channel),
                "metavar": "AXIS",
                "help": f"what the {channel} channel holds: {hint} (default: {getattr(_USUAL, channel).lower()})",
            }
            for channel, hint in (
                ("red", "+x, -x, +y, -y, +z or -z"),
                ("green", "+y is OpenGL's, -y DirectX's"),
                ("blue", "as red"),
            )
        },
        "margin": {
            "type": _margin,
            "default": _USUAL.margin,
            "metavar": "TEXELS|unlimited",
            "help": "around the UV islands (default: %(default)s)",
        },
        "margin-type": _one_of(
            MARGINS,
            default=_USUAL.margin_type,
            help="filled with the nearest texel, or with what lies across the seam (default: extend)",
        ),
        "mips": {
            "type": int,
            "choices": range(MAX_MIPS + 1),
            "default": _USUAL.mips,
            "metavar": "LEVELS",
            "help": "how many mip levels the checks want clean: 3 take 8 texels between UV islands (default: %(default)s)",
        },
        "missed": {
            "type": _colour,
            "default": _USUAL.missed,
            "metavar": "R,G,B",
            "help": "colour where rays hit nothing (default: 0.5,0.5,1)",
        },
        "mask": {"action": "store_true", "help": "a mask of misses as well, in a file beside the map"},
        "maps": {
            "type": _maps,
            "default": _USUAL.maps,
            "metavar": "MAP,MAP...",
            "help": f"these as well, in files beside the map: {', '.join(map(_word, map_types.NAMES))}",
        },
        "udim": {"action": "store_true", "help": "a map for each UDIM tile; so does <UDIM> in --output"},
        "tiles": {
            "type": _tiles,
            "default": _USUAL.tiles,
            "metavar": "1001,1002...",
            "help": "these UDIM tiles alone (default: all that the low mesh covers, 100 at the most)",
        },
        "frames": {
            "type": _frames,
            "metavar": "1-48",
            "help": "a map for each of these frames; its number stands for ### in --output, or before the ending",
        },
    },
    "output": {
        "output": {
            "type": path,
            "metavar": "MAP",
            "help": f"the file to write: {_FORMATS}. {{low}} in it stands for the low object's name, or that of the "
            "file it came from alone; <UDIM> for the tile's number",
        },
        "depth": {
            "type": int,
            "choices": file_formats.DEPTHS,
            "help": f"bits a channel (default: {file_formats.USUAL_DEPTH}, or the most below that the format has)",
        },
        "dither": {"action": "store_true", "help": "dither 8 bits instead of rounding"},
        "image": {
            "type": text,
            "default": _USUAL.image,
            "metavar": "NAME",
            "help": "the image datablock (default: LOW_normal)",
        },
        "no-material": {"action": "store_false", "dest": "material", "help": "leave the low object's material alone"},
        "single-user": {"action": "store_true", "help": "copy materials that other objects use as well"},
        "save-blend": {"type": path, "metavar": "OUT.blend", "help": "save the scene with the map hooked up"},
        "report": {
            "type": path,
            "metavar": "REPORT.json",
            "help": "write what was done, as JSON; - for standard output",
        },
    },
}
"""The options without their dashes, by the group that --help shows them in, as argparse.add_argument takes them."""

SUBJECTS = ("low", "high", "cage", "low-file", "high-file", "cage-file", "pairs")
"""The options that name what to bake."""

FILE = {
    "nargs": "*",
    "type": path,
    "metavar": "FILE",
    "help": "a .blend to open (default: the one that is open), or files to import into an empty scene together: .obj, "
    ".ply, .stl, .gltf, .glb, .fbx, .usd, .usda, .usdc",
}
JOBS = {
    "type": path,
    "metavar": "FILE",
    "help": "bake the sets that a .toml or .json file lists; other options count for all of them, over what it says",
}


def meant(word: str, known: Iterable[str]) -> str:
    """The question that ends a sentence about an unknown word; empty where none is like it."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        unknown = re.match("unrecognized arguments: (--[^ =]+)", message)
        raise WrongUsage(message + (meant(unknown[1], _names()) if unknown else ""))


def _names() -> Iterator[str]:
    """All options, with their dashes."""
    return (f"--{name}" for name in ("jobs", *(name for options in OPTIONS.values() for name in options)))


@functools.cache
def parser(program: str) -> argparse.ArgumentParser:
    """Of the command line. It raises WrongUsage. Defaults are those of Settings, but for the file."""
    result = _Parser(
        prog=program,
        usage="%(prog)s [FILE ...] --low NAME [--high NAME ...] --output MAP [option ...]\n"
        "       %(prog)s [FILE ...] --pairs [DIR] --output MAP [option ...]\n"
        "       %(prog)s --low-file FILE --high-file FILE ... --output MAP [option ...]\n"
        "       %(prog)s --jobs FILE [--report REPORT.json] [option ...]",
        description="Bake the detail of high meshes into a normal map.",
        allow_abbrev=False,
    )
    for title, options in OPTIONS.items():
        group = result.add_argument_group(title)
        if title == "what to bake":
            group.add_argument("file", **FILE)
            group.add_argument("--jobs", **JOBS)
        for name, option in options.items():
            group.add_argument(f"--{name}", **option)
    return result


def parse(arguments: Sequence[str], program: str = "imprint") -> argparse.Namespace:
    """The options that `arguments` say, one by one; `check` looks at them together. Raises WrongUsage."""
    options = parser(program).parse_intermixed_args(_joined(arguments))
    if options.pairs is True and len(options.file) == 1 and os.path.isdir(options.file[0]):
        options.pairs, options.file = options.file[0], []
    elif options.pairs not in (None, True) and not options.file and os.path.isfile(options.pairs):
        options.file, options.pairs = [options.pairs], True  # `--pairs FILE.blend`
    return options


def split_jobs(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """--jobs and --report, and the other arguments, which count for all sets. Raises WrongUsage."""
    own = _Parser(add_help=False, allow_abbrev=False)
    own.add_argument("--jobs", **JOBS)
    own.add_argument("--report", **OPTIONS["output"]["report"])
    known, more = own.parse_known_args(_joined(arguments))
    rest = parse(more)
    if rest.file or any(vars(rest)[name.replace("-", "_")] for name in SUBJECTS):
        raise WrongUsage("--jobs FILE names what to bake: name nothing beside it")
    return known, more


def check(options: argparse.Namespace) -> None:
    """Raise WrongUsage for options that miss or contradict each other."""
    named = [name for name in ("low", "pairs", "low_file") if vars(options)[name]]
    by_file = options.low_file or options.high_file or options.cage_file
    if not named:
        raise WrongUsage("one of --low, --low-file and --pairs is required")
    if len(named) > 1:
        raise WrongUsage("--low, --low-file and --pairs exclude each other")
    if not options.output:
        raise WrongUsage("--output is required")
    if options.pairs and options.frames:
        raise WrongUsage("--frames is for one low object, --pairs for many")
    if options.pairs and (options.high or options.cage or by_file):
        raise WrongUsage("--pairs finds the high objects and the cages by itself")
    if by_file and (options.file or options.low or options.high or options.cage):
        raise WrongUsage("--low-file, --high-file and --cage-file go together, without FILE, --low, --high and --cage")
    if is_folder(options):
        if options.file:
            raise WrongUsage("--pairs DIR takes the files of that folder: name no others")
        if "{low}" not in options.output:
            raise WrongUsage("--pairs DIR makes a map for each pair: put {low} into --output")
        if options.save_blend:
            raise WrongUsage("--pairs DIR has a scene for each pair: --save-blend saves one alone")
    if options.save_blend and PurePath(options.save_blend).suffix != ".blend":
        raise WrongUsage(f"{options.save_blend!r} does not end in .blend")
    files = [options.low_file, *options.high_file, options.cage_file]
    _check_folder([options.output, options.report, options.save_blend, options.pairs, *options.file, *files])
    try:
        settings(options).check()
    except BakeError as error:
        raise WrongUsage(str(error).rstrip(".")) from error


def _check_folder(paths: Sequence[str | bool | None]) -> None:
    """Raise WrongUsage if one of `paths` starts in the folder that we are in, and Blender could not go there."""
    if not any(isinstance(name, str) and not os.path.isabs(name) for name in paths):
        return
    try:
        here = os.getcwd()
    except OSError as error:
        raise WrongUsage(f"the folder that this was started in cannot be read: {error.strerror}") from error
    try:
        here.encode()
    except UnicodeEncodeError as error:
        raise WrongUsage(
            f"the folder {here!r} is not UTF-8, as all paths in Blender are: start in another one"
        ) from error


def is_folder(options: argparse.Namespace) -> bool:
    """Whether pairs of files are to be baked."""
    return isinstance(options.pairs, str)


def settings(options: argparse.Namespace) -> Settings:
    """What the bake is to do. The map goes to a file, of the usual depth if none is asked for."""
    given = vars(options)
    values = {field.name: given[field.name] for field in fields(Settings) if field.name in given}
    values["width"], values["height"] = options.size
    values["storage"], values["output"] = "FILE", os.path.abspath(options.output)
    values["udim"] = options.udim or bool(options.tiles) or udim.TOKEN in options.output
    if options.depth is None:
        values["depth"] = file_formats.usual_depth(options.output)
    return Settings(**values)


def _joined(arguments: Sequence[str]) -> list[str]:
    """argparse takes the -y of `--green -y` for an option of its own; `--green=-y` it understands."""
    result, words = [], iter(arguments)
    for word in words:
        value = next(words, None) if word in {"--red", "--green", "--blue"} else None
        result.append(word if value is None else f"{word}={value}")
    return result
