# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses what stays of a surface of which some triangles are hidden, so that its new borders are short and straight.

Single triangles are seen or hidden by chance where a part stands on a large side: what a border by them cuts off looks like the
teeth of a saw, and each tooth takes a triangle of the low mesh.
"""

from dataclasses import dataclass

import numpy as np

from .planes import planes
from .topology import EdgeTable
from .triangles import face_areas, unit_normals

MOST = 0.5
"""A plane stays whole if more of its area is seen: less of it stays without being seen than is seen."""
SMOOTH = np.cos(np.radians(30.0))
"""The cosine of the angle up to which a surface goes on at an edge: a side that ends at a sharp one is hidden by itself."""
SHORTER = 1.1
"""By which factor a border must become shorter: where it becomes hardly shorter, it would move on from triangle to triangle."""


def kept(points: np.ndarray, triangles: np.ndarray, is_seen: np.ndarray) -> np.ndarray:
    """Which triangles (T,) bool stay: those that are seen, notches between them, and planes of which most is seen.

    >>> bool(kept(points, triangles, is_seen)[is_seen].all())
    True

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices.
        is_seen: (T,) bool.
    """
    if is_seen.all() or not is_seen.any():
        return is_seen
    inner = _Inner.of(points, triangles)
    of, areas = planes(points, triangles).of, face_areas(points, triangles)
    stays = inner.filled(is_seen)
    is_whole = np.bincount(of, areas * stays) > MOST * np.bincount(of, areas)
    return inner.filled(stays | is_whole[of])


@dataclass(frozen=True, eq=False)
class _Inner:
    """The edges at which a surface goes on, from both sides: triangles (E,) int, those beside them, and lengths (E,)."""

    here: np.ndarray
    there: np.ndarray
    lengths: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, triangles: np.ndarray) -> "_Inner":
        normals, _ = unit_normals(points, triangles)
        table = EdgeTable.of(triangles)
        one, other = (side // 3 for side in table.pairs)
        goes_on = (normals[one] * normals[other]).sum(axis=1) > SMOOTH
        ends = points[table.ends[table.counts == 2][goes_on]].astype(np.float64)
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        one, other = one[goes_on], other[goes_on]
        return cls(np.concatenate([one, other]), np.concatenate([other, one]), np.tile(lengths, 2))

    def filled(self, stays: np.ndarray) -> np.ndarray:
        """`stays` (T,) bool with all that makes its border inside the surface shorter."""
        whole = np.bincount(self.here, self.lengths, len(stays))
        while True:
            to_these = np.bincount(self.here, self.lengths * stays[self.there], len(stays))
            is_notch = ~stays & (to_these > SHORTER * (whole - to_these))
            if not is_notch.any():
                return stays
            stays = stays | is_notch
