# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors whose messages the user reads."""

from collections.abc import Iterable


class BakeError(Exception):
    """The bake is not possible. The message is one sentence that says what to fix."""


class WrongPlace(BakeError):
    """An output path cannot be used: it would overwrite a file that is needed, or it leads to something other than a file."""


class Incomplete(BakeError):
    """Objects lack files, or what their modifiers need."""


class NoGpu(BakeError):
    """Blender's gpu module does not start on this machine."""


def sentence(error: BakeError | MemoryError) -> str:
    """The message for the user."""
    if isinstance(error, BakeError):
        return str(error)
    return f"There is not enough memory{f' ({error})' if str(error) else ''}: choose a smaller map, or bake less at a time."


def shorten_list(items: Iterable[object], most: int = 3) -> str:
    """The first `most` items, separated by commas, and the number of the others: "a, b, c and 5 more"."""
    words = list(map(str, items))
    more = len(words) - most
    return ", ".join(words) if more < 1 else f"{', '.join(words[:most])} and {more} more"
