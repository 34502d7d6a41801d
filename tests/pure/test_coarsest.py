# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the search for the coarsest mesh within a limit."""

import random
from dataclasses import dataclass

import pytest

from addon.core.levels import FEWER, LEAST, TRIES, fewest, search
from addon.core.progress import finish


@dataclass(frozen=True)
class Made:
    """A mesh without a surface. way: in which of several ways it was made."""

    triangles: int
    excess: float
    spent: float = 0.0
    way: int = 0


def found(most, excess, floor=0, slack=0):
    """What the search finds if a mesh of some triangles has this excess, and the steps (from, wanted, is last) it took."""
    steps = []

    def attempt(base, wanted, is_last):
        yield from ()
        steps.append((base.triangles, wanted, is_last))
        number = max(floor, wanted - slack)
        return [Made(number, excess(number))]

    return finish(search(Made(most, 0.0), attempt)), steps


@pytest.mark.parametrize("power", [0.3, 1.0, 3.0])
def test_five_percent_fewer_are_beyond_the_limit(power):
    (within, beyond), steps = found(100_000, lambda number: (1000.0 / number) ** power)
    assert within.excess <= 1.0 < beyond.excess
    assert beyond.triangles == int(FEWER * within.triangles)
    assert len(steps) <= 20


def test_random_values_seed_7():
    dice = random.Random(7)
    for _ in range(200):
        noise, limit = {}, dice.uniform(0.01, 30.0)

        def excess(number, noise=noise, limit=limit):
            return 100.0 / number * noise.setdefault(number, dice.uniform(0.7, 1.5)) / limit

        (within, beyond), _ = found(dice.randrange(12, 50_000), excess, slack=dice.choice([0, 1]))
        assert within.excess <= 1.0
        if beyond:
            assert beyond.excess > 1.0
            assert int(FEWER * within.triangles) - 2 <= beyond.triangles < within.triangles


def test_steps_start_from_the_last_mesh_within_the_limit_and_only_the_last_is_announced():
    (within, _), steps = found(10_000, lambda number: 100.0 / number)
    bases = [base for base, _, _ in steps]
    assert bases == sorted(bases, reverse=True) and bases[-1] == within.triangles
    assert steps[-1] == (within.triangles, int(FEWER * within.triangles), True)
    assert [is_last for base, wanted, is_last in steps] == [wanted == int(FEWER * base) for base, wanted, _ in steps]


def test_a_step_far_beyond_the_limit_is_followed_by_one_that_is_much_smaller():
    (within, _), steps = found(10_000, lambda number: (8_000.0 / number) ** 4)
    wanted = [each for _, each, _ in steps]
    assert wanted[:2] == [5_000, int(0.5**0.25 * 10_000)] and len(steps) <= 5
    assert 8_000 <= within.triangles < 8_500


def test_borders_that_are_kept_end_the_search():
    (within, beyond), steps = found(10_000, lambda number: 100.0 / number, floor=800)
    assert (within.triangles, beyond) == (800, None)
    assert len(steps) <= 12


def test_of_several_ways_the_one_with_the_fewest_texels_beyond_goes_on():
    def attempt(base, wanted, is_last):
        yield from ()
        if base.triangles < 1000:
            return [Made(wanted, 2.0), Made(wanted, 1.5, way=3)]
        return [Made(wanted, 0.5, 0.004, 1), Made(wanted, 0.6, 0.001, 2), Made(wanted, 1.1, 0.0, 3)]

    within, beyond = finish(search(Made(1000, 0.0), attempt))
    assert (within.way, beyond.way) == (2, 3)


def test_no_mesh_is_coarser_than_a_tetrahedron():
    (within, beyond), steps = found(12, lambda _: 0.0)
    assert (within.triangles, beyond) == (LEAST, None)
    assert min(wanted for _, wanted, _ in steps) == LEAST


def fewest_found(first, most, excess, floor=0):
    """What the search finds if meshes are made anew, and the numbers of triangles that it asked for."""
    asked = []

    def attempt(wanted):
        yield from ()
        asked.append(wanted)
        number = max(floor, wanted)
        return Made(number, excess(number))

    return finish(fewest(first, most, attempt)), asked


@pytest.mark.parametrize("power", [0.3, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("first", [100, 4_000, 90_000])
def test_the_fewest_triangles_are_found_from_any_number(power, first):
    (within, beyond), asked = fewest_found(first, 100_000, lambda number: (2000.0 / number) ** power)
    assert within.excess <= 1.0 < beyond.excess
    assert FEWER * within.triangles - 2 <= beyond.triangles < within.triangles
    assert len(asked) < TRIES


def test_fewest_from_noisy_meshes_seed_3():
    dice = random.Random(3)
    for _ in range(200):
        limit, most = dice.uniform(0.01, 3.0), dice.randrange(10, 100_000)
        noise = {}

        def excess(number, noise=noise, limit=limit):
            return 30.0 / number**0.5 * noise.setdefault(number, dice.uniform(0.9, 1.1)) / limit

        (within, beyond), asked = fewest_found(dice.randrange(4, 2000), most, excess)
        assert len(asked) <= TRIES and max(asked) <= most and min(asked) >= min(LEAST, most)
        assert within is None or within.excess <= 1.0
        assert beyond is None or beyond.excess > 1.0


def test_a_limit_that_no_mesh_meets_ends_with_the_most_triangles():
    (within, beyond), asked = fewest_found(500, 3000, lambda number: 9.0)
    assert within is None and beyond.triangles == asked[-1] == 3000


def test_the_coarsest_mesh_that_can_be_made_ends_the_search():
    (within, beyond), asked = fewest_found(500, 3000, lambda number: 0.1, floor=80)
    assert within.triangles == 80 and beyond is None and len(asked) < 8
