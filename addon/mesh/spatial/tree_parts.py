# SPDX-License-Identifier: GPL-3.0-or-later
"""A tree of bvh.py over more triangles than one can hold: several, over parts of the same order, with the same boxes."""

from collections.abc import Callable, Iterator

import numpy as np

from ...core import threads
from . import bvh, kd_order
from .bvh import Grid

BLOCK = 2**24
"""Triangles whose boxes are in memory at once while the order is found."""

CornersOf = Callable[[slice], np.ndarray]
"""A function from a slice of the triangles to their corners (N, 3) int, indices into points."""


def order(points: np.ndarray, corners_of: CornersOf, count: int) -> tuple[np.ndarray, Grid]:
    """The order (T,) int32 in which bvh.build has `count` triangles, and its grid. points (P, 3) float32."""
    ends = [(boxes[0].min(axis=1), boxes[1].max(axis=1)) for _, boxes in _boxes_of_blocks(points, corners_of, count)]
    lows, highs = zip(*ends, strict=True)
    grid = Grid.around(np.min(lows, axis=0), np.max(highs, axis=0))
    centers = np.empty((3, count), np.uint16)
    for block, boxes in _boxes_of_blocks(points, corners_of, count):
        into = centers[:, block]

        def find(part: slice, into: np.ndarray = into, boxes: np.ndarray = boxes) -> None:
            into[:, part] = grid.centers(grid.rounded(boxes[:, :, part]))

        threads.for_blocks(boxes.shape[2], find)
    return kd_order.order(centers).astype(np.int32), grid


def nodes(points: np.ndarray, corners: np.ndarray, grid: Grid) -> tuple[np.ndarray, int]:
    """The nodes and the first leaf, as bvh.Tree has them, over triangles (T, 3) in the order that `order` has found."""
    boxes = bvh.boxes_of(points, corners)
    rounded = np.empty(boxes.shape, np.uint16)

    def round_outwards(part: slice) -> None:
        rounded[:, :, part] = grid.rounded(boxes[:, :, part])

    threads.for_blocks(len(corners), round_outwards)
    return bvh.stack(*rounded)


def _boxes_of_blocks(points: np.ndarray, corners_of: CornersOf, count: int) -> Iterator[tuple[slice, np.ndarray]]:
    for start in range(0, count, BLOCK):
        block = slice(start, min(start + BLOCK, count))
        yield block, bvh.boxes_of(points, corners_of(block))
