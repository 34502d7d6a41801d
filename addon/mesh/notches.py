# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills notches of machine parts, as gaps between fins and slots in edges: in each plane around one, the outline goes straight
on once it is filled.

Found by no paper. Tried: edges that collapse alone, which lean fins against each other.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import polygons, topology
from .planes import ANGLES, OFF
from .topology import EdgeTable
from .triangles import diagonal, face_areas, unit


@dataclass(frozen=True, eq=False)
class _Caps:
    """Polygons in place of parts. Their sides run counter-clockwise.

    Attributes:
        parts: (S,) int, the part of each side.
        caps: (S,) int, the polygon of each side.
        first, last: (S,) int, the vertices at which each side starts and ends.
        ups: (C, 3), the normals of polygons.
        beside: (C,) int, a triangle whose plane each polygon continues.
    """

    parts: np.ndarray
    caps: np.ndarray
    first: np.ndarray
    last: np.ndarray
    ups: np.ndarray
    beside: np.ndarray


@dataclass(frozen=True, eq=False)
class Notches:
    """Parts of a surface that edges turned inwards connect, and how those that are notches are filled.

    Attributes:
        points: (V, 3) float64.
        triangles: (T, 3) int.
        labels: (T,) int, the part of each triangle.
        around: (R, 2) int, the parts on both sides of the edges between them.
        is_closable: (K,) bool, which parts are notches: the caps of one loop fill them, in planes beside it.
        caps: of notches.
    """

    points: np.ndarray
    triangles: np.ndarray
    labels: np.ndarray
    around: np.ndarray
    is_closable: np.ndarray
    caps: _Caps

    @classmethod
    def of(cls, points: np.ndarray, triangles: np.ndarray, planes: np.ndarray, normals: np.ndarray) -> "Notches":
        """planes: (T,) int, those of the triangles. normals: (P, 3), of the planes."""
        table = EdgeTable.of(triangles, len(points))
        one, other = table.pairs
        labels = _labels(points, triangles, planes, normals, table)
        is_closable = np.ones(int(labels.max(initial=-1)) + 1, bool)
        is_closable[labels[table.sides[np.repeat(table.counts != 2, table.counts)] // 3]] = False
        for side in (one, other):
            is_closable[labels[side[table.is_against] // 3]] = False
        # The sides of other triangles around each part, as caps run
        is_rim = labels[one // 3] != labels[other // 3]
        sides = np.concatenate([one[is_rim], other[is_rim]])
        parts = labels[np.concatenate([other[is_rim], one[is_rim]]) // 3]
        around = np.stack([parts, labels[sides // 3]], axis=1)
        first, last = table.last[sides], table.first[sides]
        is_closable &= _have_one_loop(parts, first, last, len(is_closable))
        chosen = is_closable[parts]
        rim = parts[chosen], sides[chosen] // 3, first[chosen], last[chosen]
        is_filled, caps = _filled(points, rim, planes, normals, len(is_closable))
        return cls(points, triangles, labels, around, is_closable & is_filled, caps)

    @cached_property
    def vertex_counts(self) -> np.ndarray:
        """How many vertices (K,) each part has."""
        return vertex_counts(self.triangles, self.labels, len(self.is_closable))

    def costs(self) -> np.ndarray:
        """As `closing_costs` has them."""
        return closing_costs(self.points, self.triangles, self.labels, self.vertex_counts)

    def gains(self) -> np.ndarray:
        """How many triangles (K,) fewer there are at once if a part is filled."""
        caps, count = self.caps, len(self.is_closable)
        part_of = np.zeros(len(caps.beside), np.int64)
        part_of[caps.caps] = caps.parts
        new = np.bincount(part_of, np.bincount(caps.caps, minlength=len(part_of)) - 2, count)
        return np.bincount(self.labels, minlength=count) - new

    def caps_of(self, is_closed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangles (C, 3) in place of some notches (K,) bool, and the triangle (C,) int whose plane each one continues."""
        chosen, caps = is_closed[self.caps.parts], self.caps
        of_sides = caps.first[chosen], caps.last[chosen], caps.caps[chosen]
        triangles, of = polygons.triangulated(self.points, *of_sides, caps.ups)
        return triangles, caps.beside[of]

    def apart(self, is_closed: np.ndarray) -> np.ndarray:
        """`is_closed` (K,) bool without those that lie beside others."""
        result = is_closed.copy()
        result[self.around[is_closed[self.around].all(axis=1)].max(axis=1)] = False
        return result


def _labels(
    points: np.ndarray, triangles: np.ndarray, planes: np.ndarray, normals: np.ndarray, table: EdgeTable
) -> np.ndarray:
    """The part (T,) int of each triangle, from 0. The arguments are as in Notches.of."""
    one, other = table.pairs
    faces, beyond = one // 3, other // 3
    opposite = triangles.reshape(-1)[3 * beyond + (other + 2) % 3]
    rises = ((points[opposite] - points[table.first[one]]) * normals[planes[faces]]).sum(axis=1)
    joins = (planes[faces] == planes[beyond]) | (rises > OFF * diagonal(points))
    return topology.numbered(topology.connected(len(triangles), faces[joins], beyond[joins]))[1]


def _have_one_loop(parts: np.ndarray, first: np.ndarray, last: np.ndarray, count: int) -> np.ndarray:
    """Which parts (count,) bool have sides (S,) that are a single loop, with each vertex once."""
    width = int(max(first.max(initial=0), last.max(initial=0))) + 1
    nodes, ends = np.unique(np.stack([parts * width + first, parts * width + last]), return_inverse=True)
    ends = ends.reshape(2, -1)
    roots = topology.connected(len(nodes), *ends)
    result = np.bincount(nodes[np.unique(roots)] // width, minlength=count) == 1
    for end in ends:
        result[parts[np.bincount(end, minlength=len(nodes))[end] != 1]] = False
    return result


def _filled(
    points: np.ndarray, rim: tuple[np.ndarray, ...], planes: np.ndarray, normals: np.ndarray, count: int
) -> tuple[np.ndarray, _Caps]:
    """Which of `count` parts (K,) bool caps fill, and these caps.

    A chain is what lies in one plane of the loop around a part. A straight line across it closes its cap. What these lines
    leave open has a cap, too, and must lie in the plane of a chain.

    rim: the part, the triangle beside, and both vertices of each side (S,), of single loops. planes, normals: as in Notches.of.
    """
    parts, beside, first, last = rim
    keys, chains = np.unique(parts * len(normals) + planes[beside], return_inverse=True)
    part_of, plane_of = np.divmod(keys, len(normals))
    lengths, triangle_of = np.bincount(chains, minlength=len(keys)), np.zeros(len(keys), np.int64)
    triangle_of[chains] = beside
    starts, stops = (chains * len(points) + vertices for vertices in (first, last))
    begins, ends = np.setdiff1d(starts, stops), np.setdiff1d(stops, starts)
    result = np.bincount(part_of, minlength=count) > 1
    result[part_of[np.bincount(begins // len(points), minlength=len(keys)) != 1]] = False
    begins, ends = (each[result[part_of[each // len(points)]]] for each in (begins, ends))
    chain, begin, end = begins // len(points), begins % len(points), ends % len(points)
    # What is left open
    part, sizes = part_of[chain], np.bincount(part_of[chain], minlength=count)
    up = unit(topology.sums_of(part, np.cross(points[begin], points[end]), count))
    middles = topology.sums_of(part, points[begin], count) / np.maximum(sizes, 1)[:, None]
    is_off = np.abs(((points[begin] - middles[part]) * up[part]).sum(axis=1)) > OFF * diagonal(points)
    alike, best = (up[part] * normals[plane_of[chain]]).sum(axis=1), np.full(count, -1.0)
    np.maximum.at(best, part, alike)
    is_open = sizes > 2  # two lines lie on each other
    result[part[(is_off | (best[part] < np.cos(ANGLES[0]))) & is_open[part]]] = False
    beside_open, is_best = np.zeros(count, np.int64), alike == best[part]
    beside_open[part[is_best]] = triangle_of[chain[is_best]]
    has_cap, across, left = result[parts] & (lengths[chains] > 1), lengths[chain] > 1, is_open[part]
    kinds = [(parts[has_cap], chains[has_cap], first[has_cap], last[has_cap])]
    kinds += [(part[across], chain[across], end[across], begin[across])]
    kinds += [(part[left], len(keys) + part[left], begin[left], end[left])]
    sides = [np.concatenate(each) for each in zip(*kinds, strict=True)]
    parts, caps, first, last = (each[result[sides[0]]] for each in sides)
    used, caps = np.unique(caps, return_inverse=True)
    ups = np.concatenate([normals[plane_of], up])[used]
    turns = np.bincount(caps, (np.cross(points[first], points[last]) * ups[caps]).sum(axis=1), len(used))
    result[parts[turns[caps] <= 0.0]] = False
    return result, _Caps(parts, caps, first, last, ups, np.concatenate([triangle_of, beside_open])[used])


def vertex_counts(triangles: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    """How many vertices (count,) parts have. labels: (T,) int, the part of each triangle."""
    width = int(triangles.max(initial=0)) + 1
    return np.bincount(np.unique(labels[:, None] * width + triangles) // width, minlength=count)


def closing_costs(
    points: np.ndarray, triangles: np.ndarray, labels: np.ndarray, counts: np.ndarray, axes: np.ndarray | None = None
) -> np.ndarray:
    """What it costs (K,) to close parts, for each vertex that goes: their area, by the square of their least radius.

    labels: (T,) int, the part of each triangle. counts: (K,) int, their vertices. axes: (K, 3), along which they count as no
    smaller than across; 0 for none.
    """
    corners, count = points[triangles], len(counts)
    areas = face_areas(corners)
    total = np.maximum(np.bincount(labels, areas, count), 1e-300)
    middles = topology.sums_of(labels, corners.mean(axis=1) * areas[:, None], count) / total[:, None]
    away = corners - middles[labels][:, None]
    spread = topology.sums_of(labels, np.einsum("tki,tkj,t->tij", away, away, areas / 3.0).reshape(-1, 9), count)
    spread = (spread / total[:, None]).reshape(-1, 3, 3)
    if axes is not None:
        spread += np.trace(spread, axis1=1, axis2=2)[:, None, None] * axes[:, :, None] * axes[:, None]
    least = np.linalg.eigvalsh(spread)[:, 0]
    return 2.0 * total * np.maximum(least, 0.0) / np.maximum(counts, 1)
