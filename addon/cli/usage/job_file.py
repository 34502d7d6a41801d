# SPDX-License-Identifier: GPL-3.0-or-later
"""Job files: what to bake, in sets, as TOML or JSON. Each set becomes arguments, which the command line's parser reads."""

import argparse
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from ...core.errors import BakeError
from . import arguments
from .arguments import WrongUsage
from .options import FILE, OPTIONS, STDOUT, CommandOption

DEFAULTS, SETS = "defaults", "bake"
TOLD_EVERY = 100
"""Sets between two words about how far the reading is."""
MOST_SAID = 80
"""Characters of a wrong value that are shown."""
KEYS: dict[str, CommandOption] = {
    "file": FILE,
    **{name: option for options in OPTIONS.values() for name, option in options.items()},
}
"""The keys of a set."""


def read(
    name: str, more: Sequence[str] = (), tell: Callable[[float], None] = lambda _share: None
) -> list[argparse.Namespace]:
    """The options of each set of a job file, checked; `more` are arguments that count for all of them.

    `tell` hears from time to time what share of the sets was read. Paths in the file start at its folder. Raises
    WrongUsage with a line for each set that has a fault.
    """
    path = Path(name).absolute()
    table = _load(name, path)
    defaults, sets = _parts(name, table)
    # Apart, so that what is wrong there is not told for each set.
    faults = list(_faults(f"{name}, {DEFAULTS}", lambda: arguments.parse(_arguments(defaults, path.parent))))
    found = []

    def take(values: dict) -> None:
        options = arguments.parse([*_arguments({**defaults, **values}, path.parent), *more])
        if not options.file and not options.low_file and not arguments.is_folder(options):
            raise WrongUsage("file, low-file or a folder for pairs is missing")
        if options.report and arguments.is_folder(options):
            raise WrongUsage("report: the pairs of a folder are told of by --report of the command line alone")
        arguments.check(options)
        found.append(options)

    for number, values in enumerate([] if faults else sets, 1):
        if number % TOLD_EVERY == 0:
            tell(number / len(sets))
        faults += _faults(f"{name}, set {number}", lambda values=values: take(values))
    if faults:
        raise WrongUsage("\n".join(faults))
    return found


def _faults(where: str, act) -> Iterator[str]:
    """What is wrong with a part of the file, if anything is."""
    try:
        act()
    except (WrongUsage, BakeError) as error:
        said = re.sub(r"(?<!\S)--(?=\w)", "", str(error))  # keys have no dashes in front
        yield f"{where}: {said.removeprefix('argument ').rstrip('.')}"


def _load(name: str, path: Path) -> dict:
    readers = {".toml": tomllib.loads, ".json": json.loads}
    if path.suffix.lower() not in readers:
        raise WrongUsage(f"{name!r} does not end in .toml or .json")
    try:
        return readers[path.suffix.lower()](path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise WrongUsage(f"{name!r} cannot be read: {error.strerror}") from error
    except RecursionError as error:
        raise WrongUsage(f"{name!r} is nested too deeply to be a list of sets") from error
    except ValueError as error:  # what all three decoders raise
        raise WrongUsage(f"{name!r} is no {path.suffix[1:].upper()}: {error}") from error


def _parts(name: str, table) -> tuple[dict, list[dict]]:
    """The defaults and the sets."""
    if not isinstance(table, dict):
        raise WrongUsage(f"{name}: a table with {SETS!r}, a list of sets, is expected")
    for key in table:
        try:
            _check_known(key, key, (DEFAULTS, SETS))
        except WrongUsage as fault:
            raise WrongUsage(f"{name}: {fault}") from fault
    defaults, sets = table.get(DEFAULTS, {}), table.get(SETS, [])
    if not isinstance(defaults, dict):
        raise WrongUsage(f"{name}: {DEFAULTS!r} must be a table")
    if not isinstance(sets, list) or not sets or not all(isinstance(values, dict) for values in sets):
        raise WrongUsage(f"{name}: {SETS!r} must be a list of sets, and not empty")
    return defaults, sets


def _check_known(key: str, written: str, known: Iterable[str]) -> None:
    if key not in known:
        raise WrongUsage(f"unknown key {written!r}{arguments.did_you_mean(key, known)}")


def _arguments(values: dict, folder: Path) -> list[str]:
    """A set as the command line says it."""
    result, files, faults = [], [], []
    for written, value in values.items():
        key = written.replace("_", "-")
        try:
            words = _words_of(written, key, value)
        except WrongUsage as fault:  # of which all are told at once
            faults.append(str(fault))
            continue
        if KEYS[key].is_path:
            words = [str(folder / word) if word else word for word in words]
        if key == "file":
            files = words
        elif value is True:
            result.append(f"--{key}")
        else:
            result += [f"--{key}={word}" for word in words]
    if faults:
        raise WrongUsage("; ".join(faults))
    return [*files, *result]


def _words_of(written: str, key: str, value) -> list[str]:
    """As `_words`, for keys that may be unknown."""
    _check_known(key, written, KEYS)
    words = _words(key, value)
    if key == "report" and STDOUT in words:
        raise WrongUsage(f"report: {STDOUT!r}, standard output, is for the command line alone")
    return words


def _short(value) -> str:
    """A value as JSON has it, which may be of any length and depth."""
    try:
        said = json.dumps(value, default=str)
    except RecursionError:
        return "lists in lists"
    return said if len(said) <= MOST_SAID else f"{said[:MOST_SAID]}…"


def _words(key: str, value) -> list[str]:
    """A value as words of the command line: one of them, or several where an option may be given again."""
    option = KEYS[key]
    if isinstance(value, bool) and option.may_be_flag:
        return []
    parts = value if isinstance(value, list) else [value]
    types = str if option.is_text else (str, int, float)
    fits = all(isinstance(part, types) and not isinstance(part, bool) for part in parts)
    is_one = not isinstance(value, list) or option.may_repeat or not option.is_text
    if option.is_flag or not fits or not is_one:
        raise WrongUsage(f"{key}: {option.value} is expected, not {_short(value)}")
    return list(map(str, parts)) if option.is_text else [",".join(map(str, parts))]
