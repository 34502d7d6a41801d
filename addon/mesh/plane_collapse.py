# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes machine parts coarser: planes stay planes, their straight edges straight, and what is too small is closed.

Vertices collapse to neighbors, by the squares of distances from the planes that they lie on, each by the area of the whole
plane. So one in a plane moves within it, one at an edge along it, and what is small goes first. Holes, pockets and bosses whose
rims lie in planes are closed once that costs less than to keep them coarser.

Found by no paper. Tried: quadrics by the area of triangles alone bend large planes that are cut into thin triangles; limited
dissolving keeps every screw hole.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import collapse, flips, hard_edges, polygons, quadrics, topology
from .collapse import State
from .notches import Notches, closing_costs, vertex_counts
from .planes import ANGLES, LARGE, SOFT, Planes
from .topology import EdgeTable
from .triangles import checked, face_normals, quality, unit

FIRST_COST, MOST_COST, FACTOR = 1e-10, 1e6, 2.0
"""The least and the most costs to which a mesh is collapsed, and the factor from each to the next, for a box whose longest side
is 1: areas by squares of distances."""
LEAST_COSINE, LEAST_QUALITY = 0.2, 1e-3
"""The least cosine between a triangle's normals before and after, and its least quality, as in collapse.py: thin ones do no
harm in a plane."""
LEAST_LEFT = 0.99
"""The share of the wanted triangles that is left at least when something is closed."""
STIFF = 1e4
"""How many times as much large planes count that are no rounds: one that is tilted by a thousandth costs little, and is
seen."""
FINER = 4.0, 64.0
"""By which factors the planes of what is closed are smaller than the square of its size: the second is for what is shallow, and
for smooth groups as a whole, as the strips of a cylinder."""


@dataclass(frozen=True)
class Costs:
    """What goes first.

    Attributes:
        closing: A factor on what it costs to close holes and the like.
        fade: The power of their size by which planes that are not large are less stiff. With 2, walls of teeth and fingers stay
            while windows go; without an end, the other way round.
    """

    closing: float = 1.0
    fade: float = 2.0


USUAL = Costs()


@dataclass(frozen=True, eq=False)
class OnPlanes:
    """A coarse mesh of a machine part.

    Attributes:
        points: (P, 3) float64.
        triangles: (N, 3) int64.
        of: (N,) int, the triangle of the surface that each one comes from, or whose plane it continues.
    """

    points: np.ndarray
    triangles: np.ndarray
    of: np.ndarray


def collapse_on_planes(
    points: np.ndarray, triangles: np.ndarray, planes: Planes, wanted: int, costs: Costs = USUAL
) -> OnPlanes:
    """A mesh of about `wanted` triangles, or of more where no edge can collapse.

    >>> coarse = collapse_on_planes(points, triangles, planes(points, triangles), 12)
    >>> len(coarse.triangles) <= 12
    True

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices, and areas above 0.
        planes: of the triangles.
        wanted: how many are left.
        costs: what goes first.
    """
    points, triangles = checked(points, triangles)
    center, size = collapse.box(points)
    state = _State((points.astype(np.float64) - center) / size, triangles.astype(np.int64), planes, size, costs)
    cost = FIRST_COST
    state.run(wanted, cost)
    while len(state.triangles) > wanted and cost < MOST_COST:
        cost *= FACTOR
        for areas, factor, is_round in state.features:
            state.close(wanted, cost / costs.closing, areas < factor * np.sqrt(cost / costs.closing), is_round=is_round)
        state.fill(wanted, cost / costs.closing)
        state.flip()
        state.run(wanted, cost)
    if len(state.triangles) < len(triangles):
        state.flip()
    used, numbers = topology.numbered(state.triangles)
    return OnPlanes(state.points[used] * size + center, numbers, state.sources)


def without_needless(points: np.ndarray, triangles: np.ndarray, planes: Planes) -> OnPlanes:
    """The same surface with as few triangles as it takes, as `collapse_on_planes` has it: others go on from there."""
    points, triangles = checked(points, triangles)
    center, size = collapse.box(points)
    state = _State((points.astype(np.float64) - center) / size, triangles.astype(np.int64), planes, size, USUAL)
    state.run(0, FIRST_COST)
    used, numbers = topology.numbered(state.triangles)
    return OnPlanes(state.points[used] * size + center, numbers, state.sources)


class _State(State):
    """A mesh on its way.

    Attributes:
        sources: (T,) int, as `of` of OnPlanes.
        features: Areas (P,) by which planes may be small, a factor of FINER, and whether it is for what lies in round sides
            alone: whole walls of slots in flat ones would go too soon.
    """

    at_once = 1.0  # costs come in steps

    def __init__(self, points: np.ndarray, triangles: np.ndarray, planes: Planes, size: float, costs: Costs):
        self._plane_of, self._normals, self._areas = planes.of, planes.normals, planes.areas / size**2
        shares = self._areas / self._areas.sum()
        stiffness = STIFF * np.minimum(shares / LARGE, 1.0) ** costs.fade
        self._weights = self._areas * np.where(planes.is_round, 1.0, 1.0 + stiffness)
        self.sources = np.arange(len(triangles))
        self._group_of = hard_edges.smooth_groups(triangles, planes.normals[planes.of])
        of_groups = np.bincount(self._group_of, self._areas[planes.of] / np.bincount(planes.of)[planes.of])
        of_group = np.zeros(len(self._areas))
        of_group[planes.of] = of_groups[self._group_of]
        self.features = [(self._areas, FINER[0], False), (self._areas, FINER[1], False), (of_group, FINER[1], True)]
        super().__init__(points, triangles, self._quadrics(points, triangles, planes.of))

    def flip(self) -> None:
        """Turn edges within planes: collapses leave thin triangles, which refuse others."""
        self.triangles = flips.delaunay(self.points, self.triangles, self._plane_of[self.sources])
        self._changed[:] = self._round + 1

    def close(self, wanted: int, most: float, is_small: np.ndarray, *, is_round: bool) -> None:
        """Close what costs up to `most` for each vertex, as long as more than `wanted` triangles are left, cheapest first.

        is_small: (P,) bool, the planes that may go. is_round: whether what lies in flat sides alone stays.
        """
        of = self._plane_of[self.sources]
        is_small = is_small[of]
        if not is_small.any() or is_small.all():
            return
        found = _Openings.of(self.points, self.triangles, is_small, self._group_of[self.sources], self._normals[of])
        is_open = found.is_closable & (found.is_round | (not is_round))
        self._close(found, is_open, wanted, most)

    def fill(self, wanted: int, most: float) -> None:
        """Fill notches, as `close` closes what lies within planes."""
        of = self._plane_of[self.sources]
        found = Notches.of(self.points, self.triangles, of, self._normals)
        self._close(found, found.is_closable, wanted, most)

    def _close(self, found: "_Openings | Notches", is_open: np.ndarray, wanted: int, most: float) -> None:
        """is_open: (K,) bool, the parts that may be closed."""
        costs, gains = found.costs(), found.gains()
        order = np.flatnonzero(is_open & (costs <= most))
        order = order[np.argsort(costs[order], kind="stable")]
        left = len(self.triangles) - np.cumsum(2 * found.vertex_counts[order])
        order = order[: 1 + np.searchsorted(-left, -wanted)]
        order = order[len(self.triangles) - np.cumsum(gains[order]) >= LEAST_LEFT * wanted]
        if not len(order):
            return
        is_closed = np.zeros(len(found.is_closable), bool)
        is_closed[order] = True
        is_closed = found.apart(is_closed)
        caps, beside = found.caps_of(is_closed)
        stays = ~((found.labels >= 0) & is_closed[found.labels])
        around = np.unique(caps)
        self.triangles = np.concatenate([self.triangles[stays], caps])
        self.sources = np.concatenate([self.sources[stays], self.sources[beside]])
        # The planes of what is closed hold its rim no more.
        touches = np.isin(self.triangles, around).any(axis=1)
        anew = self._quadrics(self.points, self.triangles[touches], self._plane_of[self.sources[touches]], border=False)
        for values, new in zip((self._planes, self._offsets, self._constants), anew, strict=True):
            values[around] = new[around]
        self._known = np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0)
        self._changed[around] = self._round + 1

    def _quadrics(
        self, points: np.ndarray, triangles: np.ndarray, of: np.ndarray, *, border: bool = True
    ) -> quadrics.Quadrics:
        """Those of the planes (T,) int of triangles: each counts once at a vertex, by its whole area."""
        count = len(self._areas)
        pairs = np.unique(triangles * count + of[:, None])
        vertices, which = np.divmod(pairs, count)
        parts = [(vertices[:, None], self._normals[which], points[vertices], self._weights[which])]
        if border:
            parts.append(quadrics.border_planes(points, triangles, self._normals[of], np.ones(len(triangles))))
        return quadrics.summed(parts, len(points))

    def _new_placements(self, edges: EdgeTable, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ends = edges.ends[which]
        a, b = ends.T
        planes, offsets = self._planes[a] + self._planes[b], self._offsets[a] + self._offsets[b]
        constants = self._constants[a] + self._constants[b]
        places = self.points[ends]
        costs = np.einsum("eki,eij,ekj->ek", places, planes, places) + constants[:, None]
        costs += 2.0 * np.einsum("ei,eki->ek", offsets, places)
        better = costs.argmin(axis=1)
        lengths = ((places[:, 0] - places[:, 1]) ** 2).sum(axis=1)
        each = np.arange(len(ends))
        return places[each, better], np.maximum(costs[each, better], 0.0) + 1e-14 * lengths

    def _is_spoiled(self, which: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        of = self._plane_of[self.sources[which]]
        old, new = face_normals(before), face_normals(after)
        old_areas, new_areas = np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1)
        old_quality = quality(before, old_areas)
        is_thin = old_quality < LEAST_QUALITY  # so that its normal is not known
        towards = np.where(is_thin[:, None], self._normals[of], unit(old))
        is_turned = (towards * new).sum(axis=1) < LEAST_COSINE * new_areas
        # Turn by turn, none may come to show its back.
        is_turned |= (self._normals[of] * new).sum(axis=1) < np.minimum(0.0, (self._normals[of] * old).sum(axis=1))
        return is_turned | (quality(after, new_areas) < np.minimum(LEAST_QUALITY, 0.5 * old_quality))

    def _keep(self, triangles: np.ndarray, which: np.ndarray) -> None:
        super()._keep(triangles, which)
        self.sources = self.sources[which]


@dataclass(frozen=True, eq=False)
class _Openings:
    """Connected parts of small triangles, and the loops around them.

    Attributes:
        labels: (T,) int, the part of each triangle; without meaning for those that are not small.
        sides: (S,) int, the sides of other triangles along the parts, as EdgeTable has them.
        loops: (S,) int, the loop of each side, from 0.
        of_loop: (L,) int, the part of each loop.
        normals: (T, 3), of the planes of the triangles.
        ups: (L, 3), the mean normals of what is around each loop.
        is_round: (K,) bool, which parts have a loop that goes through several planes.
        is_closable: (K,) bool, which parts can be closed: each loop goes around a hole in one smooth group that turns little
            there.
    """

    points: np.ndarray
    triangles: np.ndarray
    is_small: np.ndarray
    labels: np.ndarray
    table: EdgeTable
    sides: np.ndarray
    loops: np.ndarray
    of_loop: np.ndarray
    normals: np.ndarray
    ups: np.ndarray
    is_round: np.ndarray
    is_closable: np.ndarray

    @classmethod
    def of(
        cls, points: np.ndarray, triangles: np.ndarray, is_small: np.ndarray, groups: np.ndarray, normals: np.ndarray
    ) -> "_Openings":
        """is_small: (T,) bool. groups: (T,) int, their smooth groups. normals: (T, 3), of their planes."""
        table = EdgeTable.of(triangles, len(points))
        one, other = table.pairs
        both = is_small[one // 3] & is_small[other // 3]
        roots = topology.connected(len(triangles), one[both] // 3, other[both] // 3)
        small = np.flatnonzero(is_small)
        used, numbers = topology.numbered(roots[small])
        labels = np.full(len(triangles), -1)
        labels[small] = numbers
        is_closable = np.ones(len(used), bool)
        # What is open, or where more than two meet, stays.
        odd = table.sides[np.repeat(table.counts != 2, table.counts)] // 3
        is_closable[labels[odd[is_small[odd]]]] = False
        against = one[table.is_against] // 3, other[table.is_against] // 3
        for each in against:
            is_closable[labels[each[is_small[each]]]] = False
        is_rim = is_small[one // 3] != is_small[other // 3]
        inner = np.where(is_small[one // 3], one, other)[is_rim]
        sides = np.where(is_small[one // 3], other, one)[is_rim]
        part = labels[inner // 3]
        nodes = np.stack([part * len(points) + table.first[sides], part * len(points) + table.last[sides]])
        places, ends = np.unique(nodes, return_inverse=True)
        ends = ends.reshape(nodes.shape)
        _, loops = topology.numbered(topology.connected(len(places), *ends)[ends[0]])
        count = int(loops.max(initial=-1)) + 1
        of_loop, group = np.zeros((2, count), np.int64)
        of_loop[loops], group[loops] = part, groups[sides // 3]
        lengths = np.linalg.norm(points[table.last[sides]] - points[table.first[sides]], axis=1)
        beside = normals[sides // 3]
        ups = unit(topology.sums_of(loops, lengths[:, None] * beside, count))
        is_good = np.ones(count, bool)
        is_good[loops[group[loops] != groups[sides // 3]]] = False
        is_good[loops[(ups[loops] * beside).sum(axis=1) < np.cos(SOFT)]] = False
        is_round = np.zeros(len(used), bool)
        is_round[part[(ups[loops] * beside).sum(axis=1) < np.cos(ANGLES[0])]] = True
        for end in ends:  # each place once
            is_good[loops[np.bincount(end, minlength=len(places))[end] != 1]] = False
        start, stop = points[table.first[sides]], points[table.last[sides]]
        areas = np.bincount(loops, (np.cross(start, stop) * ups[loops]).sum(axis=1), count)
        is_good &= areas < 0.0
        is_closable[of_loop[~is_good]] = False
        has_loop = np.zeros(len(used), bool)
        has_loop[of_loop] = True
        is_closable &= has_loop
        return cls(
            points, triangles, is_small, labels, table, sides, loops, of_loop, normals, ups, is_round, is_closable
        )

    @cached_property
    def vertex_counts(self) -> np.ndarray:
        """How many vertices (K,) each part has."""
        return vertex_counts(self.triangles[self.is_small], self.labels[self.is_small], len(self.is_closable))

    def gains(self) -> np.ndarray:
        """How many triangles (K,) fewer there are at once if a part is closed."""
        count = len(self.is_closable)
        caps = np.bincount(self.of_loop, np.bincount(self.loops, minlength=len(self.of_loop)) - 2, count)
        return np.bincount(self.labels[self.is_small], minlength=count) - caps

    def costs(self) -> np.ndarray:
        """As `closing_costs` has them. What goes through the surface counts by its width, however thin walls are."""
        count = len(self.is_closable)
        axes = topology.sums_of(self.of_loop, (self.ups[:, :, None] * self.ups[:, None]).reshape(-1, 9), count)
        axes = np.linalg.eigh(axes.reshape(-1, 3, 3))[1][:, :, 2]
        axes *= (np.bincount(self.of_loop, minlength=count) > 1)[:, None]
        small = self.triangles[self.is_small]
        return closing_costs(self.points, small, self.labels[self.is_small], self.vertex_counts, axes)

    @staticmethod
    def apart(is_closed: np.ndarray) -> np.ndarray:
        """`is_closed` (K,) bool: none lies beside others."""
        return is_closed

    def caps_of(self, is_closed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangles (C, 3) in the loops of closed parts (K,) bool, and the triangle (C,) int beside their loop whose plane each
        one continues best."""
        chosen = np.flatnonzero(is_closed[self.of_loop[self.loops]])
        loops = self.loops[chosen]
        # Caps run against the sides of the triangles beside them.
        first, last = self.table.last[self.sides[chosen]], self.table.first[self.sides[chosen]]
        caps, of = polygons.triangulated(self.points, first, last, loops, self.ups)
        keys, width = loops * len(self.points) + first, len(self.points)
        order = np.argsort(keys)
        beside = self.sides[chosen][order[np.searchsorted(keys[order], of[:, None] * width + caps)]] // 3
        alike = np.einsum("ckx,cx->ck", self.normals[beside], face_normals(self.points, caps))
        return caps, beside[np.arange(len(caps)), alike.argmax(axis=1)]
