# SPDX-License-Identifier: GPL-3.0-or-later
"""The one exception that a person is meant to read."""

from collections.abc import Iterable


class BakeError(Exception):
    """The bake cannot be done. Its text is one sentence that names the thing to mend."""


class WrongPlace(BakeError):
    """A file cannot be written where it was asked to be: it would harm another one, or what is there is no file."""


def sentence(error: BakeError | MemoryError) -> str:
    """What a person is told of it."""
    if isinstance(error, BakeError):
        return str(error)
    return f"There is not enough memory{f' ({error})' if str(error) else ''}: choose a smaller map, or bake less at a time."


def shorten_list(things: Iterable[object], most: int = 3) -> str:
    """`things` in a sentence that stays short: some of them, and how many more there are."""
    words = list(map(str, things))
    more = len(words) - most
    return ", ".join(words) if more < 1 else f"{', '.join(words[:most])} and {more} more"
