# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts angles of texels, tile by tile, for their percentiles."""

import numpy as np

DROPPED = 11
"""The last bits of an angle in single precision that its bin leaves out. Percentiles are within 0.02 % of angles, small ones
too."""
BINS = (int(np.float32(180.0).view(np.int32)) >> DROPPED) + 1


class AngleCounts:
    """Angles in degrees, from 0 to 180."""

    def __init__(self):
        self._counts = np.zeros(BINS, np.int64)
        self._largest = 0.0

    def add(self, angles: np.ndarray, weight: int = 1) -> None:
        """Count angles (N,), each as so many texels."""
        if len(angles):
            # The bits of numbers that are not negative have the order of the numbers.
            bins = np.clip(angles, np.float32(0.0), np.float32(180.0)).astype(np.float32).view(np.int32) >> DROPPED
            self._counts += weight * np.bincount(bins, minlength=BINS)
            self._largest = max(self._largest, float(angles.max()))

    def results(self) -> dict[str, float | int]:
        """The median, percentile_95, percentile_99 and maximum, and the number of texels."""
        sums = np.cumsum(self._counts)
        median, most, nearly_all = (
            self._of_bin(np.searchsorted(sums, share * max(1, sums[-1]))) for share in (0.5, 0.95, 0.99)
        )
        return {
            "median": median,
            "percentile_95": most,
            "percentile_99": nearly_all,
            "maximum": self._largest,
            "texels": int(sums[-1]),
        }

    def _of_bin(self, number: int) -> float:
        """The middle of a bin, at most the largest angle."""
        middle = (int(number) << DROPPED) + (1 << DROPPED - 1) if number else 0
        return min(float(np.int32(middle).view(np.float32)), self._largest)
