# SPDX-License-Identifier: GPL-3.0-or-later
"""Parses the command line, checks its options together, and makes settings from them."""

import argparse
import difflib
import functools
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import PurePath

from ...core import file_formats, udim
from ...core.declarations.choices import Storage
from ...core.errors import BakeError
from ...core.settings import Settings
from .options import FILE, JOBS, OPTIONS, SUBJECTS


class WrongUsage(Exception):
    """The arguments are unknown or contradict each other. The text is for the user, without a full stop."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The end of a sentence about an unknown word; empty where no known word is similar."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        unknown = re.match("unrecognized arguments: (--[^ =]+)", message)
        raise WrongUsage(message + (did_you_mean(unknown[1], _names()) if unknown else ""))


def _names() -> Iterator[str]:
    """The names of all options, with their dashes."""
    return (f"--{name}" for name in ("jobs", *(name for options in OPTIONS.values() for name in options)))


@functools.cache
def parser(program: str) -> argparse.ArgumentParser:
    """The parser of the command line. It raises WrongUsage."""
    result = _Parser(
        prog=program,
        usage="%(prog)s [FILE ...] --low NAME [--high NAME ...] --output MAP [option ...]\n"
        "       %(prog)s [FILE ...] --pairs [DIR] --output MAP [option ...]\n"
        "       %(prog)s --low-file FILE --high-file FILE ... --output MAP [option ...]\n"
        "       %(prog)s --jobs FILE [--report REPORT.json] [option ...]",
        description="Bake the detail of high-poly meshes into the normal map of a low-poly mesh.",
        allow_abbrev=False,
    )
    for title, options in OPTIONS.items():
        group = result.add_argument_group(title)
        if title == "what to bake":
            group.add_argument("file", **FILE.arguments)
            group.add_argument("--jobs", **JOBS.arguments)
        for name, option in options.items():
            group.add_argument(f"--{name}", **option.arguments)
    return result


def parse(arguments: Sequence[str], program: str = "imprint") -> argparse.Namespace:
    """The options in `arguments`, each checked by itself. Raises WrongUsage."""
    options = parser(program).parse_intermixed_args(_joined(arguments))
    if options.pairs is True and len(options.file) == 1 and os.path.isdir(options.file[0]):
        options.pairs, options.file = options.file[0], []
    elif options.pairs not in (None, True) and not options.file and os.path.isfile(options.pairs):
        options.file, options.pairs = [options.pairs], True  # `--pairs FILE.blend`
    return options


def split_jobs(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """The options --jobs and --report, and the other arguments, which override all sets. Raises WrongUsage."""
    own = _Parser(add_help=False, allow_abbrev=False)
    own.add_argument("--jobs", **JOBS.arguments)
    own.add_argument("--report", **OPTIONS["output"]["report"].arguments)
    known, more = own.parse_known_args(_joined(arguments))
    rest = parse(more)
    if rest.file or any(vars(rest)[name.replace("-", "_")] for name in SUBJECTS):
        raise WrongUsage("--jobs FILE names what to bake: name nothing beside it")
    return known, more


def check(options: argparse.Namespace) -> None:
    """Raise WrongUsage for options that are missing or contradict each other."""
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
    """Raise WrongUsage if one of `paths` is relative and Blender cannot use the current folder."""
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
    """Whether the options bake the pairs of a folder of mesh files."""
    return isinstance(options.pairs, str)


def settings(options: argparse.Namespace) -> Settings:
    """The settings of the bake. The map goes to a file, of the format's usual depth if no depth is given."""
    given = vars(options)
    values = {field.name: given[field.name] for field in fields(Settings) if field.name in given}
    values["width"], values["height"] = options.size
    values["storage"], values["output"] = Storage.FILE, os.path.abspath(options.output)
    values["udim"] = options.udim or bool(options.tiles) or udim.TOKEN in options.output
    if options.depth is None:
        values["depth"] = file_formats.usual_depth(options.output)
    return Settings(**values)


def _joined(arguments: Sequence[str]) -> list[str]:
    """The arguments with `--green -y` as `--green=-y`: argparse takes the single -y for an option."""
    result, words = [], iter(arguments)
    for word in words:
        value = next(words, None) if word in {"--red", "--green", "--blue"} else None
        result.append(word if value is None else f"{word}={value}")
    return result
