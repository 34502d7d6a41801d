# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths as text."""

from collections.abc import Callable

Length = Callable[[float], str]
"""A function that gives a length in scene units as text."""
DIGITS = 4
"""Significant digits of a length without a unit, and the most after the point of one with a unit."""


def plain(value: float) -> str:
    """A length without a unit."""
    return f"{value:.{DIGITS}g}"
