# SPDX-License-Identifier: GPL-3.0-or-later
"""Seeds of random commands, jobs and maps, and the count of what became of the cases."""

import os
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

from tests.support import lanes


def seeds(count: int, fast: int, variable: str = "IMPRINT_RANDOM") -> pytest.MarkDecorator:
    """A parametrization by `seed` from 0 to `count`, of which the first `fast` are in the fast lane.

    An environment variable of the form FIRST:LAST asks for other seeds. A test's name has its seed.
    """
    first, last = map(int, os.environ.get(variable, f"0:{count}").split(":"))
    cases = lanes.slow_but(range(first, first + fast), range(first, last))
    return pytest.mark.parametrize("seed", cases, ids=lambda seed: f"seed {seed}")


def counted(enough: int, **shares: float):
    """A fixture that counts the cases of a module by outcome, and fails if one has less than its least share.

    enough: the number of cases from which shares are checked. Otherwise, for example, refusing everything would pass.
    """

    @pytest.fixture(scope="module")
    def outcomes() -> Iterator[Counter]:
        count = Counter()
        yield count
        print(f"{count.total()} cases: {dict(count)}")
        if count.total() >= enough:
            assert all(count[outcome] >= share * count.total() for outcome, share in shares.items()), count

    return outcomes


def any_of(rng: np.random.Generator, values):
    """One of the values, as it is: `rng.choice` would make an array of them."""
    return values[rng.integers(len(values))]


def pick(rng: np.random.Generator, weighted: dict):
    """A random key, by weights. The weight is the value, or the last part of the value."""
    weights = np.array([value[-1] if isinstance(value, tuple) else value for value in weighted.values()], float)
    return list(weighted)[rng.choice(len(weights), p=weights / weights.sum())]
