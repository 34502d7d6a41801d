# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads job files: sets of options, as TOML or JSON, whose values mean what the same words mean to the command line."""

import argparse
import json
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..core.naming import did_you_mean
from . import arguments, option_types
from .commands import ASSET, LOD, WrongUsage
from .options import FILE, OPTIONS, RUN_OPTIONS, CommandOption
from .run_report import STDOUT, ranges

MOST_SHOWN = 80
"""Characters of a wrong value in a message."""
KEYS: dict[str, CommandOption] = {
    "file": FILE,
    **{name: option for options in OPTIONS.values() for name, option in options.items()},
}
"""The keys of a set."""


def _name(key: str) -> str:
    """The attribute of the options that a key sets."""
    return KEYS[key].parsing.get("dest") or key.replace("-", "_")


def _parsed(key: str, words: Sequence[str]) -> Any:
    """What the parser makes of the words of a key; none for a flag. Raises WrongUsage."""
    option = KEYS[key]
    parsing = option.parsing
    if option.is_flag:
        return parsing["action"] == "store_true"
    if not words:
        return parsing["const"]
    with suppress(argparse.ArgumentTypeError, TypeError, ValueError):
        values = [parsing["type"](word) for word in words]
        if option.may_repeat:
            return values
        if values[0] in parsing.get("choices", values):
            return values[0]
    # The parser is slower, and has the message.
    return vars(arguments.parse(words if key == "file" else [f"--{key}={word}" for word in words]))[_name(key)]


def _check_known(written: str, known: Collection[str]) -> str:
    """The key that was written, with dashes or underscores. Raises WrongUsage for an unknown one."""
    key = written.replace("_", "-")
    if key in known:
        return key
    if key in RUN_OPTIONS:
        raise WrongUsage(f"unknown key {written!r}: it works only on the command line")
    for command in (ASSET, LOD):
        if key in command.options:
            raise WrongUsage(f"unknown key {written!r}: it is for the command {command.name}, which no job file calls")
    raise WrongUsage(f"unknown key {written!r}{did_you_mean([key], known)}")


def _short(value) -> str:
    """A value as JSON, cut to MOST_SHOWN characters."""
    try:
        text = json.dumps(value, default=str)
    except RecursionError:
        return "lists in lists"
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


def _words(key: str, value) -> list[str]:
    """A value as words of the command line: several where the option may be repeated, else one; none for a flag.

    Raises WrongUsage for a value of another type.
    """
    option = KEYS[key]
    if isinstance(value, bool) and option.may_be_flag:
        return []
    parts = value if isinstance(value, list) else [value]
    if option.takes_tables:
        parts = [json.dumps(part) if isinstance(part, dict) else part for part in parts]
    types = str if option.is_text else (str, int, float)
    fits = all(isinstance(part, types) and not isinstance(part, bool) for part in parts)
    is_one = not isinstance(value, list) or option.may_repeat or not option.is_text
    if option.is_flag or not fits or not is_one:
        raise WrongUsage(f"{key}: {option.value} is expected, not {_short(value)}")
    words = list(map(str, parts)) if option.is_text or not parts else [",".join(map(str, parts))]
    if key == "report" and STDOUT in words:
        raise WrongUsage(f"report: {STDOUT!r}, standard output, works only on the command line")
    return words


DEFAULTS, SETS = "defaults", "bake"
PROGRESS_EVERY = 100
"""Sets between two calls of the progress function."""


class WrongJobs(WrongUsage):
    """A job file cannot be read or has mistakes. The text has a line for each part with mistakes, without a full stop."""

    def __init__(
        self,
        text: str,
        told: Sequence[str] = (),
        right: Mapping[int, argparse.Namespace] = MappingProxyType({}),
    ):
        """told: the lines to print, where sets with the same mistakes share one. right: the options of the sets without
        mistakes, by their numbers."""
        super().__init__(text)
        self.told, self.right = list(told) or text.splitlines(), right


def of_keys(values: Mapping[str, Any], over: Mapping[str, Any]) -> argparse.Namespace:
    """The options of a set that is no file's, with whole paths. over: options that override it, by the names of their values.

    Raises WrongUsage with all mistakes.
    """
    options, wrong = _Reader(Path()).read(dict(values))
    vars(options).update(over)
    if wrong:
        raise WrongUsage("; ".join(wrong.values()))
    return arguments.completed(options)


def read(
    name: str,
    more: Sequence[str] = (),
    on_progress: Callable[[float], None] = lambda _share: None,
    *,
    is_untrusted: bool = False,
) -> list[argparse.Namespace]:
    """The options of each set of a job file, checked. Paths in the file start at its folder.

    more: arguments that override all sets. on_progress: called now and then with the share of the sets that was read.
    is_untrusted: whether it may read no variables. Raises WrongJobs with a line for each set that has mistakes.
    """
    path = Path(name).absolute()
    table = _load(name, path)
    defaults, sets, problems = _parts(name, table)
    reader = _Reader(path.parent, more, is_untrusted=is_untrusted)
    _, wrong = reader.read(defaults)
    # Mistakes in the defaults are reported once, not for each set.
    defaults = {key: value for key, value in defaults.items() if key.replace("_", "-") not in wrong}
    if wrong:
        problems.append(f"{name}, {DEFAULTS}: {'; '.join(wrong.values())}")
    accepted: dict[int, argparse.Namespace] = {}
    of_sets: dict[str, list[int]] = {}
    """The numbers of the sets that have the same mistakes."""
    lines = []
    for number, values in enumerate(sets, 1):
        if number % PROGRESS_EVERY == 0:
            on_progress(number / len(sets))
        try:
            accepted[number] = _options({**defaults, **values}, reader, wrong)
        except WrongUsage as error:
            of_sets.setdefault(str(error), []).append(number)
            lines.append(f"{name}, set {number}: {error}")
    if problems or lines:
        told = (f"{name}, set{'s' * (len(each) > 1)} {ranges(each)}: {text}" for text, each in of_sets.items())
        raise WrongJobs("\n".join([*problems, *lines]), [*problems, *told], accepted)
    return list(accepted.values())


def _options(values: dict, reader: "_Reader", unread: Collection[str]) -> argparse.Namespace:
    """The options of a set, checked. unread: the keys of defaults that cannot be read.

    Raises WrongUsage with all mistakes of the set.
    """
    options, wrong = reader.read(values)
    unread = {*unread, *wrong}
    problems = [*wrong.values(), *map(_plain, _mistakes(options, unread))]
    if problems:
        raise WrongUsage("; ".join(problems))
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
    readers = dict(zip(arguments.JOB_FILES, (tomllib.loads, _json), strict=True))
    if path.suffix.lower() not in readers:
        raise WrongJobs(f"{name!r} does not end in .toml or .json")
    try:
        return readers[path.suffix.lower()](path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise WrongJobs(f"{name!r} cannot be read: {error.strerror}") from error
    except RecursionError as error:
        raise WrongJobs(f"{name!r} is nested too deeply to be a list of sets") from error
    except UnicodeDecodeError as error:
        raise WrongJobs(f"{name!r} is not UTF-8: save it as UTF-8") from error
    except ValueError as error:  # the error of both decoders
        hint = r". Write paths with /, or with \\" if "Unescaped '\\'" in str(error) else ""
        raise WrongJobs(f"{name!r} is not valid {path.suffix[1:].upper()}: {error}{hint}") from error


def _json(text: str) -> Any:
    """As json.loads, which keeps only the last of two values with the same key. Raises ValueError, as TOML does, for them."""
    return json.loads(text, object_pairs_hook=_once)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [key for key, _ in pairs]
        raise ValueError(f"{next(key for key in names if names.count(key) > 1)!r} is given twice")
    return table


def _parts(name: str, table) -> tuple[dict, list[dict], list[str]]:
    """The defaults, the sets, and a line for each other part. Raises WrongJobs if there are no sets to check."""
    if not isinstance(table, dict):
        raise WrongJobs(f"{name}: a table with {SETS!r}, a list of sets, is expected")
    problems = []
    for key in table:
        if key.replace("_", "-") in KEYS:
            problems.append(f"{name}: {key!r} belongs into {DEFAULTS!r} or a set")
            continue
        try:
            _check_known(key, (DEFAULTS, SETS))
        except WrongUsage as error:
            problems.append(f"{name}: {error}")
    defaults, sets = table.get(DEFAULTS, {}), table.get(SETS, [])
    if not isinstance(defaults, dict):
        problems.append(f"{name}: {DEFAULTS!r} must be a table")
        defaults = {}
    if not isinstance(sets, list) or not sets or not all(isinstance(values, dict) for values in sets):
        if SETS in table or not problems:  # otherwise an unknown key may stand for it
            problems.append(
                f"{name}: {SETS!r} must be a list of sets, and not empty: in TOML each starts with [[{SETS}]]"
            )
        raise WrongJobs("\n".join(problems))
    return defaults, sets, problems


class _Reader:
    """Reads sets."""

    def __init__(self, folder: Path, more: Sequence[str] = (), *, is_untrusted: bool = False):
        """folder: at which paths start. more: arguments that override all sets. is_untrusted: as in `read`."""
        self._folder, self._is_untrusted = folder, is_untrusted
        self._usual, self._over = vars(arguments.parse([])), arguments.given(more)

    def read(self, values: dict) -> tuple[argparse.Namespace, dict[str, str]]:
        """The options of a set, and what is wrong with its keys that cannot be read."""
        given, wrong, own = self._usual.copy(), {}, set()
        spelled = {written.replace("_", "-"): written for written in values}  # a set may spell a default otherwise
        for written in spelled.values():
            value = values[written]
            try:
                key = _check_known(written, KEYS)
                words = self._words(key, value)
                if value is True or words:  # False and empty lists change nothing
                    given[_name(key)] = _parsed(key, words)
                    own.add(_name(key))
            except (WrongUsage, argparse.ArgumentTypeError) as error:
                wrong[written.replace("_", "-")] = _plain(str(error))
        options = argparse.Namespace()
        options.__dict__ = given | self._over
        if options.set:
            options.own = {name: value for name, value in vars(options).items() if name in self._over or name in own}
        return arguments.completed(options), wrong

    def _words(self, key: str, value: Any) -> list[str]:
        """As the function `_words`, with whole paths."""
        words = _words(key, value)
        if not KEYS[key].is_path:
            return words
        try:
            return [word and self._path(word) for word in words]
        except argparse.ArgumentTypeError as error:
            raise WrongUsage(f"{key}: {error}") from error

    def _path(self, word: str) -> str:
        return str(self._folder / option_types.path_in_file(word, is_untrusted=self._is_untrusted))
