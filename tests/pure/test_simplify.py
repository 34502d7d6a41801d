# SPDX-License-Identifier: GPL-3.0-or-later
"""The search for coarse meshes, with meshes that are numbers: what it finds against a list of all that could be made."""

import random
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from addon.core.progress import finish
from addon.core.simplify import FEWER, LEAST, ODD, TRIES, Candidate, Limit, Search, StepSearch, making

LIMIT = Limit(degrees=1.0)
MOST = 100_000


@dataclass(frozen=True, eq=False)
class Made:
    """A mesh without a surface. degrees: on each of its pieces. counts: the triangles of each."""

    counts: np.ndarray
    degrees: np.ndarray

    @property
    def triangles(self):
        return int(self.counts.sum())


@dataclass(frozen=True)
class Measured:
    degrees: np.ndarray
    ignored: int = 0

    def excess(self, limit):
        return float(np.sort(self.degrees)[-1 - self.ignored]) / limit.degrees

    def spent(self, limit):
        return float((self.degrees > limit.degrees).mean())


@dataclass
class Factory:
    """Makes and judges meshes. alive: those that were not removed. measured: the triangles of each that was judged."""

    ignored: int = 0
    alive: list = field(default_factory=list)
    measured: list = field(default_factory=list)

    def made(self, counts, degrees):
        self.alive.append(Made(counts, degrees))
        return self.alive[-1]

    def judge(self, mesh, factor=1.0):
        yield from ()
        self.measured.append(mesh.triangles)
        return Measured(factor * mesh.degrees, self.ignored)

    def search(self, limit=LIMIT):
        return Search(limit, self.judge, self.alive.remove)


@dataclass(frozen=True)
class Anew:
    """Makes meshes of any number of triangles, not less than `least`. error: degrees for a number of triangles."""

    factory: Factory
    error: object
    least: int = LEAST
    gain: float = 0.0
    """The share of the error that a correction takes away."""

    def make(self, triangles):
        yield making(triangles)
        number = max(self.least, triangles)
        return [self.factory.made(np.array([number]), np.array([self.error(number)]))]

    def corrected(self, candidate):
        if not self.gain:
            return None
        return replace(self, error=lambda number: (1.0 - self.gain) * self.error(number))


def fewest(error, least=LEAST):
    """The fewest triangles within the limit, of all that can be made; None if none is."""
    return next((number for number in range(least, MOST + 1) if error(number) <= LIMIT.degrees), None)


@pytest.mark.parametrize("power", [0.3, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("first", [100, 4_000, 90_000])
def test_the_fewest_triangles_of_all_are_found_from_any_number(power, first):
    factory = Factory()

    def error(number):
        return (2000.0 / number) ** power

    found = finish(factory.search().min_triangles(Anew(factory, error), first, MOST))
    best = fewest(error)
    assert best <= found.triangles <= best / FEWER + ODD
    assert len(factory.measured) <= 8 and factory.alive == [found.mesh]


def test_of_noisy_meshes_one_within_the_limit_is_found_seed_3():
    dice = random.Random(3)
    for _ in range(200):
        factory, limit, most, noise = Factory(), dice.uniform(0.01, 3.0), dice.randrange(10, MOST), {}

        def error(number, noise=noise, limit=limit):
            return 30.0 / number**0.5 * noise.setdefault(number, dice.uniform(0.9, 1.1)) / limit

        search = factory.search()
        found = finish(search.min_triangles(Anew(factory, error), dice.randrange(4, 2000), most))
        tries = factory.measured
        assert len(tries) == search.count <= TRIES and max(tries) <= most and min(tries) >= min(LEAST, most)
        assert found.triangles == min((each for each in tries if error(each) <= 1.0), default=found.triangles)
        if found.excess > 1.0:  # then it is the nearest of all that were tried, of which the finest is one
            assert max(tries) == most and found.excess == min(map(error, tries))
        elif found.triangles > 2.0 * (27.0 / limit) ** 2:  # noise alone does not keep it from much fewer
            assert found.triangles <= max(LEAST, 1.06 * (33.0 / limit) ** 2 + ODD)
        assert factory.alive == [found.mesh]


@pytest.mark.parametrize(
    ("error", "least"),
    [(lambda number: 9.0 - number / MOST, LEAST), (lambda number: 0.1, 80), (lambda number: 0.0, 80)],
)
def test_limits_that_none_or_all_meet_end_with_the_finest_and_the_coarsest(error, least):
    factory = Factory()
    found = finish(factory.search().min_triangles(Anew(factory, error, least), 500, 3000))
    assert found.triangles == (fewest(error, least) or 3000)
    assert len(factory.measured) < 8


@pytest.mark.parametrize("gain", [0.0, 0.2, -0.2, 0.005])
def test_the_best_of_all_makers_and_corrections_is_taken(gain):
    factory = Factory()
    makers = [Anew(factory, lambda number, each=each: each, gain=gain) for each in (3.0, 1.0, 2.0)]
    costs = []

    def cost(candidate):
        costs.append(float(candidate.deviation.degrees[0]))
        return costs[-1]

    found = finish(factory.search().best_of(makers, 100, cost, 2))
    assert cost(found) == min(costs) == pytest.approx({0.2: 0.64, 0.005: 0.995}.get(gain, 1.0))
    count = {0.2: 5, 0.0: 3, -0.2: 4, 0.005: 4}[
        gain
    ]  # the first correction that gains less than a hundredth is the last
    assert len(factory.measured) == count and factory.alive == [found.mesh]


@pytest.mark.parametrize(("better", "expected"), [(0.5, 0.4), (2.0, 0.8)])
def test_a_variant_of_the_best_comes_last(better, expected):
    factory, bests = Factory(), []

    def variant(best):
        bests.append(float(best.deviation.degrees[0]))
        return Anew(factory, lambda number: better * bests[0])

    def cost(candidate):
        return float(candidate.deviation.degrees[0])

    makers = [Anew(factory, lambda number, each=each: each, gain=0.2) for each in (3.0, 1.0)]
    found = finish(factory.search().best_of(makers, 100, cost, 1, variant))
    assert bests == pytest.approx([0.8]) and cost(found) == pytest.approx(expected)
    assert len(factory.measured) == 4 and factory.alive == [found.mesh]


@dataclass(frozen=True)
class Steps:
    """Makes coarser meshes of finer ones: all pieces lose the same share, but for those that are spared.

    needs: the triangles that each piece has at the limit.
    """

    factory: Factory
    needs: np.ndarray
    mesh: Made | None = None
    spared: np.ndarray | None = None
    may_spare: bool = True
    least: int = 1

    @property
    def is_corrected(self):
        return self.spared is not None

    def of(self, mesh):
        return replace(self, mesh=mesh)

    def uncorrected(self):
        return replace(self, spared=None)

    def make(self, triangles):
        yield making(triangles)
        counts = self.mesh.counts
        is_free = np.ones(len(counts), bool) if self.spared is None else ~self.spared
        kept = int(counts[~is_free].sum())
        share = max(0.0, triangles - kept) / max(1, counts[is_free].sum())
        left = np.maximum((counts * min(share, 1.0)).astype(int), self.least)
        counts = np.where(is_free, np.minimum(left, counts), counts)
        return [self.factory.made(counts, self.needs / counts)]

    def corrected(self, candidate):
        is_beyond = candidate.deviation.degrees > candidate.limit.degrees
        before = np.zeros(len(is_beyond), bool) if self.spared is None else self.spared
        return replace(self, spared=before | is_beyond) if self.may_spare and (is_beyond & ~before).any() else None


def coarsest(needs, finest, error=1.0, ignored=0, **how):
    """What steps find from a mesh of pieces with `finest` triangles each, and the factory.

    error: of the quick judge. ignored: how many pieces do not count where the excess is measured.
    """
    factory = Factory(ignored=ignored)
    start = Made(np.full(len(needs), finest), np.asarray(needs) / finest)
    search = StepSearch(LIMIT, lambda mesh: factory.judge(mesh, error), factory.alive.remove, factory.judge)
    candidate = Candidate(start, None, Measured(error * start.degrees, ignored), LIMIT)
    maker = Steps(factory, np.asarray(needs, float), **how)
    return *finish(search.coarsest(candidate, maker)), factory


@pytest.mark.parametrize("error", [0.5, 0.9, 1.0, 1.2])
def test_steps_find_the_coarsest_mesh_that_is_within_the_limit_by_the_exact_judge(error):
    (within, beyond, factory) = coarsest([37.0] * 20, 1000, error)
    assert within.deviation.excess(LIMIT) <= 1.0 < beyond.deviation.excess(LIMIT)
    assert FEWER * within.triangles - 20 <= beyond.triangles < within.triangles
    assert 20 * 37 <= within.triangles <= 20 * 37 / FEWER + 20
    assert factory.alive == [within.mesh] and len(factory.measured) <= 30


def test_pieces_that_need_more_keep_their_triangles():
    """Alike they have 2,000 times 20 triangles at the best: with those spared that need them, little more than their sum."""
    needs = [900.0] * 2 + [20.0] * 38
    within, _, factory = coarsest(needs, 2000)
    assert len(factory.measured) <= 30
    alike, _, _ = coarsest(needs, 2000, may_spare=False)
    assert sum(needs) <= within.triangles < 1.3 * sum(needs) and alike.triangles >= 900 * 40


def test_what_may_be_beyond_the_limit_is_not_used_up_before_it_has_to_be():
    """Of 40 pieces, 2 do not count. Little is lost of the one that needs most while the others can become coarser."""
    within, _, _ = coarsest([900.0] + [20.0] * 39, 1000, ignored=2)
    assert within.spent <= 2 / 40 and within.mesh.degrees[0] <= 1.2 and within.triangles < 1.3 * (900 + 39 * 20)


def test_both_deviations_count():
    assert Limit(2.0, 0.01).excess(1.0, 0.02) == Limit(2.0, 0.01).excess(4.0, 0.001) == 2.0
    assert Limit(degrees=2.0).excess(1.0, 9.0) == Limit(distance=0.1).excess(9.0, 0.05) == 0.5


def test_steps_of_random_pieces_seed_5():
    rng = np.random.default_rng(5)
    for _ in range(40):
        needs = rng.lognormal(3.0, 1.0, int(rng.integers(2, 30)))
        finest = int(needs.max() * rng.uniform(1.1, 20.0)) + 1
        within, beyond, factory = coarsest(needs, finest, rng.uniform(0.6, 1.0), least=int(rng.integers(1, 4)))
        assert within.deviation.excess(LIMIT) <= 1.0
        assert needs.sum() <= within.triangles <= 1.1 * finest * len(needs)
        assert beyond is None or beyond.deviation.excess(LIMIT) > 1.0
        assert [each for each in factory.alive if each is not within.mesh] == []


def test_no_mesh_is_coarser_than_what_can_be_made():
    within, beyond, _ = coarsest([0.0] * 4, 1000, least=200)
    assert (within.triangles, beyond) == (800, None)
    within, beyond, factory = coarsest([0.0], 12)
    assert (within.triangles, beyond, min(factory.measured)) == (LEAST, None, LEAST)
