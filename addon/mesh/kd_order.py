# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts points in an order in which runs lie close together: a balanced k-d tree, less its nodes."""

import numpy as np

from . import threads

LEAF = 4
"""Runs of so many are not cut any more."""
PART = LEAF**8
"""Runs of so many are cut to the end by one thread, level by level, in 32 bits and in its processor's cache."""


def order(points: np.ndarray) -> np.ndarray:
    """The order (N,) int64 of `points` (3, N) uint16, N < 2^32, in which every run of 4^k that starts at a multiple of 4^k
    is cut from its neighbors in the next larger run by planes across what is longest. Within LEAF any order will do.
    """
    runs, size = [(np.arange(points.shape[1]), points)], LEAF
    while size < points.shape[1]:
        size *= 4
    while size > PART:
        size //= 2
        pairs = threads.at_once(lambda run, half=size: _halves(*run, half), runs)
        runs = [half for pair in pairs for half in pair]
    return np.concatenate(threads.at_once(lambda run: run[0][_Part(run[1]).order(size)], runs))


def _halves(places: np.ndarray, points: np.ndarray, half: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of `points` and their places the `half` that are lowest along the longest side, and the others if there are any."""
    if len(places) <= half:
        return [(places, points)]
    longest = points[np.argmax([np.ptp(axis) for axis in points])]
    # The coordinate above the place: a key that is moved carries along whose it is, and no two are the same.
    keys = longest.astype(np.uint64) << np.uint64(32)
    keys |= np.arange(len(places), dtype=np.uint64)
    keys.partition(half)
    keys &= np.uint64(2**32 - 1)
    found = keys.view(np.int64)
    return [(places[run], np.take(points, run, axis=1)) for run in (found[:half], found[half:])]


class _Part:
    """Cuts `points`, PART at the most."""

    def __init__(self, points: np.ndarray):
        self.points, self.count = points, points.shape[1]
        self.keys = (points.astype(np.uint32) << np.uint32(16) | np.arange(self.count, dtype=np.uint32)).reshape(-1)

    def order(self, size: int) -> np.ndarray:
        """As the function of this name, of a run of `size` at the most."""
        places = np.arange(self.count)
        while size > LEAF:
            self._cut(places, size)
            size //= 4
        return places

    def _cut(self, places: np.ndarray, size: int) -> None:
        """Order `places` in place so that in each run of `size`, the last of which may be shorter, quarters are cut."""
        whole = len(places) // size * size
        runs, rest = places[:whole].reshape(-1, size), places[whole:]
        if len(runs):
            spans = self._spans(runs)
            longest = np.argmax(spans, axis=1)
            self._halve(runs, longest, size // 2)
            # Of the halves this is not measured again, but taken to be so.
            spans[np.arange(len(spans)), longest] //= 2
            longest = np.repeat(np.argmax(spans, axis=1), 2)
            self._halve(runs.reshape(-1, size // 2), longest, size // 4)
        for run, half in ((rest, size // 2), (rest[: size // 2], size // 4), (rest[size // 2 :], size // 4)):
            if len(run) > half:
                self._halve(run[None], np.argmax(self._spans(run[None]), axis=1), half)

    def _halve(self, runs: np.ndarray, axes: np.ndarray, half: int) -> None:
        """Bring those that are lowest along its own one of `axes` (R,) of each of `runs` (R, n) to its first `half`."""
        chosen = np.take(self.keys, runs + axes[:, None] * self.count, mode="clip")
        chosen.partition(half, axis=1)
        runs[...] = chosen & np.uint32(0xFFFF)

    def _spans(self, runs: np.ndarray) -> np.ndarray:
        """How far each of `runs` (R, n) reaches along the axes, (R, 3)."""
        spans = []
        for values in self.points:
            low = high = np.take(values, runs, mode="clip")
            # Reducing along a short axis is slow: whole arrays are folded first.
            while high.shape[1] % 2 == 0 and high.shape[1] <= 32:
                low, high = np.minimum(low[:, 0::2], low[:, 1::2]), np.maximum(high[:, 0::2], high[:, 1::2])
            spans.append(high.max(axis=1) - low.min(axis=1))
        return np.stack(spans, axis=1)
