# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes triangle meshes coarser that keep their UV layout, so that they show the textures of the finer one.

Edges collapse as in mesh/collapse.py. A line is where the surface, a UV island or a label ends. Vertices on a line go along it,
and have a wedge of values on each of its sides; planes along lines are the price of what moves across.

Source: Hoppe, "New quadric metric for simplifying meshes with appearance attributes", 1999, for the wedges, and quadrics of
position and UV. There, UVs are the best for all; here, they are those of an end of the edge, or of its middle, whichever costs
least with the best position for it, so that borders of islands stay what they are.
Tried on a chess piece of 3,000 triangles in 34 islands, at 1,500, 750 and 375: 1.95, 3.81 and 7.42 degrees of error without
quadrics of UVs, whose values were those along the edge; with them 1.86, 3.57 and 6.39. Vertices on lines that stay in their
places leave no mesh below 812.
"""

from dataclasses import dataclass, replace

import numpy as np

from . import topology
from .collapse import IN_POSE, CollapseOptions, State, box
from .mirrors import Plane
from .quadrics import Mapped, Quadrics, quadrics_of, side_planes, summed
from .topology import EdgeTable
from .triangles import checked, face_areas, face_normals, unit_normals
from .uv_seams import CONNECTED

LINE = 0.3
"""How much the planes along lines inside the surface count, as quadrics.BORDER. Tried on the chess piece: 1.0 has 1.84, 3.41
and 6.53 degrees with all that follows, 0.3 1.81, 3.44 and 6.26, 0.1 1.83, 3.41 and 6.19, but folds plates."""
ALONG = 0.3
"""How much the ways along the surface to where UVs lie count, against distances from it. 1.0 has 1.85, 3.57 and 6.76 degrees,
and outlines of 4.1 % instead of 3.7 %."""
AT_ONCE = 0.03
"""As collapse.AT_ONCE. Tried on the chess piece, with ALONG 0.3: 0.1 has 4.85 % of outlines at 375 triangles, 0.03 4.1 and 0.01
4.25, for 0.65, 0.76 and 1.2 s."""
SHARES = np.array([0.0, 0.5, 1.0])
"""The places along an edge whose UVs it may become."""
LEAST_UV_AREA = 0.05
"""The least area of a triangle in the layout, as a share of what that of its place was for its area on the surface."""
FARTHEST = 0.01
"""How far a collapse may move the surface, as the root mean square over all of it, in longest sides of its box.

Lines leave few edges that can collapse, and the cheapest of these may fold a wall, which moves it by more. Tried on a plate
0.05 thick: with 0.01 it keeps its corners whatever is wanted, with 0.015 it becomes 8 triangles. A chess piece and a helmet
of 3,000 triangles still reach 374."""


@dataclass(frozen=True, eq=False)
class Charted:
    """A mesh with values at its corners.

    Attributes:
        points: (V, 3) float.
        triangles: (T, 3) int.
        values: (T, 3, K) float, at the corners: the first `layers` pairs of them are UV layers.
        labels: (T,) int, of triangles, as the material slot: lines run between those that differ.
        layers: The UV layers whose islands count.
        faces: (T,) int, the triangle of the finest mesh that each one was; None for that itself.
        mirror: Where it was cut, of a half with the layers of both sides, see mesh/layout_halves.py; None if it is whole.
    """

    points: np.ndarray
    triangles: np.ndarray
    values: np.ndarray
    labels: np.ndarray
    layers: int = 1
    faces: np.ndarray | None = None
    mirror: Plane | None = None

    @property
    def on_plane(self) -> np.ndarray:
        """The vertices (V,) bool of a half that its mirror image has, too."""
        if self.mirror is None:
            return np.zeros(len(self.points), bool)
        return self.points[:, self.mirror.axis] == self.mirror.place

    @property
    def free(self) -> np.ndarray | None:
        """Where vertices may move so that those of a half stay in its plane, as FitOptions has it."""
        if self.mirror is None:
            return None
        result = np.tile(np.eye(3), (len(self.points), 1, 1))
        result[self.on_plane, self.mirror.axis] = 0.0
        return result

    @property
    def wedges(self) -> np.ndarray:
        """The wedge (T, 3) int of each corner: corners at a vertex are of one where no line is between them."""
        edges = EdgeTable.of(self.triangles)
        corners = np.arange(3 * len(self.triangles)).reshape(-1, 3)
        pairs = list(zip(*_across(edges, corners), strict=True))
        values = self.values.reshape(corners.size, -1)[:, : 2 * self.layers]
        one, other = (side // 3 for side in edges.pairs)
        is_front = (
            uv_areas(self.values, self.layers) > 0.0
        )  # islands can be folded over, as mirrored ones on each other
        goes_on = (self.labels[one] == self.labels[other]) & (is_front[one] == is_front[other]).all(axis=1)
        for left, right in pairs:
            goes_on &= (np.abs(values[left] - values[right]) <= CONNECTED).all(axis=1)
        first, last = (np.concatenate([each[goes_on] for each in sides]) for sides in zip(*pairs, strict=True))
        return topology.numbered(topology.connected(corners.size, first, last))[1].reshape(-1, 3)

    @property
    def on_line(self) -> np.ndarray:
        """The vertices (V,) bool on lines."""
        edges = EdgeTable.of(self.triangles)
        result = np.zeros(len(self.points), bool)
        result[edges.ends[lines(edges, self.wedges)]] = True
        return result


def collapse_layout(mesh: Charted, options: CollapseOptions, room: float) -> Charted:
    """A coarser mesh with the layout of a mesh.

    Args:
        mesh: the finer one, with areas above 0.
        options: how coarse it becomes, or less where the next edge moves the surface too far; `start` is not used.
        room: how far borders of islands may move outwards in the first UV layer, as a share of the map's side.
    """
    checked(mesh.points, mesh.triangles)
    state = LayoutState(mesh, options, room)
    poses = 0 if options.motions is None else len(options.motions)
    area = float(face_areas(state.points, state.triangles).sum())
    state.run(options.triangles, FARTHEST**2 * area * (1.0 + state.of_side * IN_POSE * poses))
    center, size = state.within
    used, triangles = topology.numbered(state.triangles)
    return replace(
        mesh,
        points=state.points[used] * size + center,
        triangles=triangles,
        values=state.values[state.wedges],
        labels=mesh.labels[state.faces],
        faces=state.faces if mesh.faces is None else mesh.faces[state.faces],
    )


class LayoutState(State):
    """A mesh with wedges on its way.

    Attributes:
        wedges: (T, 3) int, of the corners.
        values: (W, K), of the wedges.
        faces: (T,) int, which triangle each one was.
        scales: (T, layers), the signed areas in the layout for an area on the surface, when each triangle was that.
        maps: The quadrics of wedges, in the first UV layer, and in that of the other side.
        drift: (W,), how far the border at a wedge has moved outwards.
        room: how far it may.
        within: The middle (3,) and the size of the box in which points are.
        of_side: How much each of the sides counts in what both have.
    """

    at_once = AT_ONCE

    def __init__(self, mesh: Charted, options: CollapseOptions, room: float):
        """Of a mesh as it is. Its arguments are those of collapse_layout."""
        weights = np.ones(len(mesh.triangles)) if options.weights is None else options.weights
        wedges, edges = mesh.wedges, EdgeTable.of(mesh.triangles)
        begins = edges.begins[lines(edges, wedges) & (edges.counts == 2)]
        sides = edges.sides[np.concatenate([begins, begins + 1])]
        center, size = box(mesh.points)
        self._axis, is_inner = None, None
        if mesh.mirror is not None:
            self._axis, is_inner = mesh.mirror.axis, mesh.on_plane
            center[mesh.mirror.axis] = mesh.mirror.place  # what lies in the plane is exactly at 0
        points, triangles = (mesh.points.astype(np.float64) - center) / size, mesh.triangles.astype(np.int64)
        normals, _ = unit_normals(points[triangles])
        along = summed([side_planes(points, edges, sides, normals, LINE * weights)], len(points))
        inner = quadrics_of(points, triangles, weights, is_inner)
        super().__init__(points, triangles, (inner[0] + along[0], inner[1] + along[1], inner[2] + along[2]))
        firsts = [0] if mesh.mirror is None else [0, mesh.layers // 2]
        self.within, self.of_side = (center, size), 1.0 / len(firsts)
        self.pose(options.motions, self.of_side * weights, self.within, is_inner)
        self.wedges, self.room, self.faces = wedges, room, np.arange(len(mesh.triangles))
        self.values = np.zeros((int(wedges.max(initial=-1)) + 1, mesh.values.shape[-1]))
        self.values[wedges.reshape(-1)] = mesh.values.reshape(wedges.size, -1)
        areas = np.linalg.norm(face_normals(points, triangles), axis=1)
        self.scales = uv_areas(mesh.values, mesh.layers) / np.maximum(areas, 1e-300)[:, None]
        self.drift = np.zeros(len(self.values))
        self.maps = {
            layer: Mapped.of(
                points[triangles], mesh.values[..., 2 * layer : 2 * layer + 2], wedges, self.of_side * ALONG * weights
            )
            for layer in firsts
        }
        self._known = np.zeros(0, np.int64), np.zeros((0, len(SHARES), 3)), np.zeros((0, len(SHARES)))

    def _allowed(self, edges: EdgeTable) -> np.ndarray:
        self._is_line = lines(edges, self.wedges)
        self._is_border = self._is_line & ~self._goes_on(edges)
        self._lines_at = np.bincount(edges.ends[self._is_line].reshape(-1), minlength=len(self.points))
        return super()._allowed(edges)

    @property
    def _on_plane(self) -> np.ndarray:
        """The vertices (V,) bool in the plane in which a half was cut."""
        return np.zeros(len(self.points), bool) if self._axis is None else self.points[:, self._axis] == 0.0

    def _goes_on(self, edges: EdgeTable) -> np.ndarray:
        """The edges (E,) bool in that plane across which islands go on into the other half."""
        result = edges.is_open & self._on_plane[edges.ends].all(axis=1)
        if not result.any():
            return result
        side, half = edges.sides[edges.begins[result]], self.scales.shape[1] // 2
        ends = self.wedges.reshape(-1)[side], np.roll(self.wedges, -1, axis=1).reshape(-1)[side]
        own, other = np.split(self.values[np.stack(ends, axis=1), : 4 * half], 2, axis=2)
        # In the layout, the other half runs the other way round, unless it lies on this one.
        signs = np.sign(self.scales[side // 3])
        is_beside = (signs[:, :half] == -signs[:, half:]).all(axis=1)
        result[result] = is_beside & (np.abs(own - other) <= CONNECTED).all(axis=(1, 2))
        return result

    def _placed(self, edges: EdgeTable, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        places, costs = self._optimal_placements(edges, chosen)
        ends, is_line = edges.ends[chosen], self._is_line[chosen]
        on_line = self._lines_at[ends] > 0
        goes_between = ~on_line.any(axis=1) | (is_line & (self._lines_at[ends] == 2).all(axis=1))
        on_plane = self._on_plane[ends]
        leaves_plane = on_plane & ~on_plane[:, ::-1]
        leaves = np.where(leaves_plane.any(axis=1, keepdims=True), leaves_plane, on_line & ~on_line[:, ::-1])
        is_out = np.stack([leaves[:, 1], ~goes_between | leaves.any(axis=1), leaves[:, 0]], axis=1)
        best, rows = np.where(is_out, np.inf, costs).argmin(axis=1), np.arange(len(ends))
        self._shares = np.zeros(len(edges.ends))
        """How far along each edge (E,) the UVs lie that it becomes."""
        self._shares[chosen] = SHARES[best]
        return places[rows, best], costs[rows, best]

    def _new_placements(self, edges: EdgeTable, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The places (E, 3, 3) and costs (E, 3) of edges that become what is at each of SHARES."""
        a, b = edges.ends[which].T
        owners = np.zeros(len(self.values), np.int64)
        owners[self.wedges.reshape(-1)] = self.triangles.reshape(-1)
        now = self._mapped(np.arange(len(owners)), self.values)
        at_vertices = [
            topology.sums_of(owners, each.reshape(len(owners), -1), len(self.points)).reshape(-1, *each.shape[1:])
            for each in now
        ]
        here = [one + other[a] + other[b] for one, other in zip(self._summed(a, b), at_vertices, strict=True)]
        sides = [self._beside(edges, which, a, nth) for nth in (0, 1)]
        has_two = edges.counts[which] > 1
        found = []
        for share in SHARES:
            quadrics = [each.copy() for each in here]
            for nth, pair in enumerate(sides):
                values = (1.0 - share) * self.values[pair[0]] + share * self.values[pair[1]]
                for end, wedge in enumerate(pair):
                    some = has_two & (wedge != sides[0][end]) if nth else np.ones(len(which), bool)
                    moved = self._mapped(wedge, values)
                    for total, new, old in zip(quadrics, moved, now, strict=True):
                        total[some] += new[some] - old[wedge[some]]
            found.append(self._best_places((quadrics[0], quadrics[1], quadrics[2]), a, b, share))
        places, costs = zip(*found, strict=True)
        return np.stack(places, axis=1), np.stack(costs, axis=1)

    def _mapped(self, wedges: np.ndarray, values: np.ndarray) -> Quadrics:
        """The quadrics of positions of wedges (N,) with values (N, K)."""
        first, *others = (each.at(wedges, values[:, 2 * layer : 2 * layer + 2]) for layer, each in self.maps.items())
        for other in others:
            first = first[0] + other[0], first[1] + other[1], first[2] + other[2]
        return first

    def _best_places(
        self, quadrics: Quadrics, a: np.ndarray, b: np.ndarray, share: float = 0.5
    ) -> tuple[np.ndarray, np.ndarray]:
        if self._axis is not None:  # with an end in the plane, they stay there
            free, on_plane = np.ones((len(a), 3)), self._on_plane
            free[on_plane[a] | on_plane[b], self._axis] = 0.0
            quadrics = quadrics[0] * free[:, :, None] * free[:, None], quadrics[1] * free, quadrics[2]
        return super()._best_places(quadrics, a, b, share)

    def _beside(self, edges: EdgeTable, which: np.ndarray, start: np.ndarray, nth: int) -> tuple[np.ndarray, ...]:
        """The wedges (N,) at both ends of edges, on their first or second side, or on the only one. start: (N,), the ends of
        which those come first."""
        side = edges.sides[edges.begins[which] + np.minimum(nth, edges.counts[which] - 1)]
        first, last = self.wedges.reshape(-1)[side], np.roll(self.wedges, -1, axis=1).reshape(-1)[side]
        is_first = edges.first[side] == start
        return np.where(is_first, first, last), np.where(is_first, last, first)

    def _after(self, edges: EdgeTable, which: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What becomes of edges (N,) that collapse: the ends (N,) that stay, the wedge (W,) that each one becomes, and the
        values (W, K) of wedges."""
        shares = self._shares[which]
        stay = edges.ends[which, (shares == 1.0).astype(np.int64)]
        shares = np.where(shares == 1.0, 0.0, shares)[:, None]
        target, values = np.arange(len(self.values)), self.values.copy()
        for nth in (0, 1):
            has = np.flatnonzero(edges.counts[which] > nth)
            kept, gone = self._beside(edges, which[has], stay[has], nth)
            target[gone] = kept
            values[kept] = (1.0 - shares[has]) * self.values[kept] + shares[has] * self.values[gone]
        return stay, target, values

    def _is_good(self, edges: EdgeTable, which: np.ndarray, places: np.ndarray) -> np.ndarray:
        is_good = super()._is_good(edges, which, places)
        stay, target, values = self._after(edges, which)
        owner = np.full(len(self.points), -1)
        owner[edges.ends[which]] = np.arange(len(which))[:, None]
        owners = owner[self.triangles]
        kept = np.flatnonzero((owners >= 0).sum(axis=1) == 1)
        number = owners[kept].max(axis=1)
        corners = np.where((owners[kept] >= 0)[..., None], places[number][:, None], self.points[self.triangles[kept]])
        areas, scales, layers = np.linalg.norm(face_normals(corners), axis=1), self.scales[kept], self.scales.shape[1]
        now = uv_areas(values[target[self.wedges[kept]]], layers)
        is_bad = now * np.sign(scales) < LEAST_UV_AREA * areas[:, None] * np.abs(scales)
        is_good[number[is_bad.any(axis=1)]] = False
        if self._axis is not None:
            is_good[number[(corners[..., self._axis] == 0.0).all(axis=1)]] = False
            is_good &= self._keeps_halves_apart(edges, which, places, owner)
        _, number, far = self._moved_borders(edges, which, stay, target, values)
        is_good[number[far > self.room]] = False
        return is_good

    def _keeps_halves_apart(
        self, edges: EdgeTable, which: np.ndarray, places: np.ndarray, owner: np.ndarray
    ) -> np.ndarray:
        """Which collapses (N,) bool keep a half on its side of the plane, and let it meet the other along its border alone.
        owner: (V,) int, the number of the edge of which each vertex is an end; -1 for none."""
        on_plane, ends = self._on_plane, edges.ends
        at_border = on_plane[ends]
        result = at_border[which].any(axis=1) | (places[:, self._axis] > 0.0)
        # What comes into the plane brings its edges to vertices there: they must be edges of the border already.
        leads = at_border[:, 0] != at_border[:, 1]
        there, comes = (np.where(at_border[leads, 0] == is_first, *ends[leads].T) for is_first in (True, False))
        number = owner[comes]
        here = np.where(number >= 0, np.where(on_plane[ends[which]], ends[which], -1).max(axis=1)[number], -1)
        is_new = (here >= 0) & (here != there)
        keys = topology.edge_keys(here[is_new], there[is_new], edges.width)
        border = edges.keys[edges.is_open & at_border.all(axis=1)]
        result[number[is_new][~np.isin(keys, border)]] = False
        return result

    def _moved_borders(
        self, edges: EdgeTable, which: np.ndarray, stay: np.ndarray, target: np.ndarray, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How far borders move outwards in the layout if edges collapse: the wedges (M,) where they do, the number (M,) of the
        edge, and how far the border there then is from where it was. stay, target, values: from _after."""
        along = np.flatnonzero(self._is_line[which])
        owner, gone = np.full(len(self.points), -1), edges.ends[which].sum(axis=1) - stay
        owner[gone[along]] = owner[stay[along]] = along
        first, last = self.wedges.reshape(-1), np.roll(self.wedges, -1, axis=1).reshape(-1)
        lines, found = np.flatnonzero(self._is_border), []
        for nth in (0, 1):
            side = edges.sides[edges.begins[lines[edges.counts[lines] > nth]] + nth]
            ends = (edges.first[side], first[side]), (edges.last[side], last[side])
            for turn, ((vertex, here), (other, there)) in zip((1.0, -1.0), (ends, ends[::-1]), strict=True):
                number = owner[vertex]
                # The edge of the line beyond the one that collapses: its end at that moves.
                beyond = np.flatnonzero((number >= 0) & (owner[other] != number))
                number, before, far_end = number[beyond], here[beyond], there[beyond]
                after = target[before]
                most = np.zeros(len(after))
                for layer in self.maps:
                    uv = slice(2 * layer, 2 * layer + 2)
                    start, stop = values[after][:, uv], self.values[far_end][:, uv]
                    inside = turn * np.sign(self.scales[side[beyond] // 3, layer])
                    line = stop - start
                    off = inside * _crossed(line, self.values[before][:, uv] - start)
                    most = np.maximum(most, off / np.maximum(np.hypot(*line.T), 1e-300))
                found.append((after, number, np.maximum(self.drift[before], self.drift[after]) + most))
        wedges, numbers, far = map(np.concatenate, zip(*found, strict=True))
        return wedges, numbers, far

    def _collapse_edges(self, edges: EdgeTable, which: np.ndarray, places: np.ndarray) -> None:
        stay, target, values = self._after(edges, which)
        wedges, _, far = self._moved_borders(edges, which, stay, target, values)
        np.maximum.at(self.drift, wedges, far)
        self.values, self.wedges = values, target[self.wedges]
        for each in self.maps.values():
            each.merge(target)
        self._collapse(np.stack([stay, edges.ends[which].sum(axis=1) - stay], axis=1), places)

    def _keep(self, triangles: np.ndarray, which: np.ndarray) -> None:
        super()._keep(triangles, which)
        self.wedges, self.faces, self.scales = self.wedges[which], self.faces[which], self.scales[which]


def _across(
    edges: EdgeTable, corners: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """What is at the corners of both triangles at each edge of two: at one end of it on both sides, and at the other end."""
    one, other = edges.pairs
    first, last = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    is_along = edges.first[one] == edges.first[other]
    start, stop = np.where(is_along, (first[other], last[other]), (last[other], first[other]))
    return (first[one], last[one]), (start, stop)


def lines(edges: EdgeTable, wedges: np.ndarray) -> np.ndarray:
    """Which edges (E,) bool are on lines."""
    result = edges.counts != 2
    one, other = _across(edges, wedges)
    result[edges.counts == 2] = (one[0] != other[0]) | (one[1] != other[1])
    return result


def uv_areas(values: np.ndarray, layers: int) -> np.ndarray:
    """Twice the signed areas (T, layers) of triangles in UV layers. values: (T, 3, K), of their corners."""
    uv = values[..., : 2 * layers].reshape(len(values), 3, layers, 2)
    return _crossed(uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0])


def _crossed(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The areas of parallelograms (...,) along vectors (..., 2)."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
