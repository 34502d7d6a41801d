# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the values of a job file's keys as the command line's parser would."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...core.naming import did_you_mean
from . import arguments, option_types, run_options
from .arguments import WrongUsage
from .options import FILE, OPTIONS, STDOUT, CommandOption

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


class KeyValue(NamedTuple):
    """What a value means for the options."""

    name: str
    """The attribute of the options."""
    value: Any = None
    is_given: bool = True
    """Whether it changes the options. False and empty lists do not."""
    fault: str = ""
    """Why the parser does not take it."""


class Unknown(WrongUsage):
    """A key is unknown, or its value has another type."""


class KeyValues:
    """Reads values. Paths start at a folder."""

    def __init__(self, folder: Path, *, is_untrusted: bool = False):
        self._folder, self._is_untrusted = folder, is_untrusted

    def read(self, written: str, value: Any) -> KeyValue:
        """The value of a key. written: the key, with dashes or underscores. Raises Unknown, without a full stop."""
        key = written.replace("_", "-")
        words = _words_of(written, key, value)
        option, name = KEYS[key], _name(key)
        if option.is_path:
            try:
                words = [self._path(word) if word else word for word in words]
            except argparse.ArgumentTypeError as fault:
                return KeyValue(name, fault=f"{key}: {fault}")
        if value is not True and not words:
            return KeyValue(name, is_given=False)
        try:
            return KeyValue(name, _value(option, words))
        except (argparse.ArgumentTypeError, TypeError, ValueError):
            pass
        try:  # for the message
            dashed = [f"--{key}"] if value is True else [f"--{key}={word}" for word in words]
            return KeyValue(name, vars(arguments.parse(words if key == "file" else dashed))[name])
        except WrongUsage as fault:
            return KeyValue(name, fault=str(fault))

    def _path(self, word: str) -> str:
        return str(self._folder / option_types.path_in_file(word, is_untrusted=self._is_untrusted))


def _value(option: CommandOption, words: Sequence[str]) -> Any:
    """What the parser makes of the words of an option. Raises what the option's type raises, and ValueError."""
    parsing = option.parsing
    if option.is_flag:
        return parsing["action"] == "store_true"
    if not words:
        return parsing["const"]
    values = [parsing["type"](word) for word in words]
    if option.may_repeat:
        return values
    (value,) = values
    if value not in parsing.get("choices", (value,)):
        raise ValueError
    return value


def check_known(key: str, written: str, known: Sequence[str]) -> None:
    """Raise Unknown for an unknown key."""
    if key in known:
        return
    if key in run_options.RUN_OPTIONS:
        raise Unknown(f"unknown key {written!r}: it works only on the command line")
    raise Unknown(f"unknown key {written!r}{did_you_mean([key], known)}")


def _words_of(written: str, key: str, value) -> list[str]:
    """The value as words, for a key that may be unknown."""
    check_known(key, written, list(KEYS) if key not in KEYS else (key,))
    words = _words(key, value)
    if key == "report" and STDOUT in words:
        raise Unknown(f"report: {STDOUT!r}, standard output, works only on the command line")
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
        raise Unknown(f"{key}: {option.value} is expected, not {_short(value)}")
    return list(map(str, parts)) if option.is_text or not parts else [",".join(map(str, parts))]
