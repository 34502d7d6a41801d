# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the edges that triangles share, hard edges, and the triangles on the other side of each edge."""

from dataclasses import dataclass

import numpy as np

from .triangle_mesh import Mesh
from .uv_islands import hashes

FIRST = 1000
"""Triangles that are looked at before all."""
HARD = 1.0
"""An edge is hard from this many degrees between the normals of its sides: files round normals by less."""


@dataclass(frozen=True)
class Sides:
    """The sides of edges: the triangle on either side has one each. S are those of places with several normals.

    start, stop, across (S,) int: the corners at the two ends, and the triangle's third one. partner (S,) int: the other side of
    the edge, -1 if there is none or several. is_same_way (S,) bool: whether the other side runs from the same end to the same
    end. others: two (S,) int, the corners of the other side at `start` and at `stop`. is_hard (S,) bool: whether the normals of
    the two sides differ. Without a partner, the last three mean nothing.
    """

    start: np.ndarray
    stop: np.ndarray
    across: np.ndarray
    partner: np.ndarray
    is_same_way: np.ndarray
    others: tuple[np.ndarray, np.ndarray]
    is_hard: np.ndarray


def sides(mesh: Mesh) -> Sides:
    """The sides of all edges that may be hard."""
    start, stop, across = (np.roll(mesh.triangles, -i, axis=1).reshape(-1) for i in range(3))
    # An edge can be hard only where one place has several normals: in most meshes that leaves few edges to test.
    split = is_split(mesh)
    candidates = np.flatnonzero(split[mesh.vertices[start]] | split[mesh.vertices[stop]])
    start, stop, across = start[candidates], stop[candidates], across[candidates]
    first, second = mesh.vertices[start], mesh.vertices[stop]
    partner = partners(mesh.positions, np.stack([first, second], axis=1))
    is_same_way = (mesh.positions[first[partner]] == mesh.positions[first]).all(axis=1)
    others = np.where(is_same_way, start[partner], stop[partner]), np.where(is_same_way, stop[partner], start[partner])
    is_hard = np.zeros(len(partner), bool)
    for corner, other in zip((start, stop), others, strict=True):
        is_hard |= differ(mesh.normals[corner], mesh.normals[other])
    return Sides(start, stop, across, partner, is_same_way, others, is_hard)


def hard_edges(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The edges whose two sides have different normals.

    Returns the vertices of their ends (H, 2) int32, and the cosine (H,) of the angle between their two faces in world space.
    Each edge is listed once per side.
    """
    found = sides(mesh)
    is_hard = found.is_hard & (found.partner >= 0)
    first, second, third = (mesh.vertices[corner] for corner in (found.start, found.stop, found.across))
    a, b, c = (mesh.positions[vertex] for vertex in (first, second, third))
    faces = mesh.to_world_normals(np.cross(b - a, c - a))
    faces /= np.maximum(np.linalg.norm(faces, axis=1, keepdims=True), np.finfo(np.float32).tiny)
    cosines = np.where(found.is_same_way, -1.0, 1.0) * (faces * faces[found.partner]).sum(axis=1)
    return np.stack([first, second], axis=1)[is_hard], cosines[is_hard]


def is_split(mesh: Mesh) -> np.ndarray:
    """Which vertices (V,) bool have several normals, together with other vertices in the same place."""
    places = np.unique(hashes(mesh.positions + np.float32(0.0)), return_inverse=True)[1]
    corners = mesh.triangles.reshape(-1)
    place = places[mesh.vertices[corners]]
    any_corner = np.zeros(len(mesh.positions), corners.dtype)
    any_corner[place] = corners
    result = np.zeros(len(mesh.positions), bool)
    result[place[differ(mesh.normals[corners], mesh.normals[any_corner[place]])]] = True
    return result[places]


def differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which rows (N,) bool of two arrays of unit normals (N, 3) differ by more than HARD."""
    between = a - b
    return (between * between).sum(axis=1) > (2.0 * np.sin(np.radians(HARD) / 2.0)) ** 2


def partners(positions: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The other edge (E,) int with the same two vertices as each edge in ends (E, 2), -1 if there is none or several."""
    partner, is_alone = _paired(ends)
    alone = np.flatnonzero(is_alone)
    # Exporters split vertices at seams: an edge without a partner may have one in the same place.
    used, ends = np.unique(ends[alone], return_inverse=True)
    places = np.unique(positions[used], axis=0, return_inverse=True)[1]
    met, _ = _paired(places.reshape(-1)[ends.reshape(-1, 2)])
    partner[alone] = np.where(met >= 0, alone[met], -1) if len(alone) else -1
    return partner


def _paired(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The only other edge with the same ends, (E,) int64 or -1, and which edges have none, (E,) bool."""
    low, high = ends.min(axis=1), ends.max(axis=1)
    keys = low.astype(np.int64) * (high.max(initial=0) + 1) + high
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    count = np.diff(first, append=len(keys))
    pairs = first[(count == 2) & (low != high)[order[first]]]
    left, right = order[pairs], order[pairs + 1]
    partner, is_alone = np.full(len(keys), -1), np.zeros(len(keys), bool)
    partner[left], partner[right] = right, left
    is_alone[order[first[count == 1]]] = True
    return partner, is_alone


NO_AREA = 1e-5
"""Triangles with less area than this share of a square on their longest edge have none: rounding decides their normals."""


def neighbors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangle across the edge from corner k to the next corner, (T, 3) int64, or -1 where the surface ends.

    points (P, 3) float32; triangles (T, 3) int, indices into them. Points in the same place are the same, as exporters split
    vertices at seams. Where more than two triangles meet, each has the next one around, so that all are reached.
    """
    places = np.unique(hashes(points + np.float32(0.0)), return_inverse=True)[1].reshape(-1)[triangles]
    first, last = places.reshape(-1), np.roll(places, -1, axis=1).reshape(-1)
    keys = np.minimum(first, last) * np.int64(len(points)) + np.maximum(first, last)
    order = np.argsort(keys, kind="stable")
    begins = np.flatnonzero(np.diff(keys[order], prepend=-1))
    counts = np.diff(begins, append=len(keys))
    following = np.arange(1, len(keys) + 1)
    following[begins + counts - 1] = begins  # the last one of a run is followed by the first
    result = np.empty(len(keys), np.int64)
    result[order] = order[following] // 3
    result[order[begins[counts == 1]]] = -1
    result[first == last] = -1
    return result.reshape(-1, 3)


def has_area(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles (T, 3), indices into points (P, 3) float32, have an area, (T,) bool."""
    corners = points[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return areas > NO_AREA * (edges * edges).sum(axis=2).max(axis=1)


def is_without_area(mesh: Mesh) -> bool:
    """Whether all triangles of a mesh are points or lines."""
    triangles = mesh.vertices[mesh.triangles]
    with np.errstate(over="ignore", invalid="ignore"):
        if has_area(mesh.positions, triangles[:FIRST]).any():  # as nearly always
            return False
    # Squares of tiny lengths are 0 in single precision, and those of large ones are infinite.
    return not has_area(mesh.positions.astype(np.float64), triangles).any()


def past_flat(points: np.ndarray, triangles: np.ndarray, has_area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbors for walks, which cannot cross a triangle without area: it has no sides to choose from.

    Returns `neighbors` as if such triangles were not there, and a triangle with area at each one, (T,) int64: itself, or a
    neighbor. Without any it stays itself.
    """
    across, nearest = neighbors(points, triangles), np.arange(len(triangles))
    flat = np.flatnonzero(~has_area)
    if not len(flat):
        return across, nearest
    corners, beside = points[triangles[flat]], across[flat]
    fits = (beside >= 0) & has_area[beside]
    # All of a triangle without area lies on its longest edge.
    lengths = ((np.roll(corners, -1, axis=1) - corners) ** 2).sum(axis=2)
    longest = np.where(fits, lengths, -1.0).argmax(axis=1)
    nearest[flat] = np.where(fits.any(axis=1), beside[np.arange(len(flat)), longest], flat)
    kept = np.flatnonzero(has_area)
    found = neighbors(points, triangles[kept])
    across[flat], across[kept] = -1, np.where(found >= 0, kept[found] if len(kept) else -1, -1)
    return across, nearest
