# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds what belongs together in a mesh: the corners of some vertices, their faces, and the triangles of these."""

from functools import cached_property

import numpy as np

BLOCK = 512
"""Corners that are left out together if they have no vertex that is looked for: those close in a mesh have close numbers."""


class FaceCorners:
    """The faces of a mesh, by corners.

    starts (F + 1,) int32: the first corner of each face, and at the end C. vertices (C,) int32: the vertex of each corner.
    """

    def __init__(self, starts: np.ndarray, vertices: np.ndarray):
        self.starts, self.vertices = starts, vertices

    def corners_at(self, vertices: np.ndarray, count: int) -> np.ndarray:
        """The corners of some of `count` vertices, ascending."""
        first, last = self._blocks
        is_near = np.searchsorted(vertices, first) < np.searchsorted(vertices, last, side="right")
        near = (np.flatnonzero(is_near)[:, None] * BLOCK + np.arange(BLOCK)).reshape(-1)
        near = near[: np.searchsorted(near, len(self.vertices))]
        is_wanted = np.zeros(count, bool)
        is_wanted[vertices] = True
        return near[is_wanted[self.vertices[near]]]

    def faces_of(self, corners: np.ndarray) -> np.ndarray:
        """The faces of some corners, each once, ascending."""
        return np.unique(np.searchsorted(self.starts, corners, side="right") - 1)

    def corners_of(self, faces: np.ndarray) -> np.ndarray:
        """The corners of some faces, face after face."""
        return _ranges(self.starts[faces], self.sizes(faces))

    def triangles_of(self, faces: np.ndarray) -> np.ndarray:
        """The numbers of the triangles of some faces, if each face is divided into triangles without more corners."""
        return _ranges(self.starts[faces] - 2 * faces, self.sizes(faces) - 2)

    def sizes(self, faces: np.ndarray) -> np.ndarray:
        """The number of corners of each of some faces."""
        return self.starts[faces + 1] - self.starts[faces]

    @cached_property
    def _blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest vertex of each block of corners."""
        starts = np.arange(0, len(self.vertices), BLOCK)
        return np.minimum.reduceat(self.vertices, starts), np.maximum.reduceat(self.vertices, starts)


def _ranges(starts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The numbers from each start on, as many as its size, one after the other."""
    before = np.cumsum(sizes) - sizes
    return np.arange(sizes.sum()) + np.repeat(starts - before, sizes)
