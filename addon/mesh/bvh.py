# SPDX-License-Identifier: GPL-3.0-or-later
"""A tree of boxes over triangles, built from whole arrays and laid out for a shader that walks it without a stack.

Triangles are sorted so that runs of them lie close together (kd.py); four in a row make a node, four nodes make the next,
up to one root. The tree is complete, so that a node's place says all: the children of n are 4 n + 1 to 4 n + 4 (a heap
with four children).
"""

from dataclasses import dataclass

import numpy as np

from . import kd

GRID = 256, 32767
"""Boxes are rounded outwards to a grid whose steps along each axis have these numbers, from first to last."""
_EMPTY_LOW, _EMPTY_HIGH = np.uint16(GRID[1]), np.uint16(GRID[0])


@dataclass(frozen=True)
class Tree:
    """order (T,) int: the triangles as they lie in the tree. first_leaf: the place of the first triangle in the heap.

    nodes (N, 3, 4) float32: for x, y and z the boxes of the four children, as `pack` has them; a child that is not there
    has low above high. A point p is at (p - origin) * scale in grid steps; origin, scale (3,) float64.
    """

    order: np.ndarray
    nodes: np.ndarray
    first_leaf: int
    origin: np.ndarray
    scale: np.ndarray


def build(points: np.ndarray, triangles: np.ndarray) -> Tree:
    """The tree over `triangles` (T, 3) int, T > 0, indices into `points` (P, 3) float32."""
    # One axis after another, in contiguous arrays: reducing along a short last axis is ten times slower.
    boxes, corners = [], np.ascontiguousarray(triangles.T)
    for values in np.ascontiguousarray(points.T):
        a, b, c = (np.take(values, corner, mode="clip") for corner in corners)
        boxes.append((np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)))
    origin = np.array([low.min() for low, _ in boxes], np.float64)
    extent = np.array([high.max() for _, high in boxes], np.float64) - origin
    # A flat mesh has no extent along an axis; what is smaller than this is flat. Two steps on either side are left free
    # for rounding outwards by more than what single precision loses on the way.
    extent = np.maximum(extent, max(float(extent.max()) * 1e-5, np.finfo(np.float32).tiny))
    scale = (GRID[1] - GRID[0] - 4) / extent
    origin -= (GRID[0] + 2.0) / scale
    lows = [
        (np.floor((low - origin[axis]) * scale[axis]) - 1.0).astype(np.uint16) for axis, (low, _) in enumerate(boxes)
    ]
    highs = [
        (np.ceil((high - origin[axis]) * scale[axis]) + 1.0).astype(np.uint16) for axis, (_, high) in enumerate(boxes)
    ]
    # The centres of the boxes on one scale for all axes: what counts is how near they are in space.
    shares = (extent / extent.max()).astype(np.float32)
    centres = [(low.astype(np.uint32) + high) * share for low, high, share in zip(lows, highs, shares, strict=True)]
    order = kd.order(np.array(centres, np.uint16))
    return _stack(order, [np.take(low, order) for low in lows], [np.take(high, order) for high in highs], origin, scale)


def _stack(order: np.ndarray, lows: list, highs: list, origin: np.ndarray, scale: np.ndarray) -> Tree:
    """Group the sorted boxes by four until one node is left."""
    levels = []
    while not levels or len(levels[-1]) > 1:
        missing = -len(lows[0]) % 4
        if missing:
            lows = [np.pad(low, (0, missing), constant_values=_EMPTY_LOW) for low in lows]
            highs = [np.pad(high, (0, missing), constant_values=_EMPTY_HIGH) for high in highs]
        nodes = np.empty((len(lows[0]) // 4, 3, 4), np.float32)
        for axis in range(3):
            nodes[:, axis] = pack(lows[axis], highs[axis]).reshape(-1, 4)
        levels.append(nodes)
        lows = [_reduce(np.minimum, low) for low in lows]
        highs = [_reduce(np.maximum, high) for high in highs]
    depth = len(levels)
    heap = np.zeros((_level_start(depth - 1) + len(levels[0]), 3, 4), np.float32)
    for level, nodes in enumerate(reversed(levels)):
        start = _level_start(level)
        heap[start : start + len(nodes)] = nodes
    return Tree(order, heap, _level_start(depth), origin, scale)


def pack(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Two numbers on the grid, of 15 bits each, in the bits of a float32: textures can be filled with floats alone.

    Since the grid begins at 256 no pair is a denormal, which a driver might not keep, and none is a NaN or an infinity.
    """
    return (low | high.astype(np.uint32) << 15).astype(np.uint32, copy=False).view(np.float32)


def _level_start(level: int) -> int:
    """The place of a level's first node: 0, 1, 5, 21, …"""
    return (4**level - 1) // 3


def _reduce(pick: np.ufunc, values: np.ndarray) -> np.ndarray:
    return pick(pick(values[0::4], values[1::4]), pick(values[2::4], values[3::4]))
