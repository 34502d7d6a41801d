# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads job files: sets of options, as TOML or JSON. Each set becomes arguments for the command line's parser."""

import argparse
import json
import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path

from . import arguments
from .arguments import WrongUsage
from .options import FILE, OPTIONS, STDOUT, CommandOption
from .similar_words import did_you_mean

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


class WrongJobs(WrongUsage):
    """A job file cannot be read or has mistakes. The text has a line for each part with mistakes, without a full stop."""


def read(
    name: str, more: Sequence[str] = (), on_progress: Callable[[float], None] = lambda _share: None
) -> list[argparse.Namespace]:
    """The options of each set of a job file, checked. Paths in the file start at its folder.

    more: arguments that override all sets. on_progress: called now and then with the share of the sets that was read.
    Raises WrongJobs with a line for each set that has mistakes.
    """
    path = Path(name).absolute()
    table = _load(name, path)
    defaults, sets, faults = _parts(name, table)
    words, wrong, _ = _read_keys(defaults, path.parent)
    # Mistakes in the defaults are reported once, not for each set.
    usual = {key: value for key, value in defaults.items() if _option_name(key) in words}
    if wrong:
        faults.append(f"{name}, {DEFAULTS}: {'; '.join(wrong.values())}")
    found = []
    for number, values in enumerate(sets, 1):
        if number % PROGRESS_EVERY == 0:
            on_progress(number / len(sets))
        try:
            found.append(_options({**usual, **values}, path.parent, more, wrong))
        except WrongUsage as fault:
            faults.append(f"{name}, set {number}: {fault}")
    if faults:
        raise WrongJobs("\n".join(faults))
    return found


def _options(values: dict, folder: Path, more: Sequence[str], unread: Collection[str]) -> argparse.Namespace:
    """The options of a set, checked. unread: the keys of defaults that cannot be read.

    Raises WrongUsage with all mistakes of the set.
    """
    _, wrong, options = _read_keys(values, folder, more)
    unread = {*unread, *wrong}
    faults = [*wrong.values(), *map(_plain, _mistakes(options, unread))]
    if faults:
        raise WrongUsage("; ".join(faults))
    return options


def _mistakes(options: argparse.Namespace, unread: Collection[str]) -> Iterator[str]:
    has_file = options.file or options.low_file or arguments.is_folder(options)
    if not has_file and not {"file", "low-file", "pairs"}.intersection(unread):
        yield "file, low-file or a folder for pairs is missing"
    if options.report and arguments.is_folder(options):
        yield "report: the pairs of a folder have no report of their own, use --report on the command line"
    yield from arguments.mistakes(options, unread)


def _plain(message: str) -> str:
    """A message about options as one about keys, which are written without dashes."""
    return re.sub(r"(?<!\S)--(?=\w)", "", message).removeprefix("argument ").rstrip(".")


def _load(name: str, path: Path) -> dict:
    readers = {".toml": tomllib.loads, ".json": json.loads}
    if path.suffix.lower() not in readers:
        raise WrongJobs(f"{name!r} does not end in .toml or .json")
    try:
        return readers[path.suffix.lower()](path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise WrongJobs(f"{name!r} cannot be read: {error.strerror}") from error
    except RecursionError as error:
        raise WrongJobs(f"{name!r} is nested too deeply to be a list of sets") from error
    except ValueError as error:  # the error of all three decoders
        raise WrongJobs(f"{name!r} is no {path.suffix[1:].upper()}: {error}") from error


def _parts(name: str, table) -> tuple[dict, list[dict], list[str]]:
    """The defaults, the sets, and a line for each other part. Raises WrongJobs if there are no sets to check."""
    if not isinstance(table, dict):
        raise WrongJobs(f"{name}: a table with {SETS!r}, a list of sets, is expected")
    faults = []
    for key in table:
        try:
            _check_known(key, key, (DEFAULTS, SETS))
        except WrongUsage as fault:
            faults.append(f"{name}: {fault}")
    defaults, sets = table.get(DEFAULTS, {}), table.get(SETS, [])
    if not isinstance(defaults, dict):
        faults.append(f"{name}: {DEFAULTS!r} must be a table")
        defaults = {}
    if not isinstance(sets, list) or not sets or not all(isinstance(values, dict) for values in sets):
        if SETS in table or not faults:  # otherwise an unknown key may stand for it
            faults.append(f"{name}: {SETS!r} must be a list of sets, and not empty")
        raise WrongJobs("\n".join(faults))
    return defaults, sets, faults


def _check_known(key: str, written: str, known: Iterable[str]) -> None:
    if key not in known:
        raise WrongUsage(f"unknown key {written!r}{did_you_mean([key], known)}")


def _option_name(key: str) -> str:
    return key.replace("_", "-")


def _read_keys(
    values: dict, folder: Path, more: Sequence[str] = ()
) -> tuple[dict[str, list[str]], dict[str, str], argparse.Namespace]:
    """A set as arguments of the command line, by key; what is wrong with the other keys; and the options."""
    words, wrong = {}, {}
    for written, value in values.items():
        key = _option_name(written)
        try:
            words[key] = _key_arguments(written, key, value, folder)
        except WrongUsage as fault:
            wrong[key] = _plain(str(fault))
    try:
        return words, wrong, _parsed(words, more)
    except WrongUsage:  # one by one, so that all mistakes are found
        for key in list(words):
            try:
                arguments.parse(words[key])
            except WrongUsage as fault:
                wrong[key] = _plain(str(fault))
                del words[key]
    return words, wrong, _parsed(words, more)


def _parsed(words: dict[str, list[str]], more: Sequence[str] = ()) -> argparse.Namespace:
    """The options of a set. more: arguments that override it. Raises WrongUsage."""
    files = words.get("file", [])
    return arguments.parse([*files, *(word for key in words if key != "file" for word in words[key]), *more])


def _key_arguments(written: str, key: str, value, folder: Path) -> list[str]:
    """A key with its value as arguments. Raises WrongUsage."""
    words = _words_of(written, key, value)
    if KEYS[key].is_path:
        words = [str(folder / word) if word else word for word in words]
    if key == "file":
        return words
    return [f"--{key}"] if value is True else [f"--{key}={word}" for word in words]


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
