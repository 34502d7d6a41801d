# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds which triangles of a dense mesh a picture can show: GPUs color a pixel by what covers its middle."""

import numpy as np

from ..core import threads
from . import topology

ROUNDED = 1.0 / 64.0
"""Pixels by which a vertex may be drawn off its place: drivers round to 1 / 256 of a pixel, or to 1 / 16, and by half of that
at most."""
BITS = 15
"""Of a place along one side of a picture. The last one tells that rounding may change it."""
MOST = 2 ** (BITS - 1) - 4
"""The largest side of a picture, in pixels."""


class Triangles:
    """Triangles that many pictures show. points: (V, 3) float32. triangles: (T, 3) int."""

    def __init__(self, points: np.ndarray, triangles: np.ndarray):
        used, numbers = topology.numbered(triangles)
        self._points = np.ascontiguousarray(points[used].T)
        self._corners = np.ascontiguousarray(numbers.T)

    def at_middles(self, view: np.ndarray, side: int) -> np.ndarray:
        """The numbers (N,) int, ascending, of the triangles that may cover the middle of a pixel: all that do, and few others.

        Args:
            view: (4, 4), to clip space, in parallel projection. All points are within it.
            side: of the picture, in pixels.
        """
        keys, is_hit = np.empty(self._points.shape[1], np.int32), np.empty(self._corners.shape[1], bool)
        half = 0.5 * side
        scale = (half * view[:2, :3]).astype(np.float32)
        shift = (half * view[:2, 3] + half + 0.5).astype(np.float32)
        low, is_rounded = (1 << BITS) - 1, np.int32((1 << BITS - 1) * (1 + (1 << BITS)))

        def number(part: slice) -> None:
            """The middles before a vertex, and whether it is so near to one that rounding decides."""
            for axis in range(2):
                places = (scale[axis, :, None] * self._points[:, part]).sum(axis=0) + shift[axis]
                cells = places.astype(np.int32)
                places -= cells
                cells |= ((places < ROUNDED) | (places > 1.0 - ROUNDED)).astype(np.int32) << (BITS - 1)
                keys[part] = keys[part] | cells << BITS if axis else cells

        def find(part: slice) -> None:
            first, second, third = (np.take(keys, numbers[part], mode="clip") for numbers in self._corners)
            differ = first ^ second | first ^ third | first & is_rounded
            is_hit[part] = (differ & low != 0) & (differ >> BITS != 0)

        threads.for_blocks(len(keys), number)
        threads.for_blocks(len(is_hit), find)
        return np.flatnonzero(is_hit)
