# SPDX-License-Identifier: GPL-3.0-or-later
"""A bounding volume hierarchy over triangles, in a layout that a shader walks without a stack.

Triangles are sorted so that neighbors in the order are close in space (kd_order.py). Four in a row make a node, four nodes
make the node above, up to one root. The tree is complete, so an index is enough to find the children: those of node n are
4 n + 1 to 4 n + 4 (a heap with four children).
"""

from dataclasses import dataclass

import numpy as np

from ...core import threads
from . import kd_order

GRID = 256, 32767
"""The first and the last step, along each axis, of the grid to which boxes are rounded outwards."""

FLAT = 1e-5
"""The least extent of the grid along an axis, as a share of the largest one."""
ROUNDING = 1e-7
"""The least extent of the grid, as a share of the coordinates: about what single precision rounds."""
SMALLEST = 1e-20
"""The least extent of the grid, so that its scale fits single precision."""


@dataclass(frozen=True)
class Tree:
    """order (T,) int: triangle indices in the tree's order. first_leaf: the heap index of the first triangle.

    nodes (N, 3, 4) float32: for x, y and z, the boxes of the four children, as `pack` stores them; a missing child has
    low above high. A point p is at (p - origin) * scale in grid steps; origin, scale (3,) float64.
    """

    order: np.ndarray
    nodes: np.ndarray
    first_leaf: int
    origin: np.ndarray
    scale: np.ndarray


def build(points: np.ndarray, triangles: np.ndarray) -> Tree:
    """Build the tree over `triangles` (T, 3) int, T > 0, indices into `points` (P, 3) float32."""
    boxes = boxes_of(points, triangles)
    grid = Grid.around(boxes[0].min(axis=1), boxes[1].max(axis=1))
    rounded, centers = np.empty(boxes.shape, np.uint16), np.empty((3, len(triangles)), np.uint16)

    def round_outwards(part: slice) -> None:
        rounded[:, :, part] = grid.rounded(boxes[:, :, part])
        centers[:, part] = grid.centers(rounded[:, :, part])

    threads.for_blocks(len(triangles), round_outwards)
    order = kd_order.order(centers)
    lows, highs = np.take(rounded, order, axis=2)
    nodes, first_leaf = stack(lows, highs)
    return Tree(order, nodes, first_leaf, grid.origin, grid.scale)


@dataclass(frozen=True)
class Grid:
    """The grid of a tree, as Tree has it. extent (3,) float64: of all its boxes, and never 0."""

    origin: np.ndarray
    scale: np.ndarray
    extent: np.ndarray

    @classmethod
    def around(cls, low: np.ndarray, high: np.ndarray) -> "Grid":
        """The grid for boxes between `low` and `high`, (3,) each."""
        origin = low.astype(np.float64)
        extent = high - origin
        # A flat mesh has no extent along one axis, and a single point none at all: use a small one. Two free steps on either
        # side leave room to round outwards by more than single precision loses.
        extent = np.maximum(extent, max(extent.max() * FLAT, np.abs(origin).max() * ROUNDING, SMALLEST))
        scale = (GRID[1] - GRID[0] - 4) / extent
        return cls(origin - (GRID[0] + 2.0) / scale, scale, extent)

    def rounded(self, boxes: np.ndarray) -> np.ndarray:
        """Boxes (2, 3, N) float32, rounded outwards to steps (2, 3, N) uint16."""
        low, high = ((side - self.origin[:, None]) * self.scale[:, None] for side in boxes)
        steps = np.empty(boxes.shape, np.uint16)
        steps[0], steps[1] = np.floor(low) - 1.0, np.ceil(high) + 1.0
        return steps

    def centers(self, rounded: np.ndarray) -> np.ndarray:
        """The centers (3, N) of rounded boxes, doubled, in steps of one length for all axes: the order depends on distances in
        space."""
        return (rounded[0] + rounded[1]) * (self.extent / self.extent.max())[:, None]


def boxes_of(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The minimum and maximum coordinates (2, 3, T) float32 of each triangle."""
    # One axis after another, in contiguous arrays: reducing along a short last axis is ten times slower.
    axes, boxes = np.ascontiguousarray(points.T), np.empty((2, 3, len(triangles)), np.float32)

    def enclose(part: slice) -> None:
        corners = np.ascontiguousarray(triangles[part].T)
        for axis, values in enumerate(axes):
            a, b, c = (np.take(values, corner, mode="clip") for corner in corners)
            boxes[0, axis, part] = np.minimum(np.minimum(a, b), c)
            boxes[1, axis, part] = np.maximum(np.maximum(a, b), c)

    threads.for_blocks(len(triangles), enclose)
    return boxes


def stack(lows: np.ndarray, highs: np.ndarray) -> tuple[np.ndarray, int]:
    """Group the sorted boxes (3, T) by four until one node is left. Returns a Tree's nodes and first_leaf."""
    count, depth = lows.shape[1], 1
    while 4**depth < count:
        depth += 1
    heap = np.zeros((_level_start(depth - 1) + -(-count // 4), 3, 4), np.float32)
    for level in reversed(range(depth)):
        missing = (0, 0), (0, -lows.shape[1] % 4)
        if missing[1][1]:
            lows = np.pad(lows, missing, constant_values=GRID[1])
            highs = np.pad(highs, missing, constant_values=GRID[0])
        nodes = heap[_level_start(level) :][: lows.shape[1] // 4]
        for axis in range(3):
            nodes[:, axis] = pack(lows[axis], highs[axis]).reshape(-1, 4)
        lows, highs = _reduce(np.minimum, lows), _reduce(np.maximum, highs)
    return heap, _level_start(depth)


def pack(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Pack two grid coordinates of 15 bits each into the bits of a float32: the gpu module fills textures with floats only.

    The grid begins at 256, so no pair is a denormal, which a driver may flush to zero, and none is NaN or infinite.
    """
    return (low | high.astype(np.uint32) << 15).astype(np.uint32, copy=False).view(np.float32)


def _level_start(level: int) -> int:
    """The heap index of a level's first node: 0, 1, 5, 21, …"""
    return (4**level - 1) // 3


def _reduce(pick: np.ufunc, values: np.ndarray) -> np.ndarray:
    return pick(pick(values[:, 0::4], values[:, 1::4]), pick(values[:, 2::4], values[:, 3::4]))
