# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors whose messages the user reads."""

from collections.abc import Callable, Iterable


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


Length = Callable[[float], str]
"""A function that gives a length in scene units as text."""
LENGTH_DIGITS = 4
"""Significant digits of a length without a unit, and the most after the point of one with a unit."""


def plain_length(value: float) -> str:
    """A length without a unit."""
    return f"{value:.{LENGTH_DIGITS}g}"
