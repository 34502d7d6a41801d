# SPDX-License-Identifier: GPL-3.0-or-later
"""Divides a surface into charts for a UV map: pieces that lie flat with little stretch and have short borders.

Neighbors that gain the most are joined, all pairs at once that are one another's best, until nothing gains: rounds as by
Boruvka, "O jistem problemu minimalnim", 1926. Joining spares the map margins and split vertices, and costs stretch; all
are areas of the surface, so that they compare.

Sources: Garland, Willmott and Heckbert, "Hierarchical face clustering on polygonal surfaces", 2001, for charts that are joined;
Julius, Kraevoy and Sheffer, "D-Charts: quasi-developable mesh segmentation", 2005, for normals on a circle, which cost nothing;
Erickson and Whittlesey, "Greedy optimal homotopy and homology generators", 2005, for slits.
"""

from dataclasses import dataclass

import numpy as np

from . import topology
from .topology import EdgeTable, edge_keys, numbered, sums_of
from .triangles import checked, face_normals

FULL = 0.75
"""About the share of the map that packed charts use: from it follows how long margins are on the surface."""
CAP = 1.0 / (48.0 * np.pi**2)
"""Of a round cap with the angle t from its middle to its rim, texels at equal blur need t**4 / 48 more of the map. Its
curvature is pi * t**2, and t**4 / 48 the least variance of its normals along an axis."""
SPIKE = 0.5
"""A vertex with more curvature, in radians, is the end of a slit, instead of in a chart: the tip of a cone."""
SWEEPS = 12
"""How often borders are made shorter, at most."""


@dataclass(frozen=True, eq=False)
class ChartOptions:
    """What `chart` makes.

    Attributes:
        margin: around charts, as a share of the map's side: what borders cost.
        stretch: how much stretch counts, against borders: 100 for tiny charts, 1 for what it costs, 0.1 for large charts.
        faces: (T,) int from 0, the face of each triangle, which stays whole; None for each by itself.
        hard: (H, 2) int, the vertices of edges that must be seams, as those where normals break; None for none.
        wanted: (W, 2) int, the vertices of edges where a seam costs less, as those between materials; None for none.
    """

    margin: float = 1.0 / 256.0
    stretch: float = 1.0
    faces: np.ndarray | None = None
    hard: np.ndarray | None = None
    wanted: np.ndarray | None = None


def chart(
    points: np.ndarray, triangles: np.ndarray, options: ChartOptions = ChartOptions()
) -> tuple[np.ndarray, np.ndarray]:
    """Divide a surface into charts that are disks, or flat.

    >>> labels, seams = chart(points, triangles, ChartOptions(stretch=0.1))
    >>> bool(labels.max() < 10)
    True

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices, see `weld`.
        options: how large charts are.

    Returns:
        The chart (T,) int from 0 of each triangle, and the edges to cut (S, 2) int, as vertices: also slits inside a chart.
    """
    points, triangles = checked(points, triangles)
    if not len(triangles):
        return np.zeros(0, np.int64), np.zeros((0, 2), np.int64)
    charts = Charts(points, triangles, options)
    labels = charts.straightened(charts.grown(charts.flat(), options.stretch), options.stretch)
    return labels[charts.faces], charts.seams(labels)


class Charts:
    """The faces of a surface, and what it costs and gains to join them. Charts are labels (F,) int from 0 of the faces.

    Attributes:
        faces: (T,) int, the face of each triangle.
        count: Of faces.
        areas: (F,) float64.
        normals: (F, 3) float64, of faces, as long as their areas.
        centers: (F, 3) float64.
        side_lengths: (3 * T,) float64, of the sides of triangles.
    """

    BENT, FOLD = 3.0, 40.0
    """In degrees: charts that bend less are flat; borders along edges that are bent by more cost less."""
    CHEAP = {"wanted": 0.3, "fold": 0.8, "concave": 0.6}
    """What a border costs there, as a share of others: texels differ along it anyway, or nobody sees it."""

    def __init__(self, points: np.ndarray, triangles: np.ndarray, options: ChartOptions):
        """triangles: (T, 3) int, with shared vertices."""
        points = points.astype(np.float64)
        self.faces = np.arange(len(triangles)) if options.faces is None else np.asarray(options.faces)
        self.count = int(self.faces.max(initial=-1)) + 1
        long = 0.5 * face_normals(points, triangles)
        areas = np.linalg.norm(long, axis=1)
        total = float(areas.sum())
        self.normals = sums_of(self.faces, long, self.count)
        self.areas = np.bincount(self.faces, areas, self.count)
        unit = long / np.where(areas > 0.0, areas, 1.0)[:, None]
        pairs = np.stack([long[:, i] * unit[:, j] for i in range(3) for j in range(i, 3)], axis=1)
        self._sums = np.column_stack([self.areas, self.normals, sums_of(self.faces, pairs, self.count)])
        self._margin = 2.0 * options.margin * np.sqrt(total / FULL)
        self._split = 0.1 * total / max(1, len(numbered(triangles.reshape(-1))[0]))
        corners = points[triangles]
        self.centers = sums_of(self.faces, corners.mean(axis=1) * (areas + 1e-300)[:, None], self.count)
        self.centers /= np.maximum(np.bincount(self.faces, areas + 1e-300, self.count), 1e-300)[:, None]
        self.side_lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).reshape(-1)
        self._read_edges(points, triangles, options)
        self._read_vertices(points, triangles)

    def _read_edges(self, points: np.ndarray, triangles: np.ndarray, options: ChartOptions) -> None:
        table = EdgeTable.of(triangles, len(points))
        first, second = table.sides[table.begins], table.sides[np.minimum(table.begins + 1, len(table.sides) - 1)]
        sides = np.stack([self.faces[first // 3], self.faces[second // 3]], axis=1)
        # Faces on both sides of an edge run along it in opposite directions, unless one of them shows its back.
        joins = (table.counts == 2) & (table.first[first] == table.last[second])
        joins &= table.first[first] != table.last[first]
        inner = joins & (sides[:, 0] == sides[:, 1])
        joins &= ~inner & ~_among(table.keys, options.hard, len(points))
        lengths = np.linalg.norm(points[table.ends[:, 0]] - points[table.ends[:, 1]], axis=1)
        # How faces bend at an edge: positive where the surface is hollow.
        apex = points[np.roll(triangles, -2, axis=1).reshape(-1)[second]] - points[table.first[first]]
        unit = self.normals / np.where(self.areas > 0.0, self.areas, 1.0)[:, None]
        one, other = unit[sides[:, 0]], unit[sides[:, 1]]
        bends = (one * other).sum(axis=1) < np.cos(np.radians(self.FOLD))
        weights = np.where(bends, self.CHEAP["fold"], 1.0)
        weights[bends & ((apex * one).sum(axis=1) > 0.0)] = self.CHEAP["concave"]
        weights[_among(table.keys, options.wanted, len(points))] = self.CHEAP["wanted"]
        self._others = table.ends[~joins & ~inner]  # edges that are always borders
        self._ends, self._sides = table.ends[joins], sides[joins]
        starts = np.stack([first[joins], second[joins]])
        self._joints = np.stack(
            [starts, (starts - starts % 3 + (starts + 1) % 3)[::-1]], axis=0
        )  # corners that are one
        self._lengths = lengths[joins]
        self._prices = self._margin * (lengths * weights)[joins] + self._split
        self._spread = bends[joins]

    def _read_vertices(self, points: np.ndarray, triangles: np.ndarray) -> None:
        """The curvature of vertices, by the angles around them, and which faces are there."""
        corners = points[triangles]
        ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
        cross = np.linalg.norm(np.cross(ahead, behind), axis=2)
        angles = np.arctan2(cross, (ahead * behind).sum(axis=2))
        self._curvature = 2.0 * np.pi - np.bincount(triangles.reshape(-1), angles.reshape(-1), len(points))
        self._is_inside = np.zeros(len(points), bool)  # whether it can be inside a chart
        self._is_inside[self._ends] = True
        self._is_inside[self._others] = False
        self._is_spike = np.abs(self._curvature) > SPIKE
        keys = np.unique(triangles.reshape(-1).astype(np.int64) * max(1, self.count) + np.repeat(self.faces, 3))
        vertex, face = np.divmod(keys, max(1, self.count))
        some = self._is_inside[vertex]
        self._vertex, self._at = vertex[some], face[some]

    def flat(self) -> np.ndarray:
        """Labels of faces joined where they lie in one plane, also around holes."""
        unit = self.normals / np.where(self.areas > 0.0, self.areas, 1.0)[:, None]
        one, other = self._sides.T
        near = np.linalg.norm(np.cross(unit[one], unit[other]), axis=1) < 1e-3
        near &= ((unit[one] * unit[other]).sum(axis=1) > 0.0) & (self._prices >= self._margin * self._lengths)
        labels = topology.connected(self.count, one[near], other[near])
        labels = numbered(labels)[1]
        # Where many small bends add up, faces stay by themselves.
        bent = ~self.is_flat(labels)[labels]
        labels = np.where(bent, self.count + np.arange(self.count), labels)
        return numbered(labels)[1]

    def is_flat(self, labels: np.ndarray) -> np.ndarray:
        """Which charts (N,) bool lie in a plane, nearly."""
        normals = self.mean_normals(labels)
        along = (self.normals * normals[labels]).sum(axis=1)
        worst = np.ones(len(normals))
        np.minimum.at(worst, labels, along / np.where(self.areas > 0.0, self.areas, 1.0) + (self.areas == 0.0))
        return worst > np.cos(np.radians(self.BENT))

    def mean_normals(self, labels: np.ndarray) -> np.ndarray:
        """The unit normal (N, 3) of each chart; 0 if its normals cancel out."""
        sums = sums_of(labels, self.normals, int(labels.max(initial=-1)) + 1)
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        return sums / np.where(lengths > 0.0, lengths, 1.0)

    def grown(self, labels: np.ndarray, stretch: float, *, is_stiff: bool = False, most: float = np.inf) -> np.ndarray:
        """Labels of charts joined as long as it pays.

        Args:
            labels: (F,) int from 0.
            stretch: how much it counts.
            is_stiff: whether to count all bends as stretch, as if charts were projected, so that they are rather round.
            most: faces of joined charts.
        """
        growth = _Growth(self, labels, is_stiff=is_stiff, most=most)
        while growth.join(stretch):
            pass
        return numbered(growth.of[labels])[1]

    def straightened(self, labels: np.ndarray, stretch: float) -> np.ndarray:
        """Labels after faces that one edge alone holds went to the chart beside them, where that makes borders shorter."""
        labels, count = labels.copy(), int(labels.max(initial=-1)) + 1
        one, other = self._sides.T
        face, beyond = np.concatenate([one, other]), np.concatenate([other, one])
        prices = np.tile(self._prices, 2)
        for _ in range(SWEEPS):
            own = labels[face] == labels[beyond]
            held = np.bincount(face[own], minlength=self.count)
            price = np.bincount(face[own], prices[own], self.count)
            some = ~own & (held[face] == 1)
            keys, which = np.unique(face[some] * count + labels[beyond[some]], return_inverse=True)
            movers, targets = np.divmod(keys, max(1, count))
            gains = np.bincount(which.reshape(-1), prices[some], len(keys)) - price[movers]
            if len(movers):
                sums = sums_of(labels, self._sums, count)
                moved = self._sums[movers]
                olds, news = sums[labels[movers]], sums[targets]
                gains -= stretch * (_bend(olds - moved) + _bend(news + moved) - _bend(olds) - _bend(news))
            good = gains > 1e-9 * self._margin
            movers, targets, gains = movers[good], targets[good], gains[good]
            if not len(movers):
                break
            # Each by itself: of neighbors, the one that gains most.
            ranks, target = np.full(self.count, -1), np.zeros(self.count, np.int64)
            order = np.argsort(gains, kind="stable")
            ranks[movers[order]], target[movers[order]] = np.arange(len(order)), targets[order]
            highest = np.full(self.count, -1)
            np.maximum.at(highest, face, ranks[beyond])
            chosen = np.flatnonzero((ranks >= 0) & (ranks > highest))
            labels[chosen] = target[chosen]
        return numbered(labels)[1]

    def mirrored(
        self, labels: np.ndarray, vertices: np.ndarray, sides: np.ndarray, *, is_cut: bool = False
    ) -> np.ndarray:
        """Labels of charts that end below a plane where they do above it.

        Args:
            labels: (F,) int from 0.
            vertices: (V,) int, the mirror image of each vertex; -1 for none.
            sides: (F,) int, 1 for faces above the plane, -1 for those below, which have mirror images, 0 for others.
            is_cut: whether charts end in the plane as well, else those that cross it are whole.
        """
        one, other = self._sides.T
        width = len(self._curvature)
        keys = edge_keys(self._ends[:, 0], self._ends[:, 1], width)
        ends, side = vertices[self._ends], sides[self._sides]
        wanted = edge_keys(ends[:, 0], ends[:, 1], width)
        image = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        is_below = (side.min(axis=1) < 0) & (side.max(axis=1) <= 0) & (ends.min(axis=1) >= 0)
        is_below[is_below] = keys[image[is_below]] == wanted[is_below]
        inner = labels[one] == labels[other]
        inner[is_below] = inner[image[is_below]]
        inner &= ~(is_cut & (side.prod(axis=1) < 0))
        return numbered(topology.connected(self.count, one[inner], other[inner]))[1]

    def absorbed(self, labels: np.ndarray, chosen: np.ndarray, rank: int = 0) -> np.ndarray:
        """Labels of charts, of which some are joined with one beside them. Each is joined with one other chart at most.

        Args:
            labels: (F,) int from 0.
            chosen: (N,) bool, the charts that are joined with others.
            rank: with which: 0 for the one with the most expensive border between them, 1 for the next.
        """
        sides = labels[self._sides]
        beside = sides[:, 0] != sides[:, 1]
        count, pairs = len(chosen), np.concatenate([sides[beside], sides[beside, ::-1]])
        keys, which = np.unique(pairs[:, 0] * count + pairs[:, 1], return_inverse=True)
        prices = np.bincount(which.reshape(-1), np.tile(self._prices[beside], 2), len(keys))
        one, other = np.divmod(keys, max(1, count))
        order = np.lexsort((other, -prices, one))
        starts = np.searchsorted(one[order], one[order])
        order = order[(np.arange(len(order)) - starts == rank) & chosen[one[order]]]
        # The pairs that gain most come first, and take part alone.
        order = order[np.argsort(-prices[order], kind="stable")]
        ends = np.stack([one[order], other[order]], axis=1)
        first = np.full(count, len(order))
        np.minimum.at(first, ends, np.arange(len(order))[:, None])
        joins = (first[ends] == np.arange(len(order))[:, None]).all(axis=1)
        target = np.arange(count)
        target[ends[joins, 0]] = ends[joins, 1]
        return numbered(target[labels])[1]

    def whole(self, labels: np.ndarray) -> np.ndarray:
        """Labels of the connected parts of charts."""
        one, other = self._sides.T
        same = labels[one] == labels[other]
        return numbered(topology.connected(self.count, one[same], other[same]))[1]

    def halved(self, labels: np.ndarray, chosen: np.ndarray, centers: np.ndarray | None = None) -> np.ndarray:
        """Labels after charts, chosen (N,) bool, were divided across where they are longest.

        centers: (F, 2) or (F, 3), where faces are; None for on the surface.
        """
        centers = self.centers if centers is None else centers
        weights = self.areas + 1e-9 * self.areas.mean() + 1e-300
        count = len(chosen)
        total = np.bincount(labels, weights, count)
        away = centers - (sums_of(labels, centers * weights[:, None], count) / total[:, None])[labels]
        size = centers.shape[1]
        squares = np.stack([away[:, i] * away[:, j] * weights for i in range(size) for j in range(size)], axis=1)
        axes = np.linalg.eigh(sums_of(labels, squares, count).reshape(-1, size, size))[1][:, :, -1]
        beyond = chosen[labels] & ((away * axes[labels]).sum(axis=1) > 0.0)
        return self.whole(numbered(np.where(beyond, count + labels, labels))[1])

    def prices(self, labels: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """What borders and split vertices of charts cost (N,), as areas of the surface. nodes: (T, 3) int, UV vertices."""
        count = int(labels.max(initial=-1)) + 1
        of = labels[self.faces]
        border = EdgeTable.of(nodes).alone
        lengths = np.bincount(of[border // 3], self.side_lengths[border], count)
        first = np.unique(nodes, return_index=True)[1]
        return 0.5 * self._margin * lengths + self._split * np.bincount(of[first // 3], minlength=count)

    def between(self, seams: np.ndarray) -> np.ndarray:
        """Labels of the parts that edges (S, 2) divide."""
        one, other = self._sides[~self._is_among(seams)].T
        return numbered(topology.connected(self.count, one, other))[1]

    def seams(self, labels: np.ndarray) -> np.ndarray:
        """The edges to cut (S, 2) int, as vertices: borders, and slits in charts that are neither disks nor flat."""
        return np.concatenate([self._others, self._ends[self._cut(labels)]])

    def nodes(self, labels: np.ndarray, corners: np.ndarray, seams: np.ndarray | None = None) -> np.ndarray:
        """The UV vertex of each corner (C,) int: those that are one along edges that are not cut.

        Args:
            labels: (F,) int.
            corners: (T, 3) int, the corners of triangles, which share them inside faces.
            seams: (S, 2) int, edges that are cut as well; None for none.
        """
        first, last = (side[:, ~self._cut(labels, seams)].reshape(-1) for side in self._joints)
        flat = corners.reshape(-1)
        return topology.connected(int(flat.max(initial=-1)) + 1, flat[first], flat[last])

    def _cut(self, labels: np.ndarray, seams: np.ndarray | None = None) -> np.ndarray:
        inner = labels[self._sides[:, 0]] == labels[self._sides[:, 1]]
        inner &= ~self._is_among(seams)
        cut = ~inner
        cut[inner] = self._slits(labels, inner)
        return cut

    def _inside(self, labels: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which vertices (V,) bool are inside a chart, and in which. inner: the edges inside charts."""
        inside = np.zeros(len(self._curvature), bool)
        inside[self._ends[inner]] = True
        inside[self._others] = inside[self._ends[~inner]] = False
        of = np.zeros(len(inside), np.int64)
        of[self._ends[inner]] = labels[self._sides[inner, :1]]
        return inside, of

    def _euler(self, labels: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """The Euler characteristic (N,) of each chart: 1 of disks, less with holes and handles."""
        count = int(labels.max(initial=-1)) + 1
        inside, of = self._inside(labels, inner)
        edges = np.bincount(labels[self._sides[inner, 0]], minlength=count)
        return np.bincount(labels, minlength=count) - edges + np.bincount(of[inside], minlength=count)

    def is_plate(self, labels: np.ndarray) -> np.ndarray:
        """Which charts (N,) bool are flat with holes."""
        return self.is_flat(labels) & (self._euler(labels, labels[self._sides[:, 0]] == labels[self._sides[:, 1]]) != 1)

    def _is_among(self, edges: np.ndarray | None) -> np.ndarray:
        width = len(self._curvature)
        return _among(edge_keys(self._ends[:, 0], self._ends[:, 1], width), edges, width)

    def _slits(self, labels: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """Which of the inner edges to cut so that charts are disks, and have no spikes inside: the shortest ways to borders."""
        ends, sides, count = self._ends[inner], self._sides[inner], int(labels.max(initial=-1)) + 1
        inside, of = self._inside(labels, inner)
        euler = self._euler(labels, inner)
        spikes = np.flatnonzero(inside & self._is_spike)
        needs = euler != 1
        needs[of[spikes]] = True
        needs &= ~self.is_flat(labels)
        some = np.flatnonzero(needs[labels[sides[:, 0]]])
        result = np.zeros(len(ends), bool)
        if not len(some):
            return result
        ends, sides, lengths = ends[some], sides[some], self._lengths[inner][some]
        lengths = lengths + 1e-6 * lengths.mean() + 1e-300
        spikes = spikes[needs[of[spikes]]]
        roots = ~inside
        open_ended = np.zeros(count, bool)
        open_ended[labels[sides[:, 0][roots[ends].any(axis=1)]]] = True
        closed = numbered(labels[sides[:, 0]][~open_ended[labels[sides[:, 0]]]])[0]
        starts = np.zeros(count, np.int64)
        starts[of[ends[:, 0]]] = ends[:, 0]
        roots[starts[closed]] = True
        distance, parent = _shortest(ends, lengths, roots)
        farthest = np.zeros(0, np.int64)
        if len(closed):
            far = np.zeros(count)
            np.maximum.at(far, of[ends[:, 0]], distance[ends[:, 0]])
            farthest = np.zeros(count, np.int64)
            at = ends[:, 0][distance[ends[:, 0]] >= far[of[ends[:, 0]]]]
            farthest[of[at]] = at
            farthest = farthest[closed]
        is_tree = np.zeros(len(ends), bool)
        is_tree[parent[parent >= 0]] = True
        rest = np.flatnonzero(~is_tree)
        weights = distance[ends[rest]].sum(axis=1) + lengths[rest]
        left = rest[~_longest_forest(sides[rest], weights, self.count)]
        cut = np.zeros(len(ends), bool)
        cut[left] = True
        here = np.unique(np.concatenate([ends[left].reshape(-1), spikes, farthest]))
        while len(here):
            here = here[parent[here] >= 0]
            edges = parent[here]
            cut[edges] = True
            here = np.unique(ends[edges].sum(axis=1) - here)
        result[some] = cut
        return result


class _Growth:
    """Charts that grow, as tables of their pairs, which shrink.

    Attributes:
        of: (N,) int, of the charts at the start, which chart it is now.
    """

    def __init__(self, charts: Charts, labels: np.ndarray, *, is_stiff: bool = False, most: float = np.inf):
        self._bend, self._most = _tilt if is_stiff else _bend, most
        self._sizes = np.bincount(labels)
        self._stays = charts.is_plate(labels)  # others would have to be cut where they meet it
        self.charts, count = charts, int(labels.max(initial=-1)) + 1
        self.of = np.arange(count)
        self._sums = sums_of(labels, charts._sums, count)
        self._pairs = labels[charts._sides]
        self._prices = charts._prices
        self._round = 0
        outside = np.unique(charts._others)
        # Without a border, a chart is closed: the first vertex of one stays outside.
        self._rims = np.zeros(count)
        rim = np.zeros(len(charts._curvature), bool)
        rim[outside] = True
        touched = rim[charts._ends].any(axis=1)
        self._rims += np.bincount(self._pairs[touched].reshape(-1), minlength=count)
        self._inner = np.zeros(count)  # curvature inside
        self._vertex, self._at = charts._vertex, labels[charts._at]
        self._settle()

    def _settle(self) -> None:
        """Drop what lies inside charts, and add up what pairs share."""
        count = len(self._sums)
        low, high = self._pairs.min(axis=1), self._pairs.max(axis=1)
        apart = low != high
        keys, which = np.unique(low[apart] * count + high[apart], return_inverse=True)
        self._prices = np.bincount(which.reshape(-1), self._prices[apart], len(keys))
        self._pairs = np.stack(np.divmod(keys, max(1, count)), axis=1)
        self._keys = keys
        # Vertices between one chart and another, and those inside one.
        keys = np.unique(self._vertex * count + self._at)
        vertex, at = np.divmod(keys, max(1, count))
        starts = np.flatnonzero(np.diff(vertex, prepend=-1))
        sizes = np.diff(starts, append=len(vertex))
        alone = starts[sizes == 1]
        curvature = np.where(self.charts._is_spike, 0.0, self.charts._curvature)
        self._inner += np.bincount(at[alone], curvature[vertex[alone]], count)
        two = starts[sizes == 2]
        index = np.searchsorted(self._keys, at[two] * count + at[np.minimum(two + 1, len(at) - 1)])
        found = index < len(self._keys)
        found[found] &= self._keys[index[found]] == (at[two] * count + at[np.minimum(two + 1, len(at) - 1)])[found]
        index, two = index[found], two[found]
        self._between = np.bincount(index, curvature[vertex[two]], len(self._keys))
        self._spikes = np.bincount(index, self.charts._is_spike[vertex[two]], len(self._keys))
        many = np.repeat(sizes > 1, sizes)
        self._vertex, self._at = vertex[many], at[many]

    def join(self, stretch: float) -> bool:
        """Join the pairs that gain most for both. Returns whether there are any."""
        one, other = self._pairs.T
        if not len(one):
            return False
        sums = self._sums[one] + self._sums[other]
        inner = self._inner[one] + self._inner[other] + self._between
        costs = self._cost(sums, inner)
        costs -= self._cost(self._sums[one], self._inner[one]) + self._cost(self._sums[other], self._inner[other])
        gains = self._prices / (1.0 + self._spikes) - stretch * costs
        degree = np.bincount(self._pairs.reshape(-1), minlength=len(self._sums))
        gains[(degree[one] == 1) & (degree[other] == 1) & (self._rims[one] + self._rims[other] == 0.0)] = 0.0
        gains[self._stays[one] | self._stays[other] | (self._sizes[one] + self._sizes[other] > self._most)] = 0.0
        good = np.flatnonzero(gains > 0.0)
        if not len(good):
            return False
        # Small ones first, so that all grow alike.
        scores = gains[good] / np.sqrt(sums[good, 0] + 1e-300)
        self._round += 1
        noise = (good * 7919 + self._round * 104729) % 1000003
        ranks = np.empty(len(good), np.int64)
        ranks[np.lexsort([noise, np.round(np.log(scores + 1e-300), 3)])] = np.arange(len(good))
        best = np.full(len(self._sums), -1)
        np.maximum.at(best, one[good], ranks)
        np.maximum.at(best, other[good], ranks)
        chosen = good[(best[one[good]] == ranks) & (best[other[good]] == ranks)]
        new = np.arange(len(self._sums))
        new[other[chosen]] = one[chosen]
        kept, new = numbered(new)
        self.of = new[self.of]
        inner_of = self._inner.copy()
        self._sums = sums_of(new, self._sums, len(kept))
        self._inner = np.bincount(new, inner_of, len(kept))
        self._rims = np.bincount(new, self._rims, len(kept))
        self._stays, self._sizes = self._stays[kept], np.bincount(new, self._sizes, len(kept))
        self._pairs, self._at = new[self._pairs], new[self._at]
        self._settle()
        return True

    def _cost(self, sums: np.ndarray, inner: np.ndarray) -> np.ndarray:
        return np.maximum(self._bend(sums), sums[:, 0] * CAP * inner**2)


def best_parts(levels: list[np.ndarray], costs: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The charts that cost least together: each chart of the last level, or parts of it from earlier ones.

    Args:
        levels: labels (F,) int from 0; each chart is a part of one of the next level.
        costs: of the charts of each level.

    Returns:
        The level (F,) int from which each face's chart is, and the new labels (F,).
    """
    best, uses = costs[0], np.zeros(len(levels[0]), np.int64)
    labels = levels[0]
    for number in range(1, len(levels)):
        before, labels = labels, levels[number]
        first = np.unique(before, return_index=True)[1]
        parts = np.bincount(labels[first], best, len(costs[number]))
        whole = costs[number] <= parts
        best = np.where(whole, costs[number], parts)
        uses = np.where(whole[labels], number, uses)
    keys = uses * (max(int(each.max(initial=-1)) for each in levels) + 1) + np.stack(levels)[uses, np.arange(len(uses))]
    return uses, np.unique(keys, return_inverse=True)[1].reshape(-1)


def _bend(sums: np.ndarray) -> np.ndarray:
    """About the area that stretch costs (N,), from the sums of areas, normals and their products (N, 10): the least variance of
    normals along an axis. None in a plane, on a cylinder, on a cone."""
    area = np.maximum(sums[:, 0], 1e-300)
    x, y, z = sums[:, 1:4].T / area
    xx, xy, xz, yy, yz, zz = sums[:, 4:].T / area
    return area * _least_eigenvalue((xx - x * x, yy - y * y, zz - z * z), (xy - x * y, xz - x * z, yz - y * z))


def _tilt(sums: np.ndarray) -> np.ndarray:
    """As _bend, by how much shorter the mean of normals is than they: of a round cap it is about as much."""
    flat = np.linalg.norm(sums[:, 1:4], axis=1)
    return (
        2.0
        / 3.0
        * sums[:, 0]
        * (np.maximum(0.0, sums[:, 0] - flat) / np.maximum(flat, 1e-6 * sums[:, 0] + 1e-300)) ** 2
    )


def _least_eigenvalue(diagonal: tuple[np.ndarray, ...], beside: tuple[np.ndarray, ...]) -> np.ndarray:
    """That of symmetric matrices, not below 0. beside: what is at (0, 1), (0, 2), (1, 2).

    Source: Smith, "Eigenvalues of a symmetric 3 x 3 matrix", 1961.
    """
    mean = sum(diagonal) / 3.0
    a, b, c = (each - mean for each in diagonal)
    d, e, f = beside
    spread = np.sqrt((a * a + b * b + c * c + 2.0 * (d * d + e * e + f * f)) / 6.0)
    safe = np.where(spread > 0.0, spread, 1.0)
    half = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / safe**3
    angle = np.arccos(np.clip(half, -1.0, 1.0)) / 3.0
    return np.maximum(mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0), 0.0)


def _among(keys: np.ndarray, edges: np.ndarray | None, width: int) -> np.ndarray:
    """Which of `keys` are those of edges (N, 2)."""
    if edges is None or not len(edges):
        return np.zeros(len(keys), bool)
    return np.isin(keys, edge_keys(edges[:, 0], edges[:, 1], width))


def _shortest(ends: np.ndarray, lengths: np.ndarray, roots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distance (V,) of vertices from the nearest root along edges, and the edge (V,) int that leads there, -1 at roots."""
    start, stop, length = ends.T.reshape(-1), ends[:, ::-1].T.reshape(-1), np.tile(lengths, 2)
    distance = np.where(roots, 0.0, np.inf)
    while True:
        before = distance.copy()
        np.minimum.at(distance, stop, distance[start] + length)
        if np.array_equal(before, distance):
            break
    parent = np.full(len(roots), -1)
    with np.errstate(invalid="ignore"):
        leads = np.flatnonzero((distance[start] + length == distance[stop]) & (distance[start] < distance[stop]))
    parent[stop[leads]] = leads % len(ends)
    parent[roots] = -1
    return distance, parent


def _longest_forest(pairs: np.ndarray, weights: np.ndarray, count: int) -> np.ndarray:
    """Which edges (E,) bool of nodes (E, 2) are in the spanning forest with the largest weights."""
    ranks = np.empty(len(weights), np.int64)
    ranks[np.argsort(weights, kind="stable")] = np.arange(len(weights))
    chosen, roots = np.zeros(len(pairs), bool), np.arange(count)
    left = np.arange(len(pairs))
    while True:
        one, other = roots[pairs[left]].T
        apart = one != other
        left, one, other = left[apart], one[apart], other[apart]
        if not len(left):
            return chosen
        best = np.full(count, -1)
        np.maximum.at(best, one, ranks[left])
        np.maximum.at(best, other, ranks[left])
        new = (best[one] == ranks[left]) | (best[other] == ranks[left])
        chosen[left[new]] = True
        roots = topology.connected(count, one[new], other[new])[roots]
