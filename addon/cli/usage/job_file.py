# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads job files: sets of options, as TOML or JSON. Each set becomes arguments for the command line's parser."""

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
PROGRESS_EVERY = 100
"""Sets between two calls of the progress function."""
MOST_SHOWN = 80
"""Characters of a wrong value in a message."""
KEYS: dict[str, CommandOption] = {
    "file": FILE,
    **{name: option for options in OPTIONS.values() for name, option in options.items()},
}
"""The keys of a set."""


def read(
    name: str, more: Sequence[str] = (), on_progress: Callable[[float], None] = lambda _share: None
) -> list[argparse.Namespace]:
    """The options of each set of a job file, checked. Paths in the file start at its folder.

    more: arguments that override all sets. on_progress: called now and then with the share of the sets that was read.
    Raises WrongUsage with a line for each set that has a mistake.
    """
    path = Path(name).absolute()
    table = _load(name, path)
    defaults, sets = _parts(name, table)
    # Checked first, so that a mistake in the defaults is not reported for each set.
    faults = list(_faults(f"{name}, {DEFAULTS}", lambda: arguments.parse(_arguments(defaults, path.parent))))
    found = []

    def take(values: dict) -> None:
        options = arguments.parse([*_arguments({**defaults, **values}, path.parent), *more])
        if not options.file and not options.low_file and not arguments.is_folder(options):
            raise WrongUsage("file, low-file or a folder for pairs is missing")
        if options.report and arguments.is_folder(options):
            raise WrongUsage(
                "report: the pairs of a folder have no report of their own, use --report on the command line"
            )
        arguments.check(options)
        found.append(options)

    for number, values in enumerate([] if faults else sets, 1):
        if number % PROGRESS_EVERY == 0:
            on_progress(number / len(sets))
        faults += _faults(f"{name}, set {number}", lambda values=values: take(values))
    if faults:
        raise WrongUsage("\n".join(faults))
    return found


def _faults(where: str, act) -> Iterator[str]:
    """The mistake in a part of the file, if there is one."""
    try:
        act()
    except (WrongUsage, BakeError) as error:
        message = re.sub(r"(?<!\S)--(?=\w)", "", str(error))  # keys are written without dashes
        yield f"{where}: {message.removeprefix('argument ').rstrip('.')}"


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
    except ValueError as error:  # the error of all three decoders
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
    """A set as arguments of the command line."""
    result, files, faults = [], [], []
    for written, value in values.items():
        key = written.replace("_", "-")
        try:
            words = _words_of(written, key, value)
        except WrongUsage as fault:  # all mistakes of a set are reported at once
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
    """The value as words, for a key that may be unknown."""
    _check_known(key, written, KEYS)
    words = _words(key, value)
    if key == "report" and STDOUT in words:
        raise WrongUsage(f"report: {STDOUT!r}, standard output, works only on the command line")
    return words


def _short(value) -> str:
    """A value as JSON, cut to MOST_SHOWN characters."""
    try:
        text = json.dumps(value, default=str)
    except RecursionError:
        return "lists in lists"
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


def _words(key: str, value) -> list[str]:
    """A value as words of the command line: several where the option may be repeated, else one."""
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
