# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the triangles that touch some squares of a map, and the squares that triangles touch."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ..core import threads, udim
from .triangle_mesh import Mesh
from .uv_layout import ROUNDING, SNAP

MOST_PIECES = 2**18
"""The most pieces into which `covered` splits the triangles of a block."""
PIECE = 2
"""The widest piece, in squares, that is not split."""
FAR = 4.0
"""Triangles of this extent in UV space are not split: single precision is too coarse for the middles of larger ones."""


def touching(mesh: Mesh, uv_to_clip: udim.UvToClip, size: tuple[int, int], blocks: np.ndarray, side: int) -> np.ndarray:
    """Which triangles (T,) bool have a box in UV space that touches one of the squares, when drawn on `size` texels.

    uv_to_clip: without the offset of a sample. blocks (rows, columns) bool: squares of `side` texels, from the lowest row.
    """
    counts = np.zeros((blocks.shape[0] + 1, blocks.shape[1] + 1), np.int32)
    np.cumsum(np.cumsum(blocks, axis=0, dtype=np.int32), axis=1, out=counts[1:, 1:])
    result = np.empty(len(mesh.triangles), bool)

    def measure(part: slice) -> None:
        corners = _corners(mesh, part)
        x0, x1, y0, y1 = _boxes(corners, uv_to_clip, size, blocks.shape, side)
        result[part] = counts[y1, x1] - counts[y0, x1] - counts[y1, x0] + counts[y0, x0] > 0

    threads.for_blocks(len(result), measure)
    return result


def covered(meshes: Sequence[Mesh], uv_to_clip: udim.UvToClip, size: tuple[int, int], side: int) -> np.ndarray:
    """Which squares (rows, columns) bool of `side` texels the triangles may touch, when drawn on `size` texels.

    Large triangles are split, so that the boxes of their pieces lie close to them; all squares count where that would take too
    many pieces. uv_to_clip: as in `touching`.
    """
    result = np.zeros((-(-size[1] // side), -(-size[0] // side)), bool)

    def mark(mesh: Mesh, part: slice) -> None:
        pieces = _corners(mesh, part)
        while pieces.shape[1]:
            boxes = _boxes(pieces, uv_to_clip, size, result.shape, side)
            x0, x1, y0, y1 = boxes
            is_in = (x1 > x0) & (y1 > y0)
            is_large = is_in & (np.maximum(x1 - x0, y1 - y0) > PIECE)
            x0, x1, y0, y1 = boxes[:, is_in & ~is_large]
            for x in (x0, x1 - 1):
                for y in (y0, y1 - 1):
                    result[y, x] = True
            pieces = pieces[:, is_large]
            if pieces.shape[1] > MOST_PIECES or np.ptp(pieces, axis=2).max(initial=0.0) >= FAR:
                result[:] = True
                return
            pieces = _halves(pieces)

    for mesh in meshes:
        threads.for_blocks(len(mesh.triangles), partial(mark, mesh))
    return result


def _halves(corners: np.ndarray) -> np.ndarray:
    """Triangles (2, T, 3) as (2, 2 T, 3), each split at the middle of its longest edge."""
    lengths = np.square(np.roll(corners, -1, axis=2) - corners).sum(axis=0)
    order = (lengths.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(corners, order[None], axis=2).transpose(2, 0, 1)
    middle = (a + b) * np.float32(0.5)
    return np.concatenate([np.stack([a, middle, c], axis=2), np.stack([middle, b, c], axis=2)], axis=1)


def _corners(mesh: Mesh, part: slice) -> np.ndarray:
    """The corners (2, T, 3) float32 of these triangles in UV space."""
    return np.take(mesh.uv, mesh.triangles[part].reshape(-1), axis=0, mode="clip").T.reshape(2, -1, 3)


def _boxes(
    corners: np.ndarray, uv_to_clip: udim.UvToClip, size: tuple[int, int], shape: tuple[int, int], side: int
) -> np.ndarray:
    """The first column, the last one plus 1, and the same for rows (4, T) int32 of the squares that each triangle may touch."""
    edges = []
    with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
        for axis, (a, b, c) in enumerate(corners.transpose(0, 2, 1)):
            half, most = size[axis] / 2.0, np.float32(shape[1 - axis])
            scale, shift = uv_to_clip[axis] * half, (uv_to_clip[axis + 2] + 1.0) * half
            room = SNAP + ROUNDING * (abs(shift) + 2.0 * half)
            lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
            first = np.floor((lowest * np.float32(scale) + np.float32(shift - room)) / side)
            last = np.floor((highest * np.float32(scale) + np.float32(shift + room)) / side) + 1.0
            # Comparisons with NaN are False: such triangles cover nothing.
            edges += [np.where(end > 0.0, np.minimum(end, most), 0.0).astype(np.int32) for end in (first, last)]
    return np.stack(edges)


def runs(chosen: np.ndarray, most: int) -> list[tuple[int, int]]:
    """At most so many ranges, each its start and its length, that hold all True of `chosen` (N,) bool, and few others."""
    steps = np.diff(chosen.astype(np.int8), prepend=0, append=0)
    starts, stops = np.flatnonzero(steps > 0), np.flatnonzero(steps < 0)
    if len(starts) > most:
        gaps = starts[1:] - stops[:-1]
        kept = np.sort(np.argsort(gaps)[len(gaps) - (most - 1) :])
        starts, stops = np.r_[starts[0], starts[1:][kept]], np.r_[stops[:-1][kept], stops[-1]]
    return list(zip(starts.tolist(), (stops - starts).tolist(), strict=True))
