# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes triangle meshes coarser by collapsing edges, many at once.

Each edge becomes the point with the least squares of distances, by area, from the planes of all faces that it stands for.

Sources: Garland and Heckbert, "Surface simplification using quadric error metrics", 1997; with poses, Mohr and Gleicher,
"Deformation sensitive decimation", 2003. There, the cheapest edge collapses, then the next; here, in each round, the cheapest
tenth of those that do not touch, so that numpy works on whole arrays.
Tried, from 58,320 triangles to 3,000: 51 rounds, 0.66 s; with one pass a round 106 rounds, 0.96 s, and the farthest place 12 %
farther; without the memory of edges whose ends stayed 1.10 s.
Tried: samples of the high mesh, carried through each collapse to the nearest new face, as the hits of a bake. Texels that
viewers see more than 45 degrees or 2 % of the diagonal off, against Cast's own hits: a character 0.32 and 0.32 %, folds 0.23
and 0.23 %, a building 5.7 and 2.6 %.
"""

from dataclasses import dataclass

import numpy as np

from . import topology
from .quadrics import Moved, Quadrics, quadrics_of
from .topology import EdgeTable
from .triangles import checked, face_normals, quality

STIFF = 1e-4
"""The share of a quadric by which a point is held in the middle of its edge, where its planes leave it free."""
IN_POSE = 0.1
"""How much squared distances in a pose count, against those at rest. Tried on spot with five bones, 1,000 triangles, two poses:
distances at rest and in other poses of 0.050 and 0.227 % of the diagonal without poses, 0.057 and 0.121 % with a tenth, 0.062
and 0.121 % with the whole."""
AT_ONCE = 0.1
"""The share of the edges, from the cheapest, of which a round collapses those that do not touch."""
PASSES = 2
"""How often a round looks for edges that touch none that it has: after a single time, many are left."""
LEAST_COSINE, LEAST_QUALITY = 0.3, 0.06
"""The least cosine between a triangle's normals before and after, and the least quality of a triangle, which is 1 for an
equilateral one: collapses that make worse triangles are refused."""
IDLE = 60
"""Rounds without a collapse after which it ends. Each of them refuses some edges, and the next one tries others."""


@dataclass(frozen=True, eq=False)
class PartialCollapse:
    """A mesh on its way to coarser ones.

    Attributes:
        points: (V, 3) float64, scaled and moved.
        triangles: (T, 3) int64, those that are left.
        of_vertex: (V,) int, what each vertex has become.
    """

    points: np.ndarray
    triangles: np.ndarray
    of_vertex: np.ndarray


@dataclass(frozen=True, eq=False)
class CollapseOptions:
    """What `collapse` makes.

    Attributes:
        triangles: about how many are left, or more where no edge can collapse.
        weights: (T,), how much the distances from each triangle count; None for all alike.
        start: what `partial_collapse` made of the same mesh, from which this one goes on; None to start with all triangles.
        motions: (P, V, 3, 4), to where each vertex goes in some poses, as matrices: distances from the posed triangles count,
            too. None for a mesh that stays at rest.
    """

    triangles: int
    weights: np.ndarray | None = None
    start: PartialCollapse | None = None
    motions: np.ndarray | None = None


def collapse(points: np.ndarray, triangles: np.ndarray, options: CollapseOptions) -> tuple[np.ndarray, np.ndarray]:
    """A coarser mesh of the same surface.

    >>> coarse, left = collapse(points, triangles, CollapseOptions(triangles=100))
    >>> len(left)
    100

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices, see `weld`, and areas above 0.
        options: how coarse it becomes.

    Returns:
        Points (P, 3) float64 and triangles (N, 3) int64.
    """
    points, triangles = checked(points, triangles)
    if not len(triangles):
        return np.zeros((0, 3)), triangles.astype(np.int64)
    center, size = box(points)
    state = _run(points, triangles, options)
    used, numbers = topology.numbered(state.triangles)
    return state.points[used] * size + center, numbers


def partial_collapse(points: np.ndarray, triangles: np.ndarray, options: CollapseOptions) -> PartialCollapse:
    """As `collapse`, for others that go on from there, also with other weights.

    >>> start = partial_collapse(points, triangles, CollapseOptions(triangles=300))
    >>> _, left = collapse(points, triangles, CollapseOptions(triangles=100, start=start))
    >>> len(left)
    100
    """
    state = _run(*checked(points, triangles), options)
    return PartialCollapse(state.points, state.triangles, state.of_vertex)


def _run(points: np.ndarray, triangles: np.ndarray, options: CollapseOptions) -> "State":
    weights = np.ones(len(triangles)) if options.weights is None else options.weights
    state = State.of(points, triangles, weights, options.motions)
    if options.start is not None:
        state.resume(options.start)
    state.run(options.triangles)
    return state


def box(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The mean of points, and the longest side of the box around them."""
    return points.mean(axis=0, dtype=np.float64), max(float(np.ptp(points, axis=0).max(initial=0.0)), 1e-30)


class State:
    """A mesh on its way, as PartialCollapse has it."""

    at_once = AT_ONCE

    def __init__(self, points: np.ndarray, triangles: np.ndarray, quadrics: Quadrics):
        self.points, self.triangles, self._round = points, triangles, 0
        self.of_vertex = np.arange(len(points))
        self._is_stuck = False
        """Whether no edge may collapse any more."""
        self._refused, self._since = np.zeros((2, 0), np.int64)
        """The keys of edges whose collapse was refused, and in which rounds."""
        self._changed = np.zeros(len(points), np.int64)
        """The rounds in which the vertices, or those beside them, were last moved."""
        self._planes, self._offsets, self._constants = quadrics
        self._poses: list[Moved] = []
        self._known = np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0)
        """The keys of edges, in order, and their optimal placements when both of their ends were as they are now."""

    @classmethod
    def of(
        cls, points: np.ndarray, triangles: np.ndarray, weights: np.ndarray, motions: np.ndarray | None = None
    ) -> "State":
        """Of a mesh as it is. Its points are moved, so that sums of squares stay exact.

        motions: as CollapseOptions has them.
        """
        center, size = box(points)
        points, triangles = (points.astype(np.float64) - center) / size, triangles.astype(np.int64)
        state = cls(points, triangles, quadrics_of(points, triangles, weights))
        state.pose(motions, weights, (center, size))
        return state

    def pose(
        self,
        motions: np.ndarray | None,
        weights: np.ndarray,
        within: tuple[np.ndarray, float],
        is_inner: np.ndarray | None = None,
    ) -> None:
        """Let distances in poses count, too: before the first step. within: the box around the points. is_inner: as of
        quadrics.quadrics_of."""
        center, size = within
        for motion in () if motions is None else motions:
            turns, shifts = motion[..., :3], motion[..., 3]
            own = np.concatenate([turns, ((turns @ center + shifts - center) / size)[..., None]], axis=2)
            self._poses.append(Moved.of(self.points, self.triangles, IN_POSE * weights, own, is_inner))

    def resume(self, start: PartialCollapse) -> None:
        """Take the mesh from there, with the quadrics of all faces that its vertices stand for."""
        self.points, self.triangles, self.of_vertex = start.points.copy(), start.triangles, start.of_vertex
        for values in (self._planes, self._offsets, self._constants):
            own = values.copy()
            values[:] = 0.0
            np.add.at(values, self.of_vertex, own)
        for pose in self._poses:
            pose.gather(self.of_vertex)

    def run(self, wanted: int, most: float = np.inf) -> None:
        """Collapse edges until about `wanted` triangles are left, or none costs `most` or less."""
        idle, self._is_stuck = 0, False
        while len(self.triangles) > wanted and idle < IDLE and not self._is_stuck:
            idle = 0 if self.step(wanted, most) else idle + 1

    def step(self, wanted: int, most_cost: float = np.inf) -> bool:
        """Collapse some edges. Returns whether any did."""
        self._round += 1
        edges = EdgeTable.of(self.triangles, len(self.points))
        is_allowed = self._allowed(edges)
        is_still = (self._changed[np.stack(np.divmod(self._refused, len(self.points)))] <= self._since).all(axis=0)
        self._refused, self._since = self._refused[is_still], self._since[is_still]
        is_allowed &= ~np.isin(edges.keys, self._refused)
        chosen = np.flatnonzero(is_allowed)
        if not len(chosen):
            self._is_stuck = True
            return False
        places, costs = self._placed(edges, chosen)
        is_cheap = costs <= most_cost
        if not is_cheap.any():
            self._is_stuck = True
            return False
        chosen, places, costs = chosen[is_cheap], places[is_cheap], costs[is_cheap]
        costs = costs / edges.counts[chosen]  # for each triangle that goes: one at open edges
        most = max(1, int(self.at_once * len(costs)))
        cheapest = np.flatnonzero(costs <= np.partition(costs, most - 1)[most - 1])
        order = cheapest[np.argsort(costs[cheapest], kind="stable")][:most]
        ranks = np.full(len(edges.ends), len(edges.ends), np.int64)
        ranks[chosen[order]] = np.arange(most)
        which = self._independent_edges(edges, ranks)
        which = which[np.argsort(ranks[which])]
        removed = np.cumsum(edges.counts[which])
        which = which[: 1 + np.searchsorted(removed, len(self.triangles) - wanted)]
        at = np.full(len(edges.ends), -1)
        at[chosen] = np.arange(len(chosen))
        places = places[at[which]]
        is_good = self._is_good(edges, which, places)
        refused = edges.keys[which[~is_good]]
        self._refused = np.concatenate([self._refused, refused])
        self._since = np.concatenate([self._since, np.full(len(refused), self._round)])
        moved = np.zeros(len(self.points), bool)
        moved[edges.ends[which[is_good]]] = True
        self._changed[edges.ends[moved[edges.ends].any(axis=1)]] = self._round + 1
        self._collapse_edges(edges, which[is_good], places[is_good])
        return bool(is_good.any())

    def _allowed(self, edges: EdgeTable) -> np.ndarray:
        """Which edges (E,) bool may collapse."""
        is_border = np.zeros(len(self.points), bool)
        is_border[edges.ends[edges.counts != 2]] = True
        # An edge between two borders would join them, and at one of more than two triangles, faces have no order.
        return (edges.counts == 1) | ((edges.counts == 2) & ~is_border[edges.ends].all(axis=1))

    def _placed(self, edges: EdgeTable, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where some edges (N,) collapse to (N, 3), and what that costs (N,)."""
        return self._optimal_placements(edges, chosen)

    def _collapse_edges(self, edges: EdgeTable, which: np.ndarray, places: np.ndarray) -> None:
        """Collapse edges (N,) to their places (N, 3)."""
        self._collapse(edges.ends[which], places)

    def _optimal_placements(self, edges: EdgeTable, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where some edges (N,) collapse to, and what that costs, as `_new_placements` has both."""
        keys = edges.keys[chosen]
        known, *values = self._known
        places, costs = (np.empty((len(keys), *each.shape[1:])) for each in values)
        if len(known):
            at = np.minimum(np.searchsorted(known, keys), len(known) - 1)
            is_known = known[at] == keys
            for into, before in zip((places, costs), values, strict=True):
                into[is_known] = before[at[is_known]]
            left = np.flatnonzero(~is_known)
        else:
            left = np.arange(len(keys))
        places[left], costs[left] = self._new_placements(edges, chosen[left])
        self._known = keys, places, costs
        return places, costs

    def _new_placements(self, edges: EdgeTable, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where some edges (N,) would collapse to (N, 3), and what that would cost (N,): these may depend on what is at both
        ends alone."""
        a, b = edges.ends[which].T
        return self._best_places(self._summed(a, b), a, b)

    def _best_places(
        self, quadrics: Quadrics, a: np.ndarray, b: np.ndarray, share: float = 0.5
    ) -> tuple[np.ndarray, np.ndarray]:
        """The places (E, 3) that cost least (E,). share: of the way from vertices a (E,) to b (E,), where a quadric that leaves
        them free has them."""
        planes, offsets, constants = quadrics
        middles = (1.0 - share) * self.points[a] + share * self.points[b]
        stiff = STIFF * np.trace(planes, axis1=1, axis2=2) + 1e-30
        slopes = np.einsum("eij,ej->ei", planes, middles) + offsets
        places = middles - np.linalg.solve(planes + stiff[:, None, None] * np.eye(3), slopes[..., None])[..., 0]
        costs = np.einsum("ei,eij,ej->e", places, planes, places) + 2.0 * (offsets * places).sum(axis=1) + constants
        lengths = ((self.points[a] - self.points[b]) ** 2).sum(axis=1)
        return places, np.maximum(costs, 0.0) + 1e-10 * lengths

    def _summed(self, a: np.ndarray, b: np.ndarray) -> Quadrics:
        """The quadrics of what pairs of vertices (E,) and (E,) stand for, at rest and in poses."""
        planes, offsets, constants = (each[a] + each[b] for each in (self._planes, self._offsets, self._constants))
        for pose in self._poses:
            more = pose.summed(a, b)
            planes, offsets, constants = planes + more[0], offsets + more[1], constants + more[2]
        return planes, offsets, constants

    def _independent_edges(self, edges: EdgeTable, ranks: np.ndarray) -> np.ndarray:
        """Edges (N,) int, of which no two touch or have neighbors in common that touch. ranks (E,): of those that may collapse,
        from 0; E of the others."""
        a, b = edges.ends.T
        left, chosen = np.flatnonzero(ranks < len(ranks)), []
        for _ in range(PASSES):
            least = np.full(len(self.points), len(ranks), np.int64)
            for end in (a, b):
                np.minimum.at(least, end[left], ranks[left])
            around = least.copy()
            np.minimum.at(around, a, least[b])
            np.minimum.at(around, b, least[a])
            chosen.append(left[(ranks[left] == around[a[left]]) & (ranks[left] == around[b[left]])])
            is_taken = np.zeros(len(self.points), bool)
            is_taken[edges.ends[chosen[-1]]] = True
            is_taken[edges.ends[is_taken[edges.ends].any(axis=1)]] = True
            left = left[~is_taken[edges.ends[left]].any(axis=1)]
        return np.concatenate(chosen)

    def _is_good(self, edges: EdgeTable, which: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Which collapses (N,) bool keep the surface a surface, and turn no triangle. places: (N, 3)."""
        owner = np.full(len(self.points), -1)
        owner[edges.ends[which]] = np.arange(len(which))[:, None]
        # Vertices beside both ends: one for each triangle at the edge, or the surface would be pinched.
        a, b = edges.ends.T
        beside = [(owner[one], two) for one, two in ((a, b), (b, a))]
        pairs = [
            own[is_own] * len(self.points) + other[is_own]
            for own, other in beside
            for is_own in [(own >= 0) & (owner[other] != own)]
        ]
        keys, counts = np.unique(np.concatenate(pairs), return_counts=True)
        both = np.bincount(keys[counts == 2] // len(self.points), minlength=len(which))
        is_good = both == edges.counts[which]
        owners = owner[self.triangles]
        kept = np.flatnonzero((owners >= 0).sum(axis=1) == 1)
        number = owners[kept].max(axis=1)
        before = self.points[self.triangles[kept]]
        after = np.where((owners[kept] >= 0)[..., None], places[number][:, None], before)
        is_good[number[self._is_spoiled(kept, before, after)]] = False
        # Nor may two triangles come to one place, as those of a tetrahedron.
        others = np.sort(self.triangles[kept][owners[kept] < 0].reshape(-1, 2), axis=1)
        is_again = topology.first_rows(np.column_stack([number, others])) != np.arange(len(number))
        is_good[number[is_again]] = False
        return is_good

    def _is_spoiled(self, which: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Which of some triangles (N,) int would turn too far or become too thin, (N,) bool. before, after: their corners
        (N, 3, 3)."""
        old, new = face_normals(before), face_normals(after)
        old_area, new_area = np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1)
        is_turned = (old * new).sum(axis=1) < LEAST_COSINE * old_area * new_area
        return is_turned | (quality(after, new_area) < np.minimum(LEAST_QUALITY, 0.5 * quality(before, old_area)))

    def _collapse(self, ends: np.ndarray, places: np.ndarray) -> None:
        a, b = ends.T
        moved = np.zeros(len(self.points), bool)
        moved[ends] = True
        keys, *values = self._known
        is_still = ~moved[np.stack(np.divmod(keys, len(moved)))].any(axis=0)
        self._known = keys[is_still], *(each[is_still] for each in values)
        for pose in self._poses:
            pose.merge(ends, self.points[ends], places)
        self.points[a] = places
        for values in (self._planes, self._offsets, self._constants):
            values[a] += values[b]
        new = np.arange(len(self.points))
        new[b] = a
        self.of_vertex = new[self.of_vertex]
        triangles = new[self.triangles]
        self._keep(triangles, topology.has_corners(triangles))

    def _keep(self, triangles: np.ndarray, which: np.ndarray) -> None:
        """Take some (T,) bool of new triangles (T, 3)."""
        self.triangles = triangles[which]
