# SPDX-License-Identifier: GPL-3.0-or-later
"""Straightens UV islands that are grids of quads, as straps, rims and pipes, to rectangles.

An island is a grid if it is a disk of quads with four corners where one of them is, and with four around each vertex inside.
Edges that go on straight through vertices make lines; lines on both sides of a quad are neighbors, and the neighbors make two
paths of lines, across each other. How far lines are apart is the mean length of the edges between them.
"""

from dataclasses import dataclass

import numpy as np

from . import topology, uv_stretch
from .topology import EdgeTable
from .triangle_mesh import Mesh

COST = 0.02
"""An island is straightened if a map of it alone then needs at most so many more texels, as a share, to be as sharp."""


def straighten(mesh: Mesh, uv: np.ndarray, nodes: np.ndarray, islands: np.ndarray) -> np.ndarray:
    """UVs (C, 2) float64 of which islands that are grids of quads are rectangles along u and v, where that costs little.

    Rectangles have the area of their island before and the same middle. Islands that are mirrored stay as they are.

    Args:
        mesh: with faces, each with its corners in a row, in order.
        uv: (C, 2), of its corners.
        nodes: (C,) int from 0, the UV vertex of each corner: corners that share it are connected.
        islands: (T,) int from 0, the island of each triangle.
    """
    uv = uv.astype(np.float64)
    grids = _grids(mesh, nodes, islands)
    if grids is None:
        return uv
    changed = uv.copy()
    changed[grids.corners] = _rectangles(mesh.positions[mesh.vertices].astype(np.float64), uv, grids)
    points = mesh.positions[mesh.vertices[mesh.triangles]]
    before, after = (uv_stretch.needs(points, x[mesh.triangles], islands) for x in (uv, changed))
    is_better = ~after.is_folded & (after.need**2 <= before.need**2 * (1.0 + COST))
    kept = grids.corners[~is_better[np.repeat(grids.islands, 4)]]
    changed[kept] = uv[kept]
    return changed


@dataclass(frozen=True, eq=False)
class _Grids:
    """Islands that are grids of quads.

    Attributes:
        islands: (Q,) int, the island of each quad.
        corners: (4 Q,) int, the corners of quads.
        places: (4 Q, 2) int, the line along each axis that each corner is on, from 0.
        sides: (4 Q,) int, the axis along which the side from each corner to the next one runs.
    """

    islands: np.ndarray
    corners: np.ndarray
    places: np.ndarray
    sides: np.ndarray


def _grids(mesh: Mesh, nodes: np.ndarray, islands: np.ndarray) -> _Grids | None:
    """The islands that are grids; None if there is none."""
    faces = int(mesh.faces.max(initial=-1)) + 1
    corners = np.unique(mesh.triangles)
    owner = np.zeros(len(mesh.vertices), np.int64)
    owner[mesh.triangles] = mesh.faces[:, None]
    of_faces, count = np.zeros(faces, np.int64), int(islands.max(initial=-1)) + 1
    of_faces[mesh.faces] = islands
    sizes = np.bincount(owner[corners], minlength=faces)
    is_grid = np.bincount(of_faces[sizes > 0], (sizes != 4)[sizes > 0], count) == 0.0
    corners = corners[is_grid[of_faces[owner[corners]]]]
    if not len(corners):
        return None
    of = of_faces[owner[corners[::4]]]
    used, nodes = topology.numbered(nodes[corners])
    edges = EdgeTable.of_sides(nodes, np.roll(nodes.reshape(-1, 4), -1, axis=1).reshape(-1))
    is_grid &= _are_grids(edges, nodes, of, len(used), count)
    chosen = np.repeat(is_grid[of], 4)
    if not chosen.any():
        return None
    lines, neighbors = _lines(edges, chosen)
    place, path = _order(neighbors, len(edges.counts))
    # Lines of one path are across the first axis, where each has its place; those of the other are along it.
    first = np.full(count, len(edges.counts))
    of_sides = np.repeat(of, 4)
    np.minimum.at(first, of_sides[chosen], path[lines[chosen]])
    axis = (path[lines] == first[of_sides]).astype(np.int64)
    places = np.zeros((len(used), 2), np.int64)
    for ends in (edges.first, edges.last):
        places[ends[chosen], 1 - axis[chosen]] = place[lines[chosen]]
    return _Grids(of[chosen[::4]], corners[chosen], places[nodes[chosen]], axis[chosen])


def _are_grids(edges: EdgeTable, nodes: np.ndarray, of: np.ndarray, points: int, count: int) -> np.ndarray:
    """Which islands (count,) bool are disks of quads with the right number at each point. nodes: (4 Q,) int of `points`. of:
    (Q,) int, the island of each quad."""
    around = np.bincount(nodes, minlength=points)
    alone = edges.alone
    borders = np.bincount(edges.first[alone], minlength=points) + np.bincount(edges.last[alone], minlength=points)
    is_right = np.where(borders == 0, around == 4, (borders == 2) & (around <= 2))
    is_bad_edge = edges.counts > 2
    is_bad_edge[edges.counts == 2] = edges.is_against
    island_of = np.zeros(points, np.int64)
    island_of[nodes] = np.repeat(of, 4)
    quads, vertices = np.bincount(of, minlength=count), np.bincount(island_of, minlength=count)
    of_edges = np.repeat(of, 4)[edges.sides[edges.begins]]
    characteristic = vertices - np.bincount(of_edges, minlength=count) + quads
    faults = np.bincount(island_of, ~is_right, count) + np.bincount(of_edges, is_bad_edge, count)
    return (faults == 0.0) & (characteristic == 1)  # so that there are four corners


def _lines(edges: EdgeTable, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The line (S,) int of each side, an edge of it; and the lines (N, 2) int that are on both sides of quads.

    chosen: (S,) bool, the sides of grids.
    """
    sides = np.flatnonzero(chosen)
    following = sides - sides % 4 + (sides + 1) % 4
    across = edges.partners[following]
    goes_on = across >= 0
    straight = across[goes_on] - across[goes_on] % 4 + (across[goes_on] + 1) % 4
    numbers = edges.numbers
    lines = topology.connected(len(edges.counts), numbers[sides[goes_on]], numbers[straight])[numbers]
    quads = lines.reshape(-1, 4)[chosen[::4]]
    pairs = np.sort(np.concatenate([quads[:, [0, 2]], quads[:, [1, 3]]]), axis=1)
    return lines, np.unique(pairs, axis=0)


def _order(pairs: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The place (count,) int of each node in its path, from the end with the lower number, and this end.

    Steps from a node to the next one are followed by twice as many in each round.

    Args:
        pairs: (N, 2) int, the neighbors in paths, each once.
        count: of the nodes.
    """
    start, end = np.concatenate([pairs, pairs[:, ::-1]]).T
    steps = np.arange(len(start))
    back = (steps + len(pairs)) % len(start)
    # After a step comes the other one from where it ends; after one to the end of a path comes none.
    sums = np.bincount(start, steps, count).astype(np.int64)
    is_end = np.bincount(start, minlength=count) == 1
    following = np.where(is_end[end], steps, sums[end] - back)
    length = np.where(is_end[end], 0, 1)
    while (following[following] != following).any():
        length = length + length[following]
        following = following[following]
    place, first = np.zeros(count, np.int64), np.where(is_end, np.arange(count), count)
    last = end[following]
    np.minimum.at(first, start, last)
    is_down = last == first[start]
    place[start[is_down]] = length[is_down] + 1
    return place, first


def _rectangles(points: np.ndarray, uv: np.ndarray, grids: _Grids) -> np.ndarray:
    """The UVs (4 Q, 2) of the corners of grids as rectangles. points: (C, 3) of all corners, uv: (C, 2)."""
    next_one = np.roll(grids.corners.reshape(-1, 4), -1, axis=1).reshape(-1)
    lengths = np.linalg.norm(points[next_one] - points[grids.corners], axis=1)
    of = np.repeat(grids.islands, 4)
    count = int(of.max()) + 1
    flat = np.empty((len(of), 2))
    for axis in range(2):
        place = grids.places[:, axis]
        most = int(place.max()) + 1
        step = np.minimum(place, np.roll(place.reshape(-1, 4), -1, axis=1).reshape(-1))
        along = grids.sides == axis
        keys = of[along] * most + step[along]
        number = np.bincount(keys, minlength=count * most)
        steps = np.bincount(keys, lengths[along], count * most) / np.maximum(number, 1)
        ends = np.cumsum(steps.reshape(count, most), axis=1)
        flat[:, axis] = (ends - steps.reshape(count, most))[of, place]
    before, after = (_areas(x, of) for x in (uv[grids.corners], flat))
    flat[:, 0] *= np.where(before * after < 0.0, -1.0, 1.0)[of]
    flat *= np.sqrt(np.abs(before) / np.where(after == 0.0, 1.0, np.abs(after)))[of][:, None]
    number = np.maximum(np.bincount(of), 1)
    for axis in range(2):
        shift = (np.bincount(of, uv[grids.corners, axis]) - np.bincount(of, flat[:, axis])) / number
        flat[:, axis] += shift[of]
    return flat


def _areas(uv: np.ndarray, of: np.ndarray) -> np.ndarray:
    """The area of each island, negative if it is turned over. uv: (4 Q, 2), of: (4 Q,) int."""
    a, b, c, d = np.moveaxis(uv.reshape(-1, 4, 2), 1, 0)
    one, other = c - a, d - b
    return np.bincount(of[::4], 0.5 * (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]))
