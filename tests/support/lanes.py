"""Cases of the slow lane among those of a test; docs/testing.md says what the lanes are."""

from collections.abc import Iterable

import pytest


def in_turn(all_of: Iterable, names: Iterable, values: Iterable) -> list[tuple]:
    """Pairs of a name and a value: all values of the names `all_of`, and one of each other name, in turn."""
    all_of, values = set(all_of), list(values)
    return [
        (name, value)
        for place, name in enumerate(names)
        for value in (values if name in all_of else [values[place % len(values)]])
    ]


def slow_but(fast: Iterable, cases: Iterable) -> list:
    """`cases` for pytest.mark.parametrize, of which those that are not in `fast` are slow."""
    fast = set(fast)
    return [case if case in fast else pytest.param(case, marks=pytest.mark.slow) for case in cases]
