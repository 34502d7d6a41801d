# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles that close holes of high meshes, for bakes onto low meshes that have no holes there.

Without them, rays would go through the holes and hit the far side of the high meshes from inside.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .closest import Surface
from .inputs import Meshes
from .triangle_mesh import Mesh
from .triangles import barycentric, transformed, unit, vertex_normals

AROUND = np.stack(np.meshgrid(*3 * [[-1, 0, 1]], indexing="ij"), axis=-1).reshape(-1, 3)
"""A cell and those beside it (27, 3)."""
SMALLEST_CELL = 1e-6
"""Of a grid, as a share of its side, so that the numbers of all cells are below 2^63."""


@dataclass(frozen=True, eq=False)
class Closing:
    """Triangles that close holes, in world space. The first two corners of each are at the border of its hole.

    Attributes:
        corners: (N, 3, 3) float64.
        normals: (N, 3, 3), to shade them by.
    """

    corners: np.ndarray
    normals: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, triangles: np.ndarray, first: int) -> "Closing":
        """The triangles from the first one on of a surface that has no holes any more.

        Args:
            points: (V, 3), in world space.
            triangles: (T, 3) int, with shared vertices.
        """
        own = triangles[first:]
        around = triangles[np.isin(triangles, own).any(axis=1)]
        return cls(points[own].astype(np.float64), vertex_normals(points, around)[own])

    def moved(self, by: np.ndarray) -> "Closing":
        """These triangles in another place. by: (3,)."""
        return replace(self, corners=self.corners + by)

    def added_to(self, meshes: Meshes) -> Meshes:
        """The meshes of a bake, with these among the high ones."""
        return replace(meshes, highs=[*meshes.highs, *self.of_highs(meshes.highs)])

    def of_highs(self, highs: Sequence[Mesh]) -> list[Mesh]:
        """These triangles as meshes, one for each high mesh that has borders of holes.

        Each takes the material, the UVs and all else that is not its shape from the triangle at its border, so that colors of
        the border run inwards.
        """
        middles, border = self.corners[:, :2].mean(axis=1), self.corners[:, :2].reshape(-1, 3)
        longest = float(np.linalg.norm(self.corners[:, 1] - self.corners[:, 0], axis=1).max())
        cell = max(longest, SMALLEST_CELL * float(np.ptp(border, axis=0).max()))
        near = [_near(high, border, cell) for high in highs]
        squares = np.full((len(highs), len(middles)), np.inf)
        found = np.zeros(squares.shape, int)
        for number, (high, rows) in enumerate(zip(highs, near, strict=True)):
            if len(rows):
                corners = _places(high, rows) - middles[0]
                surface = Surface(corners.reshape(-1, 3).astype(np.float32), np.arange(3 * len(rows)).reshape(-1, 3))
                closest, _, squares[number] = surface.closest((middles - middles[0]).astype(np.float32))
                found[number] = rows[closest]
        owner, is_known = squares.argmin(axis=0), np.isfinite(squares).any(axis=0)
        chosen = [np.flatnonzero(is_known & (owner == number)) for number in range(len(highs))]
        return [
            self._of(high, some, found[number, some])
            for number, (high, some) in enumerate(zip(highs, chosen, strict=True))
            if len(some)
        ]

    def _of(self, high: Mesh, some: np.ndarray, rows: np.ndarray) -> Mesh:
        """Some of the triangles, which take what they have besides a shape from triangles of a mesh. rows: (N,) int, these."""
        count, linear = len(some), high.to_world[:3, :3]
        places = np.repeat(_places(high, rows), 2, axis=0)
        weights = barycentric(self.corners[some, :2].reshape(-1, 3), places).reshape(count, 2, 3)
        weights = np.concatenate([weights, weights.mean(axis=1, keepdims=True)], axis=1)

        def taken(values: np.ndarray) -> np.ndarray:
            mixed = np.einsum("nkc,ncx->nkx", weights, values[high.triangles[rows]])
            return mixed.reshape(3 * count, -1).astype(np.float32)

        positions = transformed(self.corners[some].reshape(-1, 3), np.linalg.inv(high.to_world))
        numbers = np.arange(3 * count, dtype=np.int32)
        triangles = numbers.reshape(-1, 3)
        return replace(
            high,
            positions=positions.astype(np.float32),
            vertices=numbers,
            normals=unit(self.normals[some].reshape(-1, 3) @ linear).astype(np.float32),
            triangles=triangles[:, ::-1] if np.linalg.det(linear) < 0.0 else triangles,
            uv=None if high.uv is None else taken(high.uv),
            tangents=None if high.tangents is None else taken(high.tangents),
            not_finite=0,
            without_normals=0,
            faces=None if high.faces is None else high.faces[rows],
            labels=None if high.labels is None else high.labels[rows],
            layers={key: taken(values) for key, values in high.layers.items()},
            normals_domain="",
            face_corners=None,
        )


def _places(high: Mesh, rows: np.ndarray) -> np.ndarray:
    """The corners (N, 3, 3) float64 of triangles of a mesh in world space."""
    return transformed(high.positions[high.vertices[high.triangles[rows]]], high.to_world)


def _near(high: Mesh, places: np.ndarray, cell: float) -> np.ndarray:
    """The triangles of a mesh, which may have millions, with a vertex near places (N, 3) in world space: in the cells of a grid
    that have one, or beside them."""
    origin, size = places.min(axis=0) - 2.0 * cell, np.ceil(np.ptp(places, axis=0) / cell).astype(np.int64) + 5

    def cells(points: np.ndarray) -> np.ndarray:
        return np.floor((points - origin) / cell).clip(0.0, size - 1).astype(np.int64)

    around = (np.unique(cells(places), axis=0)[:, None] + AROUND).reshape(-1, 3)
    wanted = np.unique(np.ravel_multi_index(around.T, size))
    corners, is_near = high.vertices[high.triangles], np.zeros(len(high.positions), bool)
    is_near[corners] = True  # others may be NaN
    used = np.flatnonzero(is_near)
    numbers = np.ravel_multi_index(cells(transformed(high.positions[used], high.to_world)).T, size)
    is_near[used] = np.isin(numbers, wanted)
    return np.flatnonzero(is_near[corners].any(axis=1))
