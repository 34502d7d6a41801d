# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads job files: sets of options, as TOML or JSON. Each set becomes arguments for the command line's parser."""

import argparse
import json
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from . import arguments
from .arguments import WrongUsage
from .key_values import KEYS, KeyValue, KeyValues, Unknown, check_known

DEFAULTS, SETS = "defaults", "bake"
PROGRESS_EVERY = 100
"""Sets between two calls of the progress function."""


class WrongJobs(WrongUsage):
    """A job file cannot be read or has mistakes. The text has a line for each part with mistakes, without a full stop."""


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
    defaults, sets, faults = _parts(name, table)
    reader = _Reader(KeyValues(path.parent, is_untrusted=is_untrusted), more)
    _, wrong = reader.read(defaults)
    # Mistakes in the defaults are reported once, not for each set.
    usual = {key: value for key, value in defaults.items() if key.replace("_", "-") not in wrong}
    if wrong:
        faults.append(f"{name}, {DEFAULTS}: {'; '.join(wrong.values())}")
    found = []
    for number, values in enumerate(sets, 1):
        if number % PROGRESS_EVERY == 0:
            on_progress(number / len(sets))
        try:
            found.append(_options({**usual, **values}, reader, wrong))
        except WrongUsage as fault:
            faults.append(f"{name}, set {number}: {fault}")
    if faults:
        raise WrongJobs("\n".join(faults))
    return found


def _options(values: dict, reader: "_Reader", unread: Collection[str]) -> argparse.Namespace:
    """The options of a set, checked. unread: the keys of defaults that cannot be read.

    Raises WrongUsage with all mistakes of the set.
    """
    options, wrong = reader.read(values)
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
        raise WrongJobs(f"{name!r} is no {path.suffix[1:].upper()}: {error}{hint}") from error


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
    faults = []
    for key in table:
        if key.replace("_", "-") in KEYS:
            faults.append(f"{name}: {key!r} belongs into {DEFAULTS!r} or a set")
            continue
        try:
            check_known(key, key, (DEFAULTS, SETS))
        except WrongUsage as fault:
            faults.append(f"{name}: {fault}")
    defaults, sets = table.get(DEFAULTS, {}), table.get(SETS, [])
    if not isinstance(defaults, dict):
        faults.append(f"{name}: {DEFAULTS!r} must be a table")
        defaults = {}
    if not isinstance(sets, list) or not sets or not all(isinstance(values, dict) for values in sets):
        if SETS in table or not faults:  # otherwise an unknown key may stand for it
            faults.append(
                f"{name}: {SETS!r} must be a list of sets, and not empty: in TOML each starts with [[{SETS}]]"
            )
        raise WrongJobs("\n".join(faults))
    return defaults, sets, faults


class _Reader:
    """Reads sets."""

    def __init__(self, keys: KeyValues, more: Sequence[str] = ()):
        """more: arguments that override all sets."""
        self._keys, self._usual, self._over = keys, vars(arguments.parse([])), arguments.given(more)

    def read(self, values: dict) -> tuple[argparse.Namespace, dict[str, str]]:
        """The options of a set, and what is wrong with its keys that cannot be read."""
        found: dict[str, KeyValue] = {}
        wrong = {}
        for written, value in values.items():
            key = written.replace("_", "-")
            try:
                found[key] = self._keys.read(written, value)
            except Unknown as fault:
                wrong[key] = _plain(str(fault))
        given = self._usual.copy()
        for key, read in found.items():
            if read.fault:
                wrong[key] = _plain(read.fault)
            elif read.is_given:
                given[read.name] = list(read.value) if isinstance(read.value, list) else read.value
        given |= self._over
        options = argparse.Namespace()
        options.__dict__ = given
        return arguments.with_pairs(options), wrong
