# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds UV islands that overlap themselves, by their borders."""

import numpy as np

from . import topology
from .topology import EdgeTable

CELLS = 2**20
"""Cells a side of an island, at most, in which the sides of its border are sorted."""
PAIRS_AT_ONCE = 2**20
"""Pairs of sides that are looked at together."""
MORE = 1e-3
"""Radians beyond a full turn that triangles around a UV vertex may have by rounding."""


def crossing(uv: np.ndarray, nodes: np.ndarray, islands: np.ndarray) -> np.ndarray:
    """Which triangles (T,) bool have a side where the border of their island crosses itself, or a corner around which they are
    more than a full turn.

    Without any, and without folds, an island does not overlap itself: a hole may lie inside out and its border not cross
    itself, but then it has corners with more than a full turn.

    Args:
        uv: (T, 3, 2) float.
        nodes: (T, 3) int, the UV vertices: triangles of an island that share two are neighbors.
        islands: (T,) int from 0, the island of each triangle.
    """
    result = _turn_too_far(uv.astype(np.float64), nodes)
    border = EdgeTable.of(nodes).alone
    if not len(border):
        return result
    stop = border - border % 3 + (border + 1) % 3
    points = uv.reshape(-1, 2).astype(np.float64)[np.stack([border, stop], axis=1)]
    ids = nodes.reshape(-1)[np.stack([border, stop], axis=1)]
    keys, sides = _cells(points, islands[border // 3])
    # Sides in one cell, each with the one that is so many places behind it.
    order = np.argsort(keys, kind="stable")
    keys, sides = keys[order], sides[order]
    ends = np.searchsorted(keys, keys, side="right")
    behind = ends - np.arange(len(keys)) - 1
    begins = np.concatenate(
        [[0], np.searchsorted(np.cumsum(behind), range(PAIRS_AT_ONCE, int(behind.sum()), PAIRS_AT_ONCE))]
    )
    for first, last in zip(begins, [*begins[1:], len(keys)], strict=True):
        one = np.repeat(np.arange(first, last), behind[first:last])
        other = topology.ranges(np.arange(first, last) + 1, behind[first:last])
        one, other = sides[one], sides[other]
        found = _cross(points[one], ids[one], points[other], ids[other])
        result[border[one[found]] // 3] = result[border[other[found]] // 3] = True
    return result


def _turn_too_far(uv: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Which triangles (T,) bool have a corner at a UV vertex whose angles are more than a full turn together."""
    (ux, uy), (vx, vy) = (np.moveaxis(np.roll(uv, -step, axis=1) - uv, 2, 0) for step in (1, 2))
    angles = np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy)
    turns = np.abs(np.bincount(nodes.reshape(-1), angles.reshape(-1)))
    return (turns > 2.0 * np.pi + MORE)[nodes].any(axis=1)


def _cells(points: np.ndarray, islands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keys (K,) int64 of the cells that sides (N, 2, 2) touch, and the side (K,) int. Cells are about as long as sides."""
    count = int(islands.max()) + 1
    lengths = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    mean = np.bincount(islands, lengths, count) / np.maximum(np.bincount(islands, minlength=count), 1)
    least = np.full((count, 2), np.inf)
    np.minimum.at(least, islands, points.min(axis=1))
    extent = np.zeros(count)
    np.maximum.at(extent, islands, (points.max(axis=1) - least[islands]).max(axis=1))
    size = np.maximum(np.maximum(mean, extent / CELLS), 1e-300)
    points = (points - least[islands][:, None]) / size[islands][:, None, None]
    low, high = np.floor(points.min(axis=1)).astype(np.int64), np.floor(points.max(axis=1)).astype(np.int64)
    rows = high[:, 1] - low[:, 1] + 1
    side = np.repeat(np.arange(len(points)), rows)
    row = topology.ranges(low[:, 1], rows)
    (x, y), (dx, dy) = points[side, 0].T, (points[side, 1] - points[side, 0]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = [np.where(dy == 0.0, share, np.clip((row + share - y) / dy, 0.0, 1.0)) for share in (0.0, 1.0)]
    ends = [np.floor(x + dx * end + nudge).astype(np.int64) for end in ends for nudge in (-1e-9, 1e-9)]
    first = np.clip(np.minimum.reduce(ends), low[side, 0], high[side, 0])
    columns = np.clip(np.maximum.reduce(ends), low[side, 0], high[side, 0]) - first + 1
    key = (islands[side] * (2 * CELLS) + row) * (2 * CELLS)
    return np.repeat(key, columns) + topology.ranges(first, columns), np.repeat(side, columns)


def _cross(points: np.ndarray, ids: np.ndarray, others: np.ndarray, other_ids: np.ndarray) -> np.ndarray:
    """Which sides (N, 2, 2) cross the other one (N, 2, 2). Not those that share an end, by ids (N, 2)."""
    apart = (ids[:, :, None] != other_ids[:, None, :]).all(axis=(1, 2))
    (a, b), (c, d) = np.moveaxis(points, 1, 0), np.moveaxis(others, 1, 0)
    return apart & (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    """On which side of the lines from `a` to `b` points are: positive on the left."""
    (ux, uy), (vx, vy) = (b - a).T, (point - a).T
    return ux * vy - uy * vx
