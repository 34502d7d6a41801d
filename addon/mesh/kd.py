# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts points in an order in which runs lie close together: a balanced k-d tree, less its nodes."""

import numpy as np

LEAF = 4
"""Runs of so many are not cut any more."""
PART = LEAF**7
"""Runs of so many are cut to the end before the next, while the processor has them in its cache."""


def order(points: np.ndarray) -> np.ndarray:
    """The order (N,) int64 of `points` (3, N) uint16, N < 2^32, in which every run of 4^k that starts at a multiple of 4^k
    is cut from its neighbours in the next larger run by planes across what is longest. Within LEAF any order will do.
    """
    count = points.shape[1]
    places = np.arange(count)
    size = LEAF
    while size < count:
        size *= 4
    whole = _Cutter(points)
    while size > PART:
        for start in range(0, count, size):
            whole.cut(places[start : start + size], size)
        size //= 4
    for start in range(0, count, size):
        run = places[start : start + size]
        own = np.arange(len(run))
        part, smaller = _Cutter(np.take(points, run, axis=1)), size
        while smaller > LEAF:
            part.cut(own, smaller)
            smaller //= 4
        run[:] = run[own]
    return places


class _Cutter:
    """Cuts runs of `points`."""

    def __init__(self, points: np.ndarray):
        self.points, self.count = points, points.shape[1]
        # The coordinate above the place: a key that is moved carries along whose it is, and no two are the same.
        kind, bits = (np.uint32, 16) if self.count <= 2**16 else (np.uint64, 32)
        self.place = kind(2**bits - 1)
        self.keys = (points.astype(kind) << kind(bits) | np.arange(self.count, dtype=kind)).reshape(-1)

    def cut(self, places: np.ndarray, size: int) -> None:
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
        runs[...] = chosen & self.place

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
