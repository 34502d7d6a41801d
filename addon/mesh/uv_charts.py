# SPDX-License-Identifier: GPL-3.0-or-later
"""Divides a surface into charts for a UV map: pieces that lie flat with little stretch and have short borders.

Source: Garland, Willmott and Heckbert, "Hierarchical face clustering on polygonal surfaces", 2001, join neighbors from single
faces on, the cheapest first; Sander, Snyder, Gortler and Hoppe, "Texture mapping progressive meshes", 2001, do so with a price
on borders and make them straight. Here, gains are areas of the map, and each chart stays a disk.
"""

import heapq
from dataclasses import dataclass

import numpy as np

from .topology import EdgeTable, edge_keys, numbered, sums_of
from .triangles import checked, face_normals

FLATTEST = 0.4
"""The least length of the mean of a chart's normals: a half sphere has 0.5, half a cylinder without its ends 0.64."""
SWEEPS = 8
"""How often borders are made shorter, at most."""
TINY = 1e-30
"""A chart whose normals cancel out bends without limit, nearly."""

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class ChartOptions:
    """What `chart` makes.

    Attributes:
        margin: around charts, as a share of the map's side: what borders cost.
        stretch: how much stretch counts, against borders: 100 for tiny charts, 1 for small ones, 0.1 for large ones.
        faces: (T,) int from 0, the face of each triangle, which stays whole; None for each by itself.
        hard: (H, 2) int, the vertices of edges that must be seams, as those where normals break; None for none.
    """

    margin: float = 1.0 / 256.0
    stretch: float = 1.0
    faces: np.ndarray | None = None
    hard: np.ndarray | None = None


def chart(
    points: np.ndarray, triangles: np.ndarray, options: ChartOptions = ChartOptions()
) -> tuple[np.ndarray, np.ndarray]:
    """Divide a surface into charts that are disks.

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
    faces = np.arange(len(triangles)) if options.faces is None else np.asarray(options.faces)
    charts = Charts(points, triangles, faces, options.margin, options.hard)
    charts.grow(options.stretch)
    count = int(faces.max(initial=-1)) + 1
    return numbered(charts.of_faces())[1][faces], charts.seams(np.full(count, charts.steps))


class Charts:
    """Charts that grow: the two neighbors that gain the most are joined, from single faces on.

    Joining spares the map the margins along a border, and costs stretch. Both are areas of the surface, so that they compare.
    Each chart is a disk once it is cut along its seams, some of which are slits inside it.

    edges (E, 2) int: their vertices, the lower one first.
    """

    def __init__(
        self, points: np.ndarray, corners: np.ndarray, faces: np.ndarray, margin: float, hard: np.ndarray | None = None
    ):
        """Begin with each face by itself.

        Args:
            points: (V, 3).
            corners: (T, 3) int, the vertices of triangles.
            faces: (T,) int from 0, the face of each triangle.
            margin: around charts, as a share of the map's side.
            hard: (H, 2) int, the vertices of edges that must be seams: those where normals break.
        """
        count = int(faces.max(initial=-1)) + 1
        points = points.astype(np.float64)
        normals = 0.5 * face_normals(points, corners)
        areas = np.linalg.norm(normals, axis=1)
        sums = sums_of(faces, normals, count)
        self._border = 2.0 * margin * float(areas.sum()) ** 0.5
        # Of each chart; those that were joined stay in the lists, without neighbors.
        self._is_left: list[bool] = [True] * count
        self._areas: list[float] = np.bincount(faces, areas, count).tolist()
        self._normals: list[Vector] = [(x, y, z) for x, y, z in sums.tolist()]
        self._neighbors: list[dict[int, list[int]]] = [{} for _ in range(count)]
        self._parents: list[int] = list(range(count))
        self._of_faces = self._areas.copy(), self._normals.copy()
        self._read_edges(points, corners, faces, np.zeros((0, 2), int) if hard is None else hard)

    def _read_edges(self, points: np.ndarray, corners: np.ndarray, faces: np.ndarray, hard: np.ndarray) -> None:
        edges = EdgeTable.of(corners, len(points))
        self.edges = edges.ends
        first, second = edges.sides[edges.begins], edges.sides[np.minimum(edges.begins + 1, len(edges.sides) - 1)]
        sides = np.stack([faces[first // 3], faces[second // 3]], axis=1)
        # Faces on both sides of an edge run along it in opposite directions, unless one of them shows its back.
        joins = (
            (edges.counts == 2) & (edges.first[first] == edges.last[second]) & (edges.first[first] != edges.last[first])
        )
        joins &= ~np.isin(edges.keys, edge_keys(hard[:, 0], hard[:, 1], len(points)))
        self._seams = [~(joins & (sides[:, 0] == sides[:, 1]))]
        self._is_seam: list[bool] = self._seams[0].tolist()
        self._lengths = np.linalg.norm(points[self.edges[:, 0]] - points[self.edges[:, 1]], axis=1).tolist()
        self._ends = self.edges.tolist()
        self._sides: list[list[int]] = sides.tolist()
        self._at: list[set[int]] = [set() for _ in range(len(points))]  # the seams at each vertex
        self._around: list[list[int]] = [[] for _ in range(len(self._areas))]  # the edges around each face
        self._slits: set[int] = set()
        for edge, joined in zip(np.flatnonzero(self._seams[0]).tolist(), joins[self._seams[0]].tolist(), strict=True):
            for vertex in self._ends[edge]:
                self._at[vertex].add(edge)
            one, other = self._sides[edge]
            if joined:
                self._neighbors[one].setdefault(other, []).append(edge)
                self._neighbors[other].setdefault(one, []).append(edge)
                self._around[one].append(edge)
                self._around[other].append(edge)
            else:  # nothing joins it
                self._sides[edge] = [-1, -1]
        for edge, one in zip(edges.numbers.tolist(), np.repeat(faces, 3).tolist(), strict=True):
            if self._sides[edge][0] < 0:
                self._around[one].append(edge)

    @property
    def steps(self) -> int:
        """How many times the charts have grown."""
        return len(self._seams) - 1

    @property
    def count(self) -> int:
        """How many charts there are."""
        return sum(self._is_left)

    def of_faces(self) -> np.ndarray:
        """The chart (F,) int of each face."""
        return np.array([self._chart(face) for face in range(len(self._around))], int)

    def seams(self, steps: np.ndarray) -> np.ndarray:
        """The edges to cut, (S, 2) int, as vertices. steps (F,) int: after how many steps, for each face; 0 is by itself."""
        if not len(steps):
            return self.edges
        seams, (one, other) = np.stack(self._seams), np.array(self._sides).reshape(-1, 2).T
        every = np.arange(len(seams[0]))
        return self.edges[seams[steps[one], every] | seams[steps[other], every]]

    def grow(self, stretch: float) -> None:
        """Join neighbors as long as it pays, and make borders shorter. stretch: how much it counts, less from step to step."""
        heap: list[tuple[float, int, int]] = []
        for one, around in enumerate(self._neighbors):
            for other in around:
                if one < other:
                    self._offer(heap, one, other, stretch)
        while heap:
            _, one, other = heapq.heappop(heap)
            if self._is_left[one] and self._is_left[other]:
                new = self._join(one, other)
                for neighbor in self._neighbors[new]:
                    self._offer(heap, neighbor, new, stretch)
        for _ in range(SWEEPS):
            if not sum(self._move(face, stretch) for face in range(len(self._around))):
                break
        self._seams.append(np.array(self._is_seam))

    def _offer(self, heap: list[tuple[float, int, int]], one: int, other: int, stretch: float) -> None:
        """Put a pair on the heap if joining it pays."""
        area, normal = self._areas[one] + self._areas[other], _sum(self._normals[one], self._normals[other])
        if _length(normal) >= FLATTEST * area:
            cost = _bend(area, normal) - self._bend(one) - self._bend(other)
            gain = self._length(self._path(self._neighbors[one][other])) * self._border - stretch * cost
            if gain > 0.0:
                heapq.heappush(heap, (-gain, one, other))

    def _bend(self, chart: int) -> float:
        return _bend(self._areas[chart], self._normals[chart])

    def _length(self, edges: list[int]) -> float:
        return sum([self._lengths[edge] for edge in edges])

    def _path(self, edges: list[int]) -> list[int]:
        """The longest path of edges whose ends alone touch other seams: joined along it, two disks are a disk."""
        if len(edges) == 1:
            return edges
        left, best, most = set(edges), [], -1.0
        while left:
            edge = left.pop()
            path = [edge]
            for end in self._ends[edge]:
                vertex, last = end, edge
                while len(self._at[vertex]) == 2:
                    (following,) = self._at[vertex] - {last}
                    if following not in left:
                        break
                    left.discard(following)
                    path.append(following)
                    vertex, last = self._other_end(following, vertex), following
            length = self._length(path)
            if length > most:
                best, most = path, length
        return best

    def _other_end(self, edge: int, vertex: int) -> int:
        a, b = self._ends[edge]
        return b if a == vertex else a

    def _join(self, one: int, other: int) -> int:
        """Join two neighbors. Returns the new chart."""
        new = len(self._neighbors)
        shared = self._neighbors[one][other]
        path = self._path(shared)
        self._slits.update(shared)
        for edge in path:
            self._heal(edge)
        for vertex in {vertex for edge in path for vertex in self._ends[edge]}:
            self._close(vertex)
        self._areas.append(self._areas[one] + self._areas[other])
        self._normals.append(_sum(self._normals[one], self._normals[other]))
        self._parents.append(new)
        few, many = sorted((self._neighbors[one], self._neighbors[other]), key=len)
        for neighbor, edges in few.items():
            many[neighbor] = many.get(neighbor, []) + edges
        for chart in (one, other):
            many.pop(chart, None)
            self._neighbors[chart], self._is_left[chart] = {}, False
            self._parents[chart] = new
        self._neighbors.append(many)
        self._is_left.append(True)
        for neighbor, edges in many.items():
            around = self._neighbors[neighbor]
            around.pop(one, None)
            around.pop(other, None)
            around[new] = edges
        return new

    def _heal(self, edge: int) -> None:
        self._is_seam[edge] = False
        self._slits.discard(edge)
        for vertex in self._ends[edge]:
            self._at[vertex].discard(edge)

    def _close(self, vertex: int) -> None:
        """Close a slit from an end that nothing holds open any more."""
        while len(self._at[vertex]) == 1:
            (edge,) = self._at[vertex]
            if edge not in self._slits:
                break
            self._heal(edge)
            vertex = self._other_end(edge, vertex)

    def _move(self, face: int, stretch: float) -> bool:
        """Move a face to another chart if only one edge holds it, and that pays: borders that zigzag become straight."""
        held = [edge for edge in self._around[face] if not self._is_seam[edge]]
        if len(held) != 1 or len(self._around[face]) < 3:
            return False
        seams = [edge for edge in self._around[face] if self._is_seam[edge]]
        others = {self._across(edge, face) for edge in seams}
        old, (new,) = self._chart(face), others if len(others) == 1 else (-1,)
        if new in {old, -1}:
            return False
        ends = set(self._ends[held[0]])
        if any(len(self._at[vertex]) != 2 for edge in seams for vertex in self._ends[edge] if vertex not in ends):
            return False  # the face is not all that parts the other chart from itself
        areas, normals = self._of_faces
        smaller = self._areas[old] - areas[face], _difference(self._normals[old], normals[face])
        larger = self._areas[new] + areas[face], _sum(self._normals[new], normals[face])
        cost = _bend(*smaller) + _bend(*larger) - self._bend(old) - self._bend(new)
        if (self._length(seams) - self._length(held)) * self._border - stretch * cost <= 0.0:
            return False
        (self._areas[old], self._normals[old]), (self._areas[new], self._normals[new]) = smaller, larger
        for edge in seams:
            self._heal(edge)
        self._is_seam[held[0]] = True
        for vertex in ends:
            self._at[vertex].add(held[0])
        edges = [edge for edge in self._neighbors[old][new] if edge not in seams] + held
        self._neighbors[old][new] = self._neighbors[new][old] = edges
        self._parents[face] = new
        return True

    def _across(self, edge: int, face: int) -> int:
        """The chart on the other side of an edge of a face, or -1."""
        one, other = self._sides[edge]
        return -1 if one < 0 else self._chart(other if one == face else one)

    def _chart(self, piece: int) -> int:
        """The chart that a face, or a former chart, is a part of."""
        while self._parents[piece] != piece:
            self._parents[piece] = self._parents[self._parents[piece]]
            piece = self._parents[piece]
        return piece


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _difference(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _length(a: Vector) -> float:
    return (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) ** 0.5


def _bend(area: float, normal: Vector) -> float:
    """About the area that stretch costs, from the sum of a chart's normals: none where flat, all of it on a half sphere."""
    flat = _length(normal)
    return area * (max(0.0, area - flat) / max(flat, TINY)) ** 2
