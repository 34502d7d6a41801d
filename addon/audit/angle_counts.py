# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts angles of texels, tile by tile, for their percentiles."""

import numpy as np

BINS = 1000
"""Of a degree. Percentiles are rounded down to them."""


class AngleCounts:
    """Angles in degrees, from 0 to 180."""

    def __init__(self):
        self._counts = np.zeros(180 * BINS + 1, np.int64)
        self._largest = 0.0

    def add(self, angles: np.ndarray) -> None:
        """Count angles (N,)."""
        if len(angles):
            bins = (angles * BINS).astype(np.int64).clip(0, 180 * BINS)
            self._counts += np.bincount(bins, minlength=180 * BINS + 1)
            self._largest = max(self._largest, float(angles.max()))

    def results(self) -> dict[str, float | int]:
        """The median, percentile_95, percentile_99 and maximum, and the number of texels."""
        sums = np.cumsum(self._counts)
        median, most, nearly_all = (
            float(np.searchsorted(sums, share * max(1, sums[-1]))) / BINS for share in (0.5, 0.95, 0.99)
        )
        return {
            "median": median,
            "percentile_95": most,
            "percentile_99": nearly_all,
            "maximum": self._largest,
            "texels": int(sums[-1]),
        }
