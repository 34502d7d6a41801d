# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the triangles that touch some squares of a map."""

import numpy as np

from ..core import udim
from . import threads
from .triangle_mesh import Mesh
from .uv_layout import ROUNDING, SNAP


def touching(mesh: Mesh, uv_to_clip: udim.UvToClip, size: tuple[int, int], blocks: np.ndarray, side: int) -> np.ndarray:
    """Which triangles (T,) bool have a box in UV space that touches one of the squares, when drawn on `size` texels.

    uv_to_clip: without the offset of a sample. blocks (rows, columns) bool: squares of `side` texels, from the lowest row.
    """
    counts = np.zeros((blocks.shape[0] + 1, blocks.shape[1] + 1), np.int32)
    np.cumsum(np.cumsum(blocks, axis=0, dtype=np.int32), axis=1, out=counts[1:, 1:])
    result = np.empty(len(mesh.triangles), bool)

    def measure(part: slice) -> None:
        corners = np.take(mesh.uv, mesh.triangles[part].reshape(-1), axis=0, mode="clip").T.reshape(2, -1, 3)
        edges = []
        with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
            for axis, (a, b, c) in enumerate(corners.transpose(0, 2, 1)):
                half, most = size[axis] / 2.0, np.float32(blocks.shape[1 - axis])
                scale, shift = uv_to_clip[axis] * half, (uv_to_clip[axis + 2] + 1.0) * half
                room = SNAP + ROUNDING * (abs(shift) + 2.0 * half)
                lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
                first = np.floor((lowest * np.float32(scale) + np.float32(shift - room)) / side)
                last = np.floor((highest * np.float32(scale) + np.float32(shift + room)) / side) + 1.0
                # Comparisons with NaN are False: such triangles cover nothing.
                edges += [np.where(end > 0.0, np.minimum(end, most), 0.0).astype(np.int32) for end in (first, last)]
        x0, x1, y0, y1 = edges
        result[part] = counts[y1, x1] - counts[y0, x1] - counts[y1, x0] + counts[y0, x0] > 0

    threads.for_blocks(len(result), measure)
    return result


def runs(chosen: np.ndarray, most: int) -> list[tuple[int, int]]:
    """At most so many ranges, each its start and its length, that hold all True of `chosen` (N,) bool, and few others."""
    steps = np.diff(chosen.astype(np.int8), prepend=0, append=0)
    starts, stops = np.flatnonzero(steps > 0), np.flatnonzero(steps < 0)
    if len(starts) > most:
        gaps = starts[1:] - stops[:-1]
        kept = np.sort(np.argsort(gaps)[len(gaps) - (most - 1) :])
        starts, stops = np.r_[starts[0], starts[1:][kept]], np.r_[stops[:-1][kept], stops[-1]]
    return list(zip(starts.tolist(), (stops - starts).tolist(), strict=True))
