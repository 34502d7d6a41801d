# SPDX-License-Identifier: GPL-3.0-or-later
"""Directions of the rays from a texel: a lattice of points in the unit square, which each texel shifts by another amount."""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...core.progress import Pace

AT_ONCE = 64
"""The most rays of a texel in one dispatch: large maps take rows of few texels otherwise."""


@dataclass(frozen=True)
class Lattice:
    """A lattice of rank 1: point i is at (i * step[0] / count, i * step[1] / count), without the whole parts.

    step: the way from a point to the next, a short one, so that successive rays take similar ways. cell: the two shortest
    vectors of the lattice, as (x0, y0, x1, y1).
    """

    count: int
    step: tuple[int, int]
    cell: tuple[float, float, float, float]


@functools.cache
def of(count: int) -> Lattice:
    """The lattice of `count` points that integrates smooth functions best."""
    generators = (a for a in range(1, max(2, count // 2 + 1)) if math.gcd(a, count) == 1)
    chosen = min(generators, key=lambda a: _error(count, a))
    short, long = _reduced((1, chosen), (0, count))
    sums = [(short[0] * i + long[0] * j, short[1] * i + long[1] * j) for i in range(4) for j in range(-3, 4)]
    # Not every short step leads through all points.
    step = min((way for way in [*sums, (1, chosen)] if math.gcd(*way, count) == 1), key=lambda way: math.hypot(*way))
    return Lattice(count, (step[0] % count, step[1] % count), tuple(x / count for x in (*short, *long)))


def rays_of_sample(lattice: Lattice, sample: int, samples: int) -> range:
    """The rays that one of several samples in a texel casts: every texel casts all rays of the lattice once."""
    return range(sample, lattice.count, samples)


def slices(pace: Pace, height: int, rays: range, work: str = "") -> Iterator[tuple[range, range, bool]]:
    """Divide rays from `height` rows into slices, as Pace does: yields rows, rays, and whether these are the rows' first rays.

    The rays of a slice are spread over all directions, so that sums can be shown before they are complete. work: as Pace.slices
    takes it.
    """
    parts = -(-len(rays) // AT_ONCE)
    for part in range(parts):
        for rows in pace.slices(height, work):
            yield rows, rays[part::parts], part == 0


def _reduced(first: tuple[int, int], second: tuple[int, int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The two shortest vectors of the lattice that these two span, the shortest first (Gauss's reduction)."""
    while True:
        if math.hypot(*first) > math.hypot(*second):
            first, second = second, first
        times = round((first[0] * second[0] + first[1] * second[1]) / (first[0] ** 2 + first[1] ** 2))
        if times == 0:
            return first, second
        second = second[0] - times * first[0], second[1] - times * first[1]


def _error(count: int, generator: int) -> float:
    """The figure of merit P2 of a lattice (I. H. Sloan and S. Joe, "Lattice methods for multiple integration", 1994)."""
    x = np.arange(count)
    u, v = x / count, x * generator % count / count
    waves = [1.0 + 2.0 * np.pi**2 * (w * w - w + 1.0 / 6.0) for w in (u, v)]
    return float(np.mean(waves[0] * waves[1])) - 1.0
