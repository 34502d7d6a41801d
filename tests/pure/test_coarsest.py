# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the search for the smallest number of triangles within a limit."""

import random

import pytest

from addon.core.levels.coarsest import FEWER, Tried, search
from addon.core.progress import finish


def meshes(value, floor=0, slack=0):
    """An attempt on meshes whose values are given by a function, and the numbers that were tried."""
    numbers = []

    def attempt_on(tried):
        def attempt(wanted):
            yield from ()
            number = max(floor, wanted - slack)
            numbers.append(number)
            tried.values[number] = value(number)
            return number

        return attempt

    return attempt_on, numbers


@pytest.mark.parametrize("power", [0.3, 1.0, 3.0])
def test_five_percent_fewer_are_beyond_the_limit(power):
    def value(number):
        return (1000.0 / number) ** power

    tried = Tried({100_000: value(100_000)})
    attempt_on, numbers = meshes(value)
    found = finish(search(tried, 1.0, attempt_on(tried)))
    assert value(found.triangles) <= 1.0 < value(found.beyond)
    assert found.beyond == int(FEWER * found.triangles)
    assert len(numbers) <= 20


def test_random_values_seed_7():
    dice = random.Random(7)
    for _ in range(200):
        noise = {}

        def value(number, noise=noise):
            return 100.0 / number * noise.setdefault(number, dice.uniform(0.7, 1.5))

        most = dice.randrange(12, 50_000)
        tried = Tried({most: 0.0})
        attempt_on, _ = meshes(value, slack=dice.choice([0, 1]))
        limit = dice.uniform(0.01, 30.0)
        found = finish(search(tried, limit, attempt_on(tried)))
        assert tried.values[found.triangles] <= limit
        assert not found.beyond or tried.values[found.beyond] > limit
        assert found.beyond < found.triangles
        assert not found.beyond or found.beyond >= int(FEWER * found.triangles) - 2


def test_borders_that_are_kept_end_the_search():
    tried = Tried({10_000: 0.1})
    attempt_on, numbers = meshes(lambda number: 100.0 / number, floor=800)
    found = finish(search(tried, 1.0, attempt_on(tried)))
    assert (found.triangles, found.beyond) == (800, 0)
    assert tried.floor == 800
    assert numbers[-1] == 800 and len(numbers) <= 4


def test_what_was_measured_before_is_not_measured_again():
    tried = Tried({10_000: 0.01})
    attempt_on, numbers = meshes(lambda number: 100.0 / number)
    first = finish(search(tried, 0.05, attempt_on(tried)))
    count = len(numbers)
    again = finish(search(tried, 0.05, attempt_on(tried)))
    assert again == first
    assert len(numbers) == count
