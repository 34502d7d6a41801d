# SPDX-License-Identifier: GPL-3.0-or-later
"""UV islands for packing: those that lie on each other count as one, and take their place and size together."""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from . import uv_islands, uv_layout
from .triangle_mesh import Mesh
from .triangles import face_areas


class Stacks:
    """The UV islands of a mesh, of which those with a face on the same place are one, also mirrored, or moved by whole tiles.

    Attributes:
        corners: (N,) int, of the mesh.
        uv: (N, 2) float64, of each, moved back by `tiles`.
        tiles: (N, 2) float64, by how many whole tiles copies are moved away from what they lie on.
        of: (N,) int from 0, the island of each.
        surface: Of all triangles, in the world.
        drawn: The area of all of them in UV space.
        used: The same without what lies on others.
        factors: (I,) float64, by which each island has as much area as the surface that it shows; 0 without area.
        places: (P,) int, one of `corners` for each place of an island.
        triangles: (T, 3) int, of `places`; those without area are left out.
    """

    def __init__(self, mesh: Mesh):
        """mesh: with faces and UVs, and triangles."""
        self.corners, inverse = np.unique(mesh.triangles, return_inverse=True)
        triangles, alone = inverse.reshape(mesh.triangles.shape), uv_islands.islands(mesh)
        self.tiles = self._tiles(mesh, triangles, alone)
        self.uv = mesh.uv[self.corners] - self.tiles
        uv = mesh.uv.copy()
        uv[self.corners] = self.uv
        mesh = replace(mesh, uv=uv)
        joined = uv_islands.stacked(mesh)
        self.of = np.zeros(len(self.corners), np.int64)
        self.of[triangles] = joined[:, None]
        world = mesh.positions[mesh.vertices[mesh.triangles]] @ mesh.to_world[:3, :3].T
        surface, drawn = face_areas(world), 0.5 * np.abs(uv_layout.areas(mesh)).astype(np.float64)
        self.surface, self.drawn = float(surface.sum()), float(drawn.sum())
        shown, shown_in = np.bincount(alone, surface), np.bincount(alone, drawn)
        of_alone = np.zeros(len(shown), np.int64)
        of_alone[alone] = joined
        self.factors = np.zeros(int(joined.max()) + 1)
        factors = np.sqrt(np.divide(shown, shown_in, out=np.zeros_like(shown), where=shown_in > 0.0))
        np.maximum.at(self.factors, of_alone, factors)  # of what lies on each other, the largest has what it needs
        largest = np.zeros(len(self.factors))
        np.maximum.at(largest, of_alone, shown_in)
        self.used = float(largest.sum())
        self._merge(uv_islands.places(mesh)[self.corners], triangles)

    def _tiles(self, mesh: Mesh, triangles: np.ndarray, alone: np.ndarray) -> np.ndarray:
        """`tiles`. triangles: of `corners`. alone: the island of each triangle."""
        away, tiles = uv_islands.moved_copies(mesh), np.zeros((len(self.corners), 2))
        middles = mesh.uv[mesh.triangles].mean(axis=1)
        of_island = [np.bincount(alone, middle) / np.bincount(alone) for middle in middles.T]
        tiles[triangles[away]] = np.floor(np.stack(of_island, axis=1))[alone[away]][:, None]
        return tiles

    def _merge(self, places: np.ndarray, triangles: np.ndarray) -> None:
        """Set `places` and `triangles`. places: of the corners. triangles: (T, 3) int, of the corners."""
        keys = np.stack([self.of, places], axis=1)
        _, self.places, numbers = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        merged = numbers.reshape(-1)[triangles]
        self.triangles = merged[(merged != np.roll(merged, 1, axis=1)).all(axis=1)]

    @cached_property
    def points(self) -> np.ndarray:
        """The UVs (P, 2) of `places`."""
        return self.uv[self.places]

    def scaled(self, size: float) -> np.ndarray:
        """The UVs (P, 2) of `places`, by `factors` and by `size`."""
        return self.points * (size * self.factors)[self.of[self.places]][:, None]

    def placed(self, after: np.ndarray) -> np.ndarray:
        """The UVs (N, 2) of `corners`, moved, turned and scaled by islands as `points` went to `after` (P, 2) float64.

        Islands without area go to the middle of the map.
        """
        used = np.unique(self.triangles)
        count, islands = len(self.factors), self.of[self.places[used]]
        number = np.maximum(np.bincount(islands, minlength=count), 1)

        def total(values: Any) -> Any:
            return np.bincount(islands, values.real, count) + 1j * np.bincount(islands, values.imag, count)

        start, end = (points[used] @ (1.0, 1.0j) for points in (self.points, after))
        middle, middle_after = total(start) / number, total(end) / number
        apart = start - middle[islands]
        squares = total(apart * apart.conj()).real
        factor = total(apart.conj() * (end - middle_after[islands])) / np.where(squares > 0.0, squares, 1.0)
        middle_after = np.where(squares > 0.0, middle_after, 0.5 + 0.5j)
        moved = factor[self.of] * (self.uv @ (1.0, 1.0j) - middle[self.of]) + middle_after[self.of]
        return np.stack([moved.real, moved.imag], axis=1) + self.tiles
