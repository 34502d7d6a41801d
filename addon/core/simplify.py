# SPDX-License-Identifier: GPL-3.0-or-later
"""Searches the coarsest mesh within a limit, for levels of detail and game assets alike.

What makes meshes and what judges them is passed in, so that this module knows neither Blender nor the GPU:

    search = Search(Limit(degrees=2.0), judge, remove)
    found = yield from search.min_triangles(maker, first=1000, most=20_000)
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

from .progress import Progress, Task, part

LEAST = 4
"""The fewest triangles that enclose a volume. No coarser mesh is looked for."""
FEWER = 0.95
"""The share of triangles that the last step leaves: a search ends when a mesh with so many is beyond the limit."""
ODD = 2
"""The triangles that an edge inside a mesh takes along when it collapses."""
STRIDE = 0.5
"""The share of triangles that the first steps leave. After a step beyond the limit, they become smaller."""
FAR = 1.6
"""The excess from which a step is taken for much too large."""
TRIES = 16
"""The most meshes that are made for the fewest triangles."""
CLOSER = 1.5
"""The least factor between the numbers of triangles of two tries before one is within the limit and one beyond it."""
MOST_FOR_SPARING, MOST_FOR_OTHERS = 1.6, 1.25
"""The excess beyond which sparing what a mesh lost, and other meshes of a maker, hardly bring it within the limit."""
GAIN = 0.01
"""The share of the cost that a correction takes away at least, if another one is to follow."""
SHARE_LEFT = 0.8
"""The share of what is left of the progress that the tries after one take: the more tries, the less each of them."""


@dataclass(frozen=True)
class Limit:
    """What a mesh may deviate.

    Attributes:
        degrees: Of its normals, infinite for no limit.
        distance: As a share of the longest side of the box, infinite for no limit.
        triangles: How many it has, up to 1 a share of those of the original, and 0 for as few as possible.
    """

    degrees: float = math.inf
    distance: float = math.inf
    triangles: float = 0.0

    def wanted(self, triangles: int) -> int:
        """How many triangles a level of a mesh of so many has."""
        return max(LEAST, round(self.triangles * triangles if self.triangles <= 1.0 else self.triangles))

    def excess(self, degrees: float, distance: float) -> float:
        """How much of the limit these deviations take: more than 1 if they are beyond it."""
        return max(degrees / self.degrees, distance / self.distance)

    def __str__(self) -> str:
        if self.triangles:
            is_share = self.triangles <= 1.0
            return f"{100.0 * self.triangles:g} % of the triangles" if is_share else f"{self.triangles:,.0f} triangles"
        parts = [f"{self.degrees:g} degrees"] * (self.degrees < math.inf)
        return ", ".join(parts + [f"{100.0 * self.distance:g} % of the size"] * (self.distance < math.inf))


class Mesh(Protocol):
    """A mesh, of which this module knows how many triangles it has."""

    @property
    def triangles(self) -> int: ...


class Deviation(Protocol):
    """What a judge measured of a mesh."""

    def excess(self, limit: Limit) -> float:
        """How much of a limit it takes: more than 1 beyond it."""
        ...

    def spent(self, limit: Limit) -> float:
        """The share of texels that are beyond a limit, of which a few may be. For StepSearch alone."""
        ...


def making(triangles: int) -> Progress:
    """The step of a maker that makes a mesh of about so many triangles."""
    return Progress(f"Decimating to {triangles:,} triangles", 0.0)


Judge = Callable[[Any], Task[Any]]
"""Measures how far a mesh deviates from what it stands for: takes a Mesh, returns a Deviation."""


class Maker(Protocol):
    """Makes coarser meshes in one way."""

    def make(self, triangles: int) -> Task[Sequence[Mesh]]:
        """A mesh of about so many triangles, or of more if it cannot. Those after it are measured if it is just beyond the
        limit. Its steps are those of `making`."""
        ...

    def corrected(self, candidate: "Candidate") -> "Self | None":
        """The maker that spares what one of its meshes lost; None if nothing is left to spare."""
        ...


class StepMaker(Maker, Protocol):
    """Makes coarser meshes of one of its own, step by step. is_corrected: whether it spares anything."""

    is_corrected: bool

    def of(self, mesh: Any) -> Self:
        """The same way, with another mesh to start from."""
        ...

    def uncorrected(self) -> Self:
        """The same way, without sparing anything."""
        ...


@dataclass(frozen=True, eq=False)
class Candidate:
    """A mesh that was measured.

    Attributes:
        mesh: The mesh.
        maker: Of the mesh; None if it was there.
        deviation: As its judge measured it.
        limit: What it may deviate.
        factor: On the excess: by how much exact measurements differ from this one.
    """

    mesh: Mesh
    maker: Maker | None
    deviation: Deviation
    limit: Limit
    factor: float = 1.0

    @property
    def triangles(self) -> int:
        return self.mesh.triangles

    @property
    def excess(self) -> float:
        """How much of the limit it takes: more than 1 beyond it."""
        return self.factor * self.deviation.excess(self.limit)

    @property
    def spent(self) -> float:
        """The share of texels that are beyond the limit."""
        return self.deviation.spent(self.limit)


class Search:
    """Meshes that makers make and a judge measures, until the coarsest within a limit is found.

    count: how many were measured.

    Args:
        limit: of all meshes.
        judge: measures them.
        remove: takes a mesh that nobody needs any more.
    """

    def __init__(self, limit: Limit, judge: Judge, remove: Callable[[Any], None]):
        self.limit, self.count = limit, 0
        self._judge, self._remove, self._factor = judge, remove, 1.0
        self._made: list[Candidate] = []
        """Those whose meshes exist."""
        self._shares = _shares_of_tries()

    def attempt(self, maker: Maker, triangles: int) -> Task[Candidate]:
        """The best mesh of about this many triangles by one maker."""
        meshes, tries = (yield from maker.make(triangles)), list[Candidate]()
        for number, mesh in enumerate(meshes):
            if tries and not 1.0 < tries[0].excess < MOST_FOR_OTHERS:
                self._remove(mesh)
                continue
            deviation = yield from part(self._judge(mesh), number / len(meshes), (number + 1) / len(meshes))
            self.count += 1
            tries.append(Candidate(mesh, maker, deviation, self.limit, self._factor))
        self._made += tries
        return min(tries, key=lambda each: each.excess)

    def keep_only(self, kept: Sequence[Candidate]) -> None:
        """Remove all meshes that were made but these."""
        meshes = [each.mesh for each in kept]
        for each in [each for each in self._made if each.mesh not in meshes]:
            self._remove(each.mesh)
            self._made.remove(each)

    def best_of(
        self,
        makers: Sequence[Maker],
        triangles: int,
        cost: Callable[[Candidate], float],
        corrections: int,
        variant: Callable[[Candidate], Maker | None] = lambda _: None,
    ) -> Task[Candidate]:
        """The mesh of about this many triangles that costs least: one of each maker, some more of the best maker that can
        be corrected, each corrected by what the mesh before it lost, and one of a variant.

        Args:
            makers: in which ways meshes are made.
            triangles: of all of them.
            cost: of a candidate.
            corrections: how many more are made at most: the first one that gains less than GAIN is the last.
            variant: gives the last maker by the best of the other meshes; None for none.
        """
        tries, count = [], len(makers) + corrections + 1

        def add(maker: Maker) -> Task[None]:
            share = len(tries) / count
            tries.append((yield from part(self.attempt(maker, triangles), share, share + 1.0 / count)))

        for maker in makers:
            yield from add(maker)
        better = (each.maker.corrected(each) for each in sorted(tries, key=cost))
        corrected = next(filter(None, better), None)
        for _ in range(corrections):
            if corrected is None:
                break
            least = min(map(cost, tries))
            yield from add(corrected)
            if cost(tries[-1]) > (1.0 - GAIN) * least:
                break
            corrected = corrected.corrected(tries[-1])
        last = variant(min(tries, key=cost))
        if last is not None:
            yield from add(last)
        best = min(tries, key=cost)
        self.keep_only([best])
        return best

    def min_triangles(self, maker: Maker, first: int, most: int) -> Task[Candidate]:
        """The mesh of the fewest triangles within the limit, or the nearest to it if none is within it.

        The number of triangles of the next try is where the excess, a power of it, meets the limit.

        Args:
            maker: makes meshes of any number of triangles anew.
            first: the triangles of the first try.
            most: the most of any.
        """
        within, beyond, wanted = None, None, min(first, most)
        for _ in range(TRIES):
            last = yield from part(self.attempt(maker, wanted), *next(self._shares))
            if last.excess <= 1.0:
                if within is not None and last.triangles >= within.triangles:
                    break  # there is no coarser mesh
                within = last
            else:
                beyond = last
            if within is None:
                if wanted >= most:
                    break
                wanted = min(most, int(wanted * min(max(last.excess**2, CLOSER), 4.0)) + 1)
            elif beyond is None or beyond.triangles >= within.triangles:
                wanted = max(LEAST, int(within.triangles / max(max(last.excess, 0.5) ** -2.0, CLOSER)))
                if wanted >= within.triangles:
                    break
            elif beyond.triangles >= FEWER * within.triangles - ODD:
                break
            else:
                wanted = _between(beyond, within)
        best = within or min(self._made, key=lambda each: each.excess)
        self.keep_only([best])
        return best


class StepSearch(Search):
    """Makes meshes coarser step by step, as long as they are within the limit.

    The judge is quick. The result, and the mesh beyond the limit, are measured exactly; where both measurements disagree, the
    search goes on with what the exact one says.

    A step is done again without touching what came to lie beyond the limit: narrow bevels keep their triangles while the rest
    becomes coarser. Where that leaves too few triangles to remove, or before a search ends, a step is done with all of them
    free.

    Args:
        limit, judge, remove: as Search has them.
        exact: a judge that is right.
    """

    def __init__(self, limit: Limit, judge: Judge, remove: Callable[[Any], None], exact: Judge):
        super().__init__(limit, judge, remove)
        self._exact = exact
        self._passed: list[Candidate] = []
        """The results of steps that were within the limit."""

    def coarsest(self, start: Candidate, maker: StepMaker) -> Task[tuple[Candidate, Candidate | None]]:
        """The coarsest mesh within the limit, and one with FEWER of its triangles that is beyond it; None if there is none.

        Args:
            start: a mesh within the limit.
            maker: of the coarser ones.
        """
        self._maker = maker
        within, beyond = yield from part(self._by_steps(start), 0.0, 0.9)
        within, beyond = yield from part(self._confirmed(start, within, beyond), 0.9, 1.0)
        self.keep_only([within])
        return within, beyond

    def _by_steps(self, start: Candidate, share: float = STRIDE) -> Task[tuple[Candidate, Candidate | None]]:
        """As `coarsest`, by the quick judge. share: of triangles, that the first step leaves."""
        within = start
        while True:
            wanted = max(min(int(share * within.triangles), within.triangles - ODD), LEAST)
            made = yield from self._step(within, wanted, is_last=share >= FEWER)
            coarser = [each for each in made if each.triangles < within.triangles]
            good = [each for each in coarser if each.excess <= 1.0]
            if good:
                within = min(good, key=lambda each: (each.spent, each.excess))
            elif share >= FEWER:
                return within, min(coarser, key=lambda each: each.excess, default=None)
            else:
                is_far = min((each.excess for each in coarser), default=1.0) > FAR
                share = min(share ** (0.25 if is_far else 0.5), FEWER)

    def _step(self, base: Candidate, wanted: int, *, is_last: bool) -> Task[list[Candidate]]:
        """Coarser meshes of one, of about as many triangles as wanted, in one or several ways, or with more if it cannot be."""
        self.keep_only([base, *self._passed])
        start, stop = next(self._shares)
        result: list[Candidate] = []

        def add(maker: StepMaker) -> Task[None]:
            ends = (start + (stop - start) * share / 3.0 for share in (len(result), len(result) + 1))
            result.append((yield from part(self.attempt(maker.of(base.mesh), wanted), *ends)))

        def has_good() -> bool:
            return any(each.excess <= 1.0 and each.triangles < base.triangles for each in result)

        maker = self._maker
        yield from add(maker)
        has_room = result[0].triangles <= wanted + ODD
        more = maker.corrected(result[0])
        if more is not None and has_room and result[0].excess < MOST_FOR_SPARING:
            yield from add(more)
        if has_good():
            self._maker = more or maker
        elif maker.is_corrected and (is_last or not has_room):
            yield from add(maker.uncorrected())
            self._maker = maker.uncorrected() if has_good() else maker
        self._passed += [each for each in result if each.excess <= 1.0]
        return result

    def _confirmed(
        self, start: Candidate, within: Candidate, beyond: Candidate | None
    ) -> Task[tuple[Candidate, Candidate | None]]:
        """The result of a search after exact measurements."""
        self._shares = _shares_of_tries()
        while True:
            if within is not start:
                exact = yield from self._measured_exactly(within)
                if exact.excess > 1.0:
                    self._learn(within, exact)
                    finer = self._coarsest_passed(start)
                    share = min(max(math.sqrt(exact.triangles / finer.triangles), STRIDE), FEWER)
                    within, beyond = yield from self._by_steps(finer, share)
                    continue
                within = exact
            if beyond is None:
                return within, None
            exact = yield from self._measured_exactly(beyond)
            if exact.excess > 1.0:
                return within, exact
            self._learn(beyond, exact)
            start = exact
            within, beyond = yield from self._by_steps(exact, FEWER)

    def _measured_exactly(self, candidate: Candidate) -> Task[Candidate]:
        deviation = yield from part(self._exact(candidate.mesh), *next(self._shares))
        self.count += 1
        return replace(candidate, deviation=deviation, factor=1.0)

    def _learn(self, quick: Candidate, exact: Candidate) -> None:
        """Judge by how much an exact measurement differs from the quick one of the same mesh, and spare what it found."""
        self._factor *= exact.excess / max(quick.excess, 1e-6)
        self._maker = self._maker.corrected(exact) or self._maker
        if exact.excess <= 1.0:
            self._passed.append(exact)

    def _coarsest_passed(self, start: Candidate) -> Candidate:
        """The coarsest mesh of all steps that is within the limit with the present factor; `start` if none is."""
        now = [replace(each, factor=self._factor) for each in self._passed if each.triangles < start.triangles]
        return min((each for each in now if each.excess <= 1.0), key=lambda each: each.triangles, default=start)


def _shares_of_tries() -> Iterator[tuple[float, float]]:
    """Where the progress of one try after another begins and ends, of tries whose number is not known."""
    left = 1.0
    while True:
        yield 1.0 - left, 1.0 - SHARE_LEFT * left
        left *= SHARE_LEFT


def _between(beyond: Candidate, within: Candidate) -> int:
    """The triangles at which a straight line of logarithms meets the limit, but not close to either end."""
    low, high = math.log(beyond.triangles), math.log(within.triangles)
    above, below = math.log(beyond.excess), -math.log(max(within.excess, 1e-6))
    share = above / max(above + below, 1e-6)
    step = min(0.5 * (high - low), -math.log(FEWER) * 0.9)
    return round(math.exp(min(max(low + share * (high - low), low + step), high - step)))
