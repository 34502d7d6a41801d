# SPDX-License-Identifier: GPL-3.0-or-later
"""Sorts points so that runs of them are close in space: the order of a balanced k-d tree, without its nodes."""

import numpy as np

from ...core import threads

LEAF = 4
"""The length of runs that are not divided further."""
PART = LEAF**8
"""The length of runs that one thread divides completely, level by level, with 32-bit keys in the processor's cache."""


def order(points: np.ndarray) -> np.ndarray:
    """Returns the order (N,) int64 of `points` (3, N) uint16, N < 2^32.

    In it, every run of 4^k points that starts at a multiple of 4^k is separated from its neighbors in the next larger run
    by planes across the longest axis. The order within a run of LEAF is arbitrary.
    """
    runs, size = [(np.arange(points.shape[1]), points)], LEAF
    while size < points.shape[1]:
        size *= 4
    while size > PART:
        size //= 2
        pairs = threads.map_parallel(lambda run, half=size: _halves(*run, half), runs)
        runs = [half for pair in pairs for half in pair]
    return np.concatenate(threads.map_parallel(lambda run: run[0][_Part(run[1]).order(size)], runs))


def _halves(indices: np.ndarray, points: np.ndarray, half: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Split `points` and their indices along the longest axis: the `half` lowest, then the rest, if any."""
    if len(indices) <= half:
        return [(indices, points)]
    longest = points[np.argmax([np.ptp(axis) for axis in points])]
    # Both halves stay in the order in which they were: what lies close in memory is fast to fetch.
    middle = np.partition(longest, half)[half]
    is_low = longest < middle
    missing = half - np.count_nonzero(is_low)
    is_low[np.flatnonzero(longest == middle)[:missing]] = True
    runs = np.flatnonzero(is_low), np.flatnonzero(~is_low)
    return [(np.take(indices, run), np.take(points, run, axis=1)) for run in runs]


class _Part:
    """Sorts at most PART `points`."""

    def __init__(self, points: np.ndarray):
        self.points, self.count = points, points.shape[1]
        self.keys = (points.astype(np.uint32) << np.uint32(16) | np.arange(self.count, dtype=np.uint32)).reshape(-1)

    def order(self, size: int) -> np.ndarray:
        """Returns the order (N,) int64 of the points, as the function `order` does, for a run of at most `size`."""
        indices = np.arange(self.count)
        while size > LEAF:
            self._cut(indices, size)
            size //= 4
        return indices

    def _cut(self, indices: np.ndarray, size: int) -> None:
        """Sort each run of `size` in `indices` into quarters, in place. The last run may be shorter."""
        whole = len(indices) // size * size
        runs, rest = indices[:whole].reshape(-1, size), indices[whole:]
        if len(runs):
            spans = self._spans(runs)
            longest = np.argmax(spans, axis=1)
            self._halve(runs, longest, size // 2)
            # Assume that each half spans half of the axis: measuring again would cost more.
            spans[np.arange(len(spans)), longest] //= 2
            longest = np.repeat(np.argmax(spans, axis=1), 2)
            self._halve(runs.reshape(-1, size // 2), longest, size // 4)
        for run, half in ((rest, size // 2), (rest[: size // 2], size // 4), (rest[size // 2 :], size // 4)):
            if len(run) > half:
                self._halve(run[None], np.argmax(self._spans(run[None]), axis=1), half)

    def _halve(self, runs: np.ndarray, axes: np.ndarray, half: int) -> None:
        """Move the lowest `half` points of each of `runs` (R, n) to its front, by the axis (R,) given for each run."""
        chosen = np.take(self.keys, runs + axes[:, None] * self.count, mode="clip")
        chosen.partition(half, axis=1)
        runs[...] = chosen & np.uint32(0xFFFF)

    def _spans(self, runs: np.ndarray) -> np.ndarray:
        """The extent (R, 3) of each of `runs` (R, n) along the axes."""
        spans = []
        for values in self.points:
            low = high = np.take(values, runs, mode="clip")
            # Reducing along a short axis is slow: fold whole arrays first.
            while high.shape[1] % 2 == 0 and high.shape[1] <= 32:
                low, high = np.minimum(low[:, 0::2], low[:, 1::2]), np.maximum(high[:, 0::2], high[:, 1::2])
            spans.append(high.max(axis=1) - low.min(axis=1))
        return np.stack(spans, axis=1)
