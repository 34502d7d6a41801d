"""Cases of the slow lane among those of a test; docs/testing.md says what the lanes are."""

from collections.abc import Iterable

import pytest


def slow_but(fast: Iterable, cases: Iterable) -> list:
    """`cases` for pytest.mark.parametrize, of which those that are not in `fast` are slow."""
    fast = set(fast)
    return [case if case in fast else pytest.param(case, marks=pytest.mark.slow) for case in cases]
