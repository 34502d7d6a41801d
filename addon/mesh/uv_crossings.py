# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds UV islands that overlap themselves, by their borders."""

import numpy as np

from . import topology
from .topology import EdgeTable, hashes
from .triangle_mesh import Mesh

PAIRS_AT_ONCE = 2**20
"""Pairs of borders' sides that are looked at together."""


def crossing(mesh: Mesh, islands: np.ndarray) -> np.ndarray:
    """Which triangles (T,) bool have a side where the border of their island crosses itself.

    Without any, and without folds, an island does not overlap itself if it is a disk.

    islands: (T,) int from 0, the island of each triangle.
    """
    result = np.zeros(len(islands), bool)
    corners = mesh.triangles.reshape(-1)
    uv = mesh.uv[corners]
    keys = np.stack([hashes(uv), mesh.vertices[corners].astype(np.uint64)], axis=1)
    nodes = topology.first_rows(keys).reshape(-1, 3)
    border = EdgeTable.of(nodes).alone
    border = border[np.argsort(islands[border // 3], kind="stable")]
    stop = border - border % 3 + (border + 1) % 3
    points = np.stack([uv[border], uv[stop]], axis=1).astype(np.float64)
    ids = nodes.reshape(-1)[np.stack([border, stop], axis=1)]
    cuts = np.flatnonzero(np.diff(islands[border // 3], prepend=-1, append=-1)).tolist()
    for a, b in zip(cuts[:-1], cuts[1:], strict=True):
        rows = max(1, PAIRS_AT_ONCE // (b - a))
        for k in range(a, b, rows):
            block = slice(k, min(k + rows, b))
            result[border[block][_cross(points[block], ids[block], points[a:b], ids[a:b])] // 3] = True
    return result


def _cross(points: np.ndarray, ids: np.ndarray, others: np.ndarray, other_ids: np.ndarray) -> np.ndarray:
    """Which of the sides (N, 2, 2) cross one of the others (M, 2, 2). Not those that share an end, by ids (N, 2)."""
    near = np.ones((len(points), len(others)), bool)
    for axis in range(2):
        near &= points[:, None, :, axis].min(axis=2) <= others[None, :, :, axis].max(axis=2)
        near &= points[:, None, :, axis].max(axis=2) >= others[None, :, :, axis].min(axis=2)
    one, other = np.nonzero(near)
    apart = (ids[one][:, :, None] != other_ids[other][:, None, :]).all(axis=(1, 2))
    (a, b), (c, d) = np.moveaxis(points[one[apart]], 1, 0), np.moveaxis(others[other[apart]], 1, 0)
    meet = (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)
    return np.unique(one[apart][meet])


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    """On which side of the lines from `a` to `b` points are: positive on the left."""
    (ux, uy), (vx, vy) = (b - a).T, (point - a).T
    return ux * vy - uy * vx
