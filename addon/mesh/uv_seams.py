# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the borders of UV islands, and where the surface continues across each border."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..core import udim
from . import edges
from .triangle_mesh import Mesh

CONNECTED = 1e-5
"""Two triangles are on the same island if the UVs at their common edge differ by at most this."""
INSIDE, OUTSIDE = 0.05, 2.5
"""How far the strips along borders extend into the island and out of it, in texels. A texel beside a written texel is at
most 1.5 diagonals from the border: one to its neighbor, and half of one to a sample off its center."""
SMALLEST_TURN = 1e-6
"""The smallest ratio of lengths between an edge and the edge across: below it, one of the two is a point without
direction."""
_STRIP = np.array([(0, 2, 1), (1, 2, 3), (2, 4, 5), (2, 5, 3), (4, 6, 7), (4, 7, 5)])
"""The triangles of a strip. Its corners are four pairs, inside and outside, from before the edge to past it. Beyond the ends
of the edge the distance is not linear: the triangles there divide along from across, so that the error is at most 8 %."""


@dataclass(frozen=True)
class Seams:
    """The B border edges of UV islands. UVs are complex numbers u + v i.

    Attributes:
        here: (B, 2) complex128, the two ends of an edge.
        side: (B,) float64, 1 if the island lies to the left of the way from the first end to the second, -1 if to the right.
        there: (B, 2) complex128, the UVs of the same ends on the triangle across the edge, NaN where the surface ends.
        is_mirrored: (B,) bool, whether the island across must be mirrored to continue across this edge.
    """

    here: np.ndarray
    side: np.ndarray
    there: np.ndarray
    is_mirrored: np.ndarray

    @np.errstate(over="ignore")  # of UVs that lie far outside
    def similarities(self, size: tuple[int, int], tile: int) -> np.ndarray:
        """The similarity transform of each border, from outside the border to where the surface continues.

        Returns (2 B, 4) float32, two rows per border. A position p goes to q = there + turn * (p - here), with complex
        numbers in texels of a map of `size` (width, height) on the UDIM tile; mirrored borders use the conjugate of
        p - here. First row: here, there. Second row: turn, then -1 where mirrored and 1 elsewhere, then 1, or 0 where the
        surface ends.
        """
        here, there = (_texels(ends, size, tile) for ends in (self.here, self.there))
        along = here[:, 1] - here[:, 0]
        turn = (there[:, 1] - there[:, 0]) / np.where(self.is_mirrored, along.conj(), along)
        rows = np.zeros((len(here), 2, 4), np.float32)
        for row, column, values in ((0, 0, here[:, 0]), (0, 2, there[:, 0]), (1, 0, turn)):
            rows[:, row, column], rows[:, row, column + 1] = np.real(values), np.imag(values)
        scale = np.abs(turn)
        is_known = np.isfinite(rows).all(axis=(1, 2)) & (scale > SMALLEST_TURN) & (scale < 1.0 / SMALLEST_TURN)
        rows[:, 1, 2], rows[:, 1, 3] = np.where(self.is_mirrored, -1.0, 1.0), is_known
        return np.where(is_known[:, None, None], rows, np.float32(0.0)).reshape(-1, 4)

    def strips(self, size: tuple[int, int], tile: int) -> tuple[np.ndarray, np.ndarray]:
        """Strips of triangles along the borders, to find the border nearest to a texel.

        Returns triangles (6 B, 3) int32 and corners (8 B, 4) float32: uv, a depth from 0 to 1 that increases with the
        distance from the border in texels of a map of `size` on the tile, and the border's number, from 1.
        """
        here = _texels(self.here, size, tile)
        along = (here[:, 1] - here[:, 0])[:, None, None]
        length = np.abs(along)
        along /= length
        past = np.array([-OUTSIDE, 0.0, 0.0, OUTSIDE])[:, None]
        across = np.array([-INSIDE, OUTSIDE])
        places = here[:, :1, None] + (past + np.array([0.0, 0.0, 1.0, 1.0])[:, None] * length) * along
        places = places - 1j * self.side[:, None, None] * along * across
        corners = np.empty((len(here), 4, 2, 4), np.float32)
        column, row = udim.place(tile)
        corners[..., 0], corners[..., 1] = places.real / size[0] + column, places.imag / size[1] + row
        corners[..., 2] = (np.where(past == 0.0, across, np.hypot(past, across)) + INSIDE) / (2.0 * OUTSIDE)
        corners[..., 3] = np.arange(1, len(here) + 1)[:, None, None]
        triangles = _STRIP + 8 * np.arange(len(here))[:, None, None]
        return triangles.reshape(-1, 3).astype(np.int32), corners.reshape(-1, 4)


def find(meshes: Sequence[Mesh]) -> Seams:
    """Find the borders of all UV islands of `meshes`, which must have UVs."""
    of_each = [_find(mesh) for mesh in meshes]
    return Seams(*(np.concatenate([getattr(seams, field.name) for seams in of_each]) for field in fields(Seams)))


@np.errstate(over="ignore", invalid="ignore")  # of UVs that lie far outside
def _find(mesh: Mesh) -> Seams:
    uv = np.ascontiguousarray(mesh.uv, np.float64).view(np.complex128)[:, 0]
    sides = edges.sides(mesh)
    here, partner = np.stack([uv[sides.start], uv[sides.stop]], axis=1), sides.partner
    side = np.sign(((here[:, 1] - here[:, 0]).conj() * (uv[sides.across] - here[:, 0])).imag)
    there = np.stack([uv[other] for other in sides.others], axis=1)
    # The other triangle may have the opposite winding.
    other_side = np.where(sides.is_same_way, side[partner], -side[partner])
    is_known = (partner >= 0) & (other_side != 0.0)
    # The transform must move the area outside this edge onto the other triangle.
    is_mirrored = is_known & (other_side == side)
    goes_on = (partner >= 0) & ~is_mirrored & (np.abs(there - here) <= CONNECTED).all(axis=1)
    is_border = ~goes_on & (side != 0.0)
    there = np.where(is_known[:, None], there, np.nan)
    return Seams(here[is_border], side[is_border], there[is_border], is_mirrored[is_border])


@np.errstate(over="ignore", invalid="ignore")  # of UVs that lie far outside
def hard_edges(mesh: Mesh) -> np.ndarray:
    """The edges inside UV islands whose two sides have different normals, (H, 2) int32 pairs of vertices.

    Each edge is listed once, or once per side where the two sides use different vertices in the same place.
    """
    sides = edges.sides(mesh, may_be_hard=True)
    start, stop, across, partner = sides.start, sides.stop, sides.across, sides.partner
    uv = mesh.uv.view(np.complex64)[:, 0]
    goes_on = sides.hard(mesh)
    for corner, other in zip((start, stop), sides.others, strict=True):
        goes_on &= np.abs(uv[corner] - uv[other]) <= CONNECTED
    side = ((uv[stop] - uv[start]).conj() * (uv[across] - uv[start])).imag
    # An island ends where it is folded over, as in the middle of a part that is mirrored onto itself.
    goes_on &= (side > 0.0) != ((side[partner] > 0.0) ^ ~sides.is_same_way)
    ends = np.stack([mesh.vertices[start], mesh.vertices[stop]], axis=1)
    return np.unique(np.sort(ends[goes_on], axis=1), axis=0)


def _texels(uv: Any, size: tuple[int, int], tile: int) -> np.ndarray:
    """UVs as places in texels on the tile, complex as well."""
    column, row = udim.place(tile)
    return (uv.real - column) * size[0] + 1j * (uv.imag - row) * size[1]
