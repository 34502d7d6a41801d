# SPDX-License-Identifier: GPL-3.0-or-later
"""A bounding volume hierarchy over triangles, in a layout that a shader walks without a stack.

Triangles are sorted so that neighbors in the order are close in space. Four in a row make a node, four nodes
make the node above, up to one root. The tree is complete, so an index is enough to find the children: those of node n are
4 n + 1 to 4 n + 4 (a heap with four children).

Source: runs are cut in halves along their longest axis, as by Friedman, Bentley and Finkel, "An algorithm for finding best
matches in logarithmic expected time", 1977.
Tried: the order of a Morton curve instead: rays visit four times as many nodes, and a terrain takes three times as long.
"""

from dataclasses import dataclass

import numpy as np

from ..core import threads

GRID = 256, 32767
"""The first and the last step, along each axis, of the grid to which boxes are rounded outwards."""

LEAST_EXTENT = 1e-5
"""The least extent of the grid along an axis, as a share of the largest one."""
ROUNDING_EXTENT = 1e-7
"""The least extent of the grid, as a share of the coordinates: about what single precision rounds."""
SMALLEST = 1e-20
"""The least extent of the grid, so that its scale fits single precision."""
TRIANGLES_AT_ONCE = 2**14
"""Triangles that a thread takes at once, so that its arrays fit in a processor's cache."""


@dataclass(frozen=True)
class Tree:
    """A tree over triangles. A point p is at (p - origin) * scale in grid steps.

    Attributes:
        order: (T,) int, triangle indices in the tree's order.
        nodes: (N, 3, 4) float32, for x, y and z, the boxes of the four children, as `pack` stores them; a missing child has low
            above high.
        first_leaf: the heap index of the first triangle.
        origin: (3,) float64.
        scale: (3,) float64.
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

    threads.for_blocks(len(triangles), round_outwards, TRIANGLES_AT_ONCE)
    order = kd_order(centers)
    nodes, first_leaf = stack(rounded, order)
    return Tree(order, nodes, first_leaf, grid.origin, grid.scale)


@dataclass(frozen=True)
class Grid:
    """The grid of a tree.

    Attributes:
        origin: as Tree has it.
        scale: as Tree has it.
        extent: (3,) float64, of all its boxes, and never 0.
    """

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
        extent = np.maximum(extent, max(extent.max() * LEAST_EXTENT, np.abs(origin).max() * ROUNDING_EXTENT, SMALLEST))
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
        corners = triangles[part].T.astype(np.intp, order="C")  # once for all axes
        for axis, values in enumerate(axes):
            a, b, c = (np.take(values, corner, mode="clip") for corner in corners)
            np.minimum(np.minimum(a, b), c, out=boxes[0, axis, part])
            np.maximum(np.maximum(a, b), c, out=boxes[1, axis, part])

    threads.for_blocks(len(triangles), enclose, TRIANGLES_AT_ONCE)
    return boxes


def stack(boxes: np.ndarray, order: np.ndarray) -> tuple[np.ndarray, int]:
    """Group boxes (2, 3, T) uint16 in this `order` by four until one node is left. Returns a Tree's nodes and first_leaf."""
    depth, places = 1, order
    while 4**depth < len(order):
        depth += 1
    heap = np.zeros((_level_start(depth - 1) + -(-len(order) // 4), 3, 4), np.float32)
    for level in reversed(range(depth)):
        nodes = heap[_level_start(level) :][: -(-len(places) // 4)]
        boxes = _grouped(boxes, places, nodes)
        places = np.arange(len(nodes))
    return heap, _level_start(depth)


def _grouped(boxes: np.ndarray, order: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Store boxes (2, 3, N) in this `order` in `nodes` (M, 3, 4), four in each. Returns the boxes (2, 3, M) around those."""
    around = np.empty((2, 3, len(nodes)), np.uint16)

    def group(part: slice) -> None:
        children = np.take(boxes, order[4 * part.start : 4 * part.stop], axis=2, mode="clip")
        if children.shape[2] % 4:
            missing = np.array(GRID[::-1], np.uint16).repeat(3).reshape(2, 3, 1).repeat(-children.shape[2] % 4, axis=2)
            children = np.concatenate([children, missing], axis=2)
        for axis in range(3):
            nodes[part, axis] = pack(*children[:, axis]).reshape(-1, 4)
        around[0, :, part], around[1, :, part] = _reduce(np.minimum, children[0]), _reduce(np.maximum, children[1])

    threads.for_blocks(len(nodes), group, TRIANGLES_AT_ONCE // 4)
    return around


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


LEAF = 4
"""The length of runs that are not divided further."""
MEASURED = 256
"""About how many points of a run are measured to find its longest axis."""
PART = LEAF**8
"""The length of runs that one thread divides completely, level by level, with 32-bit keys in the processor's cache."""


def kd_order(points: np.ndarray) -> np.ndarray:
    """Returns the order (N,) int64 of `points` (3, N) uint16, N < 2^32.

    In it, every run of 4^k points that starts at a multiple of 4^k is separated from its neighbors in the next larger run
    by planes across the longest axis. The order within a run of LEAF is arbitrary.
    """
    runs, size = [(np.arange(points.shape[1]), points)], LEAF
    while size < points.shape[1]:
        size *= 4
    while size > PART:
        size //= 2
        pairs = threads.map_parallel(lambda run, half=size: _halves(*run, half), runs)
        runs = [half for pair in pairs for half in pair]
    return np.concatenate(threads.map_parallel(lambda run: run[0][_Part(run[1]).order(size)], runs))


def _halves(indices: np.ndarray, points: np.ndarray, half: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Split `points` and their indices along the longest axis: the `half` lowest, then the rest, if any."""
    if len(indices) <= half:
        return [(indices, points)]
    longest = points[np.argmax([np.ptp(axis) for axis in points])]
    # Both halves stay in the order in which they were: what lies close in memory is fast to fetch.
    middle = np.partition(longest, half)[half]
    is_low = longest < middle
    missing = half - np.count_nonzero(is_low)
    is_low[np.flatnonzero(longest == middle)[:missing]] = True
    runs = np.flatnonzero(is_low), np.flatnonzero(~is_low)
    return [(np.take(indices, run), np.take(points, run, axis=1)) for run in runs]


class _Part:
    """Sorts at most PART `points`."""

    def __init__(self, points: np.ndarray):
        self.points, self.count = points, points.shape[1]
        self.keys = (points.astype(np.uint32) << np.uint32(16) | np.arange(self.count, dtype=np.uint32)).reshape(-1)

    def order(self, size: int) -> np.ndarray:
        """Returns the order (N,) int64 of the points, as the function `order` does, for a run of at most `size`."""
        indices = np.arange(self.count)
        while size > LEAF:
            self._cut(indices, size)
            size //= 4
        return indices

    def _cut(self, indices: np.ndarray, size: int) -> None:
        """Sort each run of `size` in `indices` into quarters, in place. The last run may be shorter."""
        whole = len(indices) // size * size
        runs, rest = indices[:whole].reshape(-1, size), indices[whole:]
        if len(runs):
            spans = self._spans(runs)
            longest = np.argmax(spans, axis=1)
            self._halve(runs, longest, size // 2)
            # Assume that each half spans half of the axis: measuring again would cost more.
            spans[np.arange(len(spans)), longest] //= 2
            longest = np.repeat(np.argmax(spans, axis=1), 2)
            self._halve(runs.reshape(-1, size // 2), longest, size // 4)
        for run, half in ((rest, size // 2), (rest[: size // 2], size // 4), (rest[size // 2 :], size // 4)):
            if len(run) > half:
                self._halve(run[None], np.argmax(self._spans(run[None]), axis=1), half)

    def _halve(self, runs: np.ndarray, axes: np.ndarray, half: int) -> None:
        """Move the lowest `half` points of each of `runs` (R, n) to its front, by the axis (R,) given for each run."""
        chosen = np.take(self.keys, runs + axes[:, None] * self.count, mode="clip")
        chosen.partition(half, axis=1)
        runs[...] = chosen & np.uint32(0xFFFF)

    def _spans(self, runs: np.ndarray) -> np.ndarray:
        """The extent (R, 3) of each of `runs` (R, n) along the axes, of long runs that of some of their points."""
        if runs.shape[1] > MEASURED:
            runs = runs[:, :: runs.shape[1] // MEASURED | 1]
        spans = []
        for values in self.points:
            low = high = np.take(values, runs, mode="clip")
            # Reducing along a short axis is slow: fold whole arrays first.
            while high.shape[1] % 2 == 0 and high.shape[1] <= 32:
                low, high = np.minimum(low[:, 0::2], low[:, 1::2]), np.maximum(high[:, 0::2], high[:, 1::2])
            spans.append(high.max(axis=1) - low.min(axis=1))
        return np.stack(spans, axis=1)
