# SPDX-License-Identifier: GPL-3.0-or-later
"""Sorts triangles in UV space into square cells of a map, so that what covers a point is found without drawing."""

from dataclasses import dataclass

import numpy as np

from ..core import udim
from .uv_layout import ROUNDING, SNAP

FARTHEST = 2.0**22
"""In texels. Triangles farther away cover nothing."""
PAIRS = 2**20
"""The most pairs of a triangle and a cell that are looked at together."""


@dataclass(frozen=True)
class CellTriangles:
    """Triangles by cell, and in each cell in the order of the mesh.

    starts (cells + 1,) int64: where the triangles of each cell begin; cells go row by row. triangles (N,) int: their numbers in
    the mesh. points (2, 3, N) float64: x and y of the corners in texels, from the cell's center.
    """

    starts: np.ndarray
    triangles: np.ndarray
    points: np.ndarray

    def planes(self, values: np.ndarray) -> np.ndarray:
        """The linear functions that have these values at the corners: (N, 3, C) float32, at the cell's center and their slopes
        along x and y in texels. values (N, 3, C)."""
        (x0, x1, x2), (y0, y1, y2) = self.points
        x1, x2, y1, y2 = x1 - x0, x2 - x0, y1 - y0, y2 - y0
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # of slivers that rounding has opened
            scale = (1.0 / (x1 * y2 - x2 * y1))[:, None]
            first = values[:, 0].astype(np.float64)
            one, other = values[:, 1] - first, values[:, 2] - first
            along_x = (one * y2[:, None] - other * y1[:, None]) * scale
            along_y = (other * x1[:, None] - one * x2[:, None]) * scale
            center = first - along_x * x0[:, None] - along_y * y0[:, None]
            return np.stack([center, along_x, along_y], axis=1).astype(np.float32)


def squares(mask: np.ndarray, side: int) -> np.ndarray:
    """Which squares (rows, columns) bool of `side` texels have a True of `mask` (height, width) bool."""
    height, width = mask.shape
    rows, columns = -(-height // side), -(-width // side)
    if (rows * side, columns * side) != mask.shape:
        padded = np.zeros((rows * side, columns * side), bool)
        padded[:height, :width] = mask
        mask = padded
    return mask.reshape(rows, side, columns, side).any(axis=(1, 3))


def sort(
    uv: np.ndarray, uv_to_clip: udim.UvToClip, size: tuple[int, int], cells: np.ndarray, side: int
) -> CellTriangles:
    """The triangles that may cover a point in some cells, with room for how rasterizers round corners. Those with two
    corners at one place cover none.

    uv (2, 3, T) float32: of their corners. uv_to_clip: without the offset of a sample; it draws on `size` texels.
    cells (rows, columns) bool: which squares of `side` texels are asked for, from the lowest row.
    """
    corners, room = _in_texels(uv, uv_to_clip, size)
    lowest, highest = corners.min(axis=1) - room, corners.max(axis=1) + room
    limits = np.array(cells.shape[::-1])[:, None]
    with np.errstate(invalid="ignore"):
        is_near = (np.maximum(np.abs(lowest), np.abs(highest)) < FARTHEST).all(axis=0)  # False for NaN
    # Meshes without a layout have thousands of these at one place.
    is_near &= (uv != np.roll(uv, 1, axis=1)).any(axis=0).all(axis=0)
    near = np.flatnonzero(is_near)
    first = np.clip(np.floor(lowest[:, near] / side).astype(np.int64), 0, limits)
    last = np.clip(np.floor(highest[:, near] / side).astype(np.int64) + 1, 0, limits)
    is_in = (first < last).all(axis=0)
    near, boxes = near[is_in], np.concatenate([first, last])[:, is_in]
    ends = np.cumsum((boxes[2] - boxes[0]) * (boxes[3] - boxes[1]))
    found = [(np.empty(0, np.int64), np.empty(0, np.int64))]
    start = 0
    while start < len(near):
        most = (ends[start - 1] if start else 0) + PAIRS
        part = slice(start, max(start + 1, int(np.searchsorted(ends, most, side="right"))))
        found.append(_pairs(near[part], boxes[:, part], corners, cells, side=side, room=room.max()))
        start = part.stop
    numbers, which = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(which, kind="stable")
    numbers, which = numbers[order], which[order]
    starts = np.zeros(cells.size + 1, np.int64)
    np.cumsum(np.bincount(which, minlength=cells.size), out=starts[1:])
    rows, columns = np.divmod(which, cells.shape[1])
    centers = (np.stack([columns, rows]) + 0.5) * side
    return CellTriangles(starts, numbers, corners[:, :, numbers] - centers[:, None])


def _in_texels(uv: np.ndarray, uv_to_clip: udim.UvToClip, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """UVs (2, ...) float32 in texels, float64, and how far rasterizers move them (2, 1)."""
    result, room = np.empty(uv.shape), np.empty((2, 1))
    with np.errstate(over="ignore", invalid="ignore"):  # of UVs that lie far outside
        for axis in range(2):
            half = size[axis] / 2.0
            shift = (uv_to_clip[axis + 2] + 1.0) * half
            result[axis] = uv[axis] * (uv_to_clip[axis] * half) + shift
            room[axis] = SNAP + ROUNDING * (abs(shift) + 2.0 * half)
    return result, room


def _pairs(
    numbers: np.ndarray, boxes: np.ndarray, corners: np.ndarray, cells: np.ndarray, *, side: int, room: float
) -> tuple[np.ndarray, np.ndarray]:
    """The triangles and the cells of all pairs that may touch.

    numbers (T,): of the triangles. boxes (4, T): their first column and row of cells, and the last ones plus 1. corners
    (2, 3, all): in texels. room: how far a corner may move.
    """
    x0, y0, x1, y1 = boxes
    counts = (x1 - x0) * (y1 - y0)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    rows, columns = np.divmod(within, np.repeat(x1 - x0, counts))
    x, y = columns + np.repeat(x0, counts), rows + np.repeat(y0, counts)
    is_asked = cells[y, x]
    numbers, x, y = np.repeat(numbers, counts)[is_asked], x[is_asked], y[is_asked]
    px, py = corners[:, :, numbers]
    px, py = px - (x + 0.5) * side, py - (y + 0.5) * side
    turn = np.sign((px[1] - px[0]) * (py[2] - py[0]) - (px[2] - px[0]) * (py[1] - py[0]))
    touches = np.ones(len(numbers), bool)
    for corner in range(3):
        ax, ay = px[corner], py[corner]
        dx, dy = (px[corner - 2] - ax) * turn, (py[corner - 2] - ay) * turn
        touches &= dy * ax - dx * ay + (np.abs(dx) + np.abs(dy)) * (0.5 * side + room) >= 0.0
    return numbers[touches], (y * cells.shape[1] + x)[touches]
