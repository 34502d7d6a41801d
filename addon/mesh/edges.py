# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the edges that triangles share, hard edges, and the triangles on the other side of each edge."""

from dataclasses import dataclass

import numpy as np

from . import topology
from .topology import EdgeTable
from .triangle_mesh import Mesh
from .triangles import face_areas, face_normals, unit

LOOKED_AT_FIRST = 1000
"""Triangles that are looked at before all."""
HARD_DEGREES = 1.0
"""An edge is hard from this many degrees between the normals of its sides: files round normals by less."""


@dataclass(frozen=True)
class Sides:
    """The sides of edges: the triangle on either side has one each. Without a partner, `is_same_way` and `others` mean nothing.

    Attributes:
        start: (S,) int, the corner at which a side starts.
        stop: (S,) int, the corner at which it ends.
        across: (S,) int, the triangle's third corner.
        partner: (S,) int, the other side of the edge, -1 if there is none or several.
        is_same_way: (S,) bool, whether the other side runs from the same end to the same end.
        others: two (S,) int, the corners of the other side at `start` and at `stop`.
    """

    start: np.ndarray
    stop: np.ndarray
    across: np.ndarray
    partner: np.ndarray
    is_same_way: np.ndarray
    others: tuple[np.ndarray, np.ndarray]

    def hard(self, mesh: Mesh) -> np.ndarray:
        """Which of them (S,) bool have a partner whose normals differ."""
        pairs = zip((self.start, self.stop), self.others, strict=True)
        differs = [differ(mesh.normals[corner], mesh.normals[other]) for corner, other in pairs]
        return (differs[0] | differs[1]) & (self.partner >= 0)


def sides(mesh: Mesh, *, may_be_hard: bool = False) -> Sides:
    """The sides of all edges. may_be_hard: only of those that may be hard, since a place at an end has several normals: in most
    meshes, these are few."""
    start, stop, across = (np.roll(mesh.triangles, -i, axis=1).reshape(-1) for i in range(3))
    if may_be_hard:
        split = is_split(mesh)
        candidates = np.flatnonzero(split[mesh.vertices[start]] | split[mesh.vertices[stop]])
        start, stop, across = start[candidates], stop[candidates], across[candidates]
    first, second = mesh.vertices[start], mesh.vertices[stop]
    partner = partners(mesh.positions, np.stack([first, second], axis=1))
    is_same_way = (mesh.positions[first[partner]] == mesh.positions[first]).all(axis=1)
    others = np.where(is_same_way, start[partner], stop[partner]), np.where(is_same_way, stop[partner], start[partner])
    return Sides(start, stop, across, partner, is_same_way, others)


def hard_edges(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The edges whose two sides have different normals.

    Returns the vertices of their ends (H, 2) int32, and the cosine (H,) of the angle between their two faces in world space.
    Each edge is listed once per side.
    """
    all_sides = sides(mesh, may_be_hard=True)
    is_hard = all_sides.hard(mesh)
    first, second, third = (mesh.vertices[corner] for corner in (all_sides.start, all_sides.stop, all_sides.across))
    faces = unit(mesh.to_world_normals(face_normals(mesh.positions, np.stack([first, second, third], axis=1))))
    cosines = np.where(all_sides.is_same_way, -1.0, 1.0) * (faces * faces[all_sides.partner]).sum(axis=1)
    return np.stack([first, second], axis=1)[is_hard], cosines[is_hard]


def is_split(mesh: Mesh) -> np.ndarray:
    """Which vertices (V,) bool have several normals, together with other vertices in the same place."""
    places = topology.places(mesh.positions)
    corners = mesh.triangles.reshape(-1)
    place = places[mesh.vertices[corners]]
    any_corner = np.zeros(len(mesh.positions), corners.dtype)
    any_corner[place] = corners
    result = np.zeros(len(mesh.positions), bool)
    result[place[differ(mesh.normals[corners], mesh.normals[any_corner[place]])]] = True
    return result[places]


def differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which rows (N,) bool of two arrays of unit normals (N, 3) differ by more than HARD_DEGREES."""
    between = a - b
    return (between * between).sum(axis=1) > (2.0 * np.sin(np.radians(HARD_DEGREES) / 2.0)) ** 2


def partners(positions: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The other edge (E,) int with the same two vertices as each edge in ends (E, 2), -1 if there is none or several."""
    edges = EdgeTable.of_sides(*ends.T)
    partner, alone = edges.partners, edges.alone
    # Exporters split vertices at seams: an edge without a partner may have one in the same place.
    used, numbers = topology.numbered(ends[alone])
    met = EdgeTable.of_sides(*topology.places(positions[used])[numbers].T).partners
    partner[alone] = np.where(met >= 0, alone[met], -1) if len(alone) else -1
    return partner


NO_AREA = 1e-5
"""Triangles with less area than this share of a square on their longest edge have none: rounding decides their normals."""


def neighbors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangle across the edge from corner k to the next corner, (T, 3) int64, or -1 where the surface ends.

    points (P, 3) float32; triangles (T, 3) int, indices into them. Points in the same place are the same, as exporters split
    vertices at seams. Where more than two triangles meet, each has the next one around, so that all are reached.
    """
    return EdgeTable.of(topology.places(points)[triangles]).neighbors


def has_area(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles (T, 3), indices into points (P, 3) float32, have an area, (T,) bool."""
    corners = points[triangles]
    ahead = np.roll(corners, -1, axis=1)
    along = ahead - corners
    return 2.0 * face_areas(ahead) > NO_AREA * (along * along).sum(axis=2).max(axis=1)


def is_without_area(mesh: Mesh) -> bool:
    """Whether all triangles of a mesh are points or lines."""
    triangles = mesh.vertices[mesh.triangles]
    with np.errstate(over="ignore", invalid="ignore"):
        if has_area(mesh.positions, triangles[:LOOKED_AT_FIRST]).any():  # as nearly always
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
    beyond = neighbors(points, triangles[kept])
    across[flat], across[kept] = -1, np.where(beyond >= 0, kept[beyond] if len(kept) else -1, -1)
    return across, nearest
