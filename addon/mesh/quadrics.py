# SPDX-License-Identifier: GPL-3.0-or-later
"""Squared distances as quadrics of vertices: from planes of triangles, along edges, and of triangles in a pose; and from where
their UVs lie on the surface.

Sources: Garland and Heckbert, "Surface simplification using quadric error metrics", 1997; sums over poses, of Mohr and
Gleicher, "Deformation sensitive decimation", 2003. Here, the quadrics of all poses are brought to the rest pose before they are
added up, so that one place is best for all.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from . import topology
from .topology import EdgeTable
from .triangles import unit, unit_normals

BORDER = 10.0
"""How much the planes along open edges count, as a factor on the square of an edge's length."""

LEAST_UV_AREA = 1e-12
"""The area of a triangle in a layout up to which UVs say nothing about its places."""

Quadrics: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Of vertices: (V, 3, 3), (V, 3) and (V,), so that x A x + 2 b x + c is the sum of squared distances from planes."""


def quadrics_of(
    points: np.ndarray, triangles: np.ndarray, of_faces: np.ndarray, is_inner: np.ndarray | None = None
) -> Quadrics:
    """The quadrics of triangles and open edges.

    Args:
        of_faces: (T,), the weights of triangles.
        is_inner: (V,) bool, the vertices between which open edges are those of a half, and no borders; None for none.
    """
    corners = points[triangles]
    normals, lengths = unit_normals(corners)
    inner = triangles, normals, corners[:, 0], of_faces * lengths / 6.0
    return summed([inner, border_planes(points, triangles, normals, of_faces, is_inner)], len(points))


def border_planes(
    points: np.ndarray,
    triangles: np.ndarray,
    normals: np.ndarray,
    of_faces: np.ndarray,
    is_inner: np.ndarray | None = None,
) -> tuple:
    """Planes through open edges, across their triangles, as `summed` takes them. normals: (T, 3). of_faces, is_inner: as of
    `quadrics_of`."""
    edges = EdgeTable.of(triangles)
    sides = np.sort(edges.alone)
    if is_inner is not None:
        sides = sides[~(is_inner[edges.first[sides]] & is_inner[edges.last[sides]])]
    return side_planes(points, edges, sides, normals, BORDER * of_faces)


def side_planes(
    points: np.ndarray, edges: EdgeTable, sides: np.ndarray, normals: np.ndarray, of_faces: np.ndarray
) -> tuple:
    """As `border_planes`, through some sides (N,) int of edges."""
    face, ends = sides // 3, np.stack([edges.first[sides], edges.last[sides]], axis=1)
    along = points[ends[:, 1]] - points[ends[:, 0]]
    across = unit(np.cross(along, normals[face]))
    return ends, across, points[ends[:, 0]], of_faces[face] * (along**2).sum(axis=1)


def summed(planes: list[tuple], count: int) -> Quadrics:
    """The quadrics of `count` vertices. planes: each of vertices (N, k) int, normals (N, 3), places on them (N, 3), and
    weights (N,)."""
    result = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count)
    for vertices, normal, place, weight in planes:
        distance = -(normal * place).sum(axis=1)
        parts = (
            weight[:, None, None] * normal[:, :, None] * normal[:, None, :],
            (weight * distance)[:, None] * normal,
            weight * distance**2,
        )
        for values, part in zip(result, parts, strict=True):
            for column in vertices.T:
                np.add.at(values, column, part)
    return result


@dataclass(eq=False)
class Mapped:
    """The quadrics of wedges in position and UV: the squares of ways along the surface, from a place to where its UV lies.

    Source: Garland and Heckbert, "Simplifying surfaces with color and texture using quadric error metrics", 1998. There, the
    quadric of a triangle is the distance from its plane in a space of positions and UVs; here, it is the way in the triangle
    from a position to the place that its plane has at a UV, so that it is a distance, whatever the scale of the layout.

    Attributes:
        matrices: (W, 5, 5).
        offsets: (W, 5).
        constants: (W,), so that x A x + 2 b x + c is the sum of squares for positions and UVs x.
    """

    matrices: np.ndarray
    offsets: np.ndarray
    constants: np.ndarray

    @classmethod
    def of(cls, corners: np.ndarray, uv: np.ndarray, wedges: np.ndarray, of_faces: np.ndarray) -> "Mapped":
        """Those of triangles, at each of their corners.

        Args:
            corners: (T, 3, 3).
            uv: (T, 3, 2).
            wedges: (T, 3) int, of corners.
            of_faces: (T,), as in `quadrics_of`. Triangles without an area in the layout do not count.
        """
        normals, lengths = unit_normals(corners)
        uv_edges = uv[:, 1:] - uv[:, :1]
        has_area = np.abs(np.linalg.det(uv_edges)) > LEAST_UV_AREA
        turns = np.linalg.inv(np.where(has_area[:, None, None], uv_edges, np.eye(2)))
        turns = (turns @ (corners[:, 1:] - corners[:, :1])).transpose(0, 2, 1)  # from UVs to positions
        starts = corners[:, 0] - (turns @ uv[:, 0, :, None])[..., 0]
        along = np.eye(3) - normals[:, :, None] * normals[:, None]
        along *= (has_area * of_faces * lengths / 6.0)[:, None, None]
        ways = np.concatenate([np.broadcast_to(np.eye(3), along.shape), -turns], axis=2)
        weighted = ways.transpose(0, 2, 1) @ along
        offsets = (weighted @ starts[..., None])[..., 0]
        constants = np.einsum("ti,tij,tj->t", starts, along, starts)
        count = int(wedges.max(initial=-1)) + 1
        parts = (
            topology.sums_of(wedges.reshape(-1), np.repeat(part.reshape(len(part), -1), 3, axis=0), count)
            for part in (weighted @ ways, -offsets, constants)
        )
        matrices, offsets, constants = parts
        return cls(matrices.reshape(-1, 5, 5), offsets, constants[:, 0])

    def at(self, wedges: np.ndarray, uv: np.ndarray) -> Quadrics:
        """The quadrics of positions of wedges (N,) at UVs (N, 2)."""
        matrices, offsets, constants = self.matrices[wedges], self.offsets[wedges], self.constants[wedges]
        along = np.einsum("nij,nj->ni", matrices[:, :, 3:], uv)
        constants = constants + ((along[:, 3:] + 2.0 * offsets[:, 3:]) * uv).sum(axis=1)
        return matrices[:, :3, :3], along[:, :3] + offsets[:, :3], constants

    def merge(self, target: np.ndarray) -> None:
        """Take wedges for the ones (W,) that they become."""
        gone = np.flatnonzero(target != np.arange(len(target)))
        for values in (self.matrices, self.offsets, self.constants):
            np.add.at(values, target[gone], values[gone])
            values[gone] = 0.0


@dataclass(eq=False)
class Moved:
    """The quadrics of a mesh in a pose, and to where its vertices go there.

    Attributes:
        quadrics: In the pose.
        motions: (V, 3, 4), matrices from the rest pose. What two vertices become has one between theirs, as skin weights are.
    """

    quadrics: Quadrics
    motions: np.ndarray

    @classmethod
    def of(
        cls,
        points: np.ndarray,
        triangles: np.ndarray,
        of_faces: np.ndarray,
        motions: np.ndarray,
        is_inner: np.ndarray | None = None,
    ) -> "Moved":
        """Those of a mesh at rest. of_faces, is_inner: as of `quadrics_of`."""
        posed = (motions[..., :3] @ points[..., None])[..., 0] + motions[..., 3]
        return cls(quadrics_of(posed, triangles, of_faces, is_inner), motions)

    def summed(self, a: np.ndarray, b: np.ndarray) -> Quadrics:
        """The quadrics of what pairs of vertices (E,) and (E,) stand for, for places in the rest pose."""
        planes, offsets, constants = (each[a] + each[b] for each in self.quadrics)
        between = 0.5 * (self.motions[a] + self.motions[b])
        turns, shifts = between[..., :3], between[..., 3]
        turned, along = turns.transpose(0, 2, 1), (planes @ shifts[..., None])[..., 0]
        constants = constants + ((along + 2.0 * offsets) * shifts).sum(axis=1)
        return turned @ planes @ turns, (turned @ (along + offsets)[..., None])[..., 0], constants

    def merge(self, ends: np.ndarray, before: np.ndarray, places: np.ndarray) -> None:
        """Take edges (E, 2) int for their first ends. before: (E, 2, 3), where they are; places: (E, 3), where they go to."""
        a, b = ends.T
        along = before[:, 1] - before[:, 0]
        shares = ((places - before[:, 0]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
        self.motions[a] += np.clip(shares, 0.0, 1.0)[:, None, None] * (self.motions[b] - self.motions[a])
        for values in self.quadrics:
            values[a] += values[b]

    def gather(self, of_vertex: np.ndarray) -> None:
        """Take vertices for what each has become (V,) int, with the mean of their motions."""
        counts = np.maximum(np.bincount(of_vertex, minlength=len(of_vertex)), 1)
        for values in (*self.quadrics, self.motions):
            own = values.copy()
            values[:] = 0.0
            np.add.at(values, of_vertex, own)
        self.motions /= counts[:, None, None]
