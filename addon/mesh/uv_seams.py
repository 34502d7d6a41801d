# SPDX-License-Identifier: GPL-3.0-or-later
"""Where UV islands end, and what lies there on the surface: numpy alone."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ..core import udim
from .triangle_mesh import Mesh
from .uv_islands import hashes

CONNECTED = 1e-5
"""How far apart the UVs of two triangles may lie at their common edge for them to be of one island."""
INSIDE, OUTSIDE = 0.05, 2.5
"""How far strips along borders reach into the island and out of it, in texels. A texel whose neighbor is written lies at
most a diagonal, and half of one for samples beside the center, from the border."""
SMALLEST_TURN = 1e-6
"""Times that the edge across may be shorter or longer: beyond, one of the two is a point that has no direction."""
HARD = 1.0
"""Degrees between the normals on both sides of an edge from which it is hard: files round normals by less."""
_STRIP = np.array([(0, 2, 1), (1, 2, 3), (2, 4, 5), (2, 5, 3), (4, 6, 7), (4, 7, 5)])
"""Its triangles, of four pairs of corners, inside and outside, from before the edge to past it. Beyond the ends, where the
distance is no longer linear, they part between along and across, so that it is at most 8 % too large."""


@dataclass(frozen=True)
class Seams:
    """The B border edges of UV islands. UVs are complex numbers u + v i.

    here (B, 2) complex128: the two ends of an edge. side (B,) float64: 1 where the island lies to the left from the first
    to the second, -1 to the right. there (B, 2) complex128: where the triangle across the edge has these ends in the
    map, NaN where the surface ends. is_mirrored (B,) bool: whether that triangle's island has to be turned over to lie
    across this edge.
    """

    here: np.ndarray
    side: np.ndarray
    there: np.ndarray
    is_mirrored: np.ndarray

    @np.errstate(over="ignore")  # of UVs that lie far outside
    def similarities(self, size: tuple[int, int], tile: int) -> np.ndarray:
        """What takes texels past each border to where the surface goes on: (2 B, 4) float32, two rows a border.

        In texels of a map of `size` (width, height) on the UDIM tile, place p goes to q = there + turn * (p - here), as
        complex numbers, and with the conjugate of p - here where it is mirrored. First row: here, there; second: turn,
        -1 where mirrored and else 1, and 1 or, where the surface ends, 0.
        """
        here, there = (_texels(ends, size, tile) for ends in (self.here, self.there))
        along = here[:, 1] - here[:, 0]
        turn = (there[:, 1] - there[:, 0]) / np.where(self.is_mirrored, along.conj(), along)
        rows = np.zeros((len(here), 2, 4), np.float32)
        for row, column, values in ((0, 0, here[:, 0]), (0, 2, there[:, 0]), (1, 0, turn)):
            rows[:, row, column], rows[:, row, column + 1] = values.real, values.imag
        scale = np.abs(turn)
        is_known = np.isfinite(rows).all(axis=(1, 2)) & (scale > SMALLEST_TURN) & (scale < 1.0 / SMALLEST_TURN)
        rows[:, 1, 2], rows[:, 1, 3] = np.where(self.is_mirrored, -1.0, 1.0), is_known
        return np.where(is_known[:, None, None], rows, np.float32(0.0)).reshape(-1, 4)

    def strips(self, size: tuple[int, int], tile: int) -> tuple[np.ndarray, np.ndarray]:
        """Strips of triangles along the borders, to find out which border a texel lies beside.

        Returns triangles (6 B, 3) int32 and by corner (8 B, 4) float32: uv, a depth from 0 to 1 that grows with the
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
    """The borders of all islands of `meshes`, which have UVs."""
    found = [_find(mesh) for mesh in meshes]
    return Seams(*(np.concatenate([getattr(one, field.name) for one in found]) for field in fields(Seams)))


@np.errstate(over="ignore", invalid="ignore")  # of UVs that lie far outside
def _find(mesh: Mesh) -> Seams:
    uv = np.ascontiguousarray(mesh.uv, np.float64).view(np.complex128)[:, 0]
    # Each triangle's three edges, from corner to corner, and the corner across.
    start, stop, across = (np.roll(mesh.triangles, -i, axis=1).reshape(-1) for i in range(3))
    here = np.stack([uv[start], uv[stop]], axis=1)
    side = np.sign(((here[:, 1] - here[:, 0]).conj() * (uv[across] - here[:, 0])).imag)
    first, second = mesh.vertices[start], mesh.vertices[stop]
    partner = _partners(mesh.positions, np.stack([first, second], axis=1))
    # The other triangle may go round the other way.
    is_same_way = (mesh.positions[first[partner]] == mesh.positions[first]).all(axis=1)
    there = np.where(is_same_way[:, None], here[partner], here[partner][:, ::-1])
    other_side = np.where(is_same_way, side[partner], -side[partner])
    is_known = (partner >= 0) & (other_side != 0.0)
    # What lies past this edge must come to lie on the other triangle.
    is_mirrored = is_known & (other_side == side)
    goes_on = (partner >= 0) & ~is_mirrored & (np.abs(there - here) <= CONNECTED).all(axis=1)
    is_border = ~goes_on & (side != 0.0)
    there = np.where(is_known[:, None], there, np.nan)
    return Seams(here[is_border], side[is_border], there[is_border], is_mirrored[is_border])


def hard_edges(mesh: Mesh) -> np.ndarray:
    """The edges inside UV islands whose sides have normals of their own, (H, 2) int32: the vertices that they join.

    Each is named once, or once from either side where the sides have vertices of their own in the same place.
    """
    start, stop, across = (np.roll(mesh.triangles, -i, axis=1).reshape(-1) for i in range(3))
    # Only where the normals of one place differ can an edge be hard: of most meshes that leaves few edges to look at.
    is_split = _is_split(mesh)
    some = np.flatnonzero(is_split[mesh.vertices[start]] | is_split[mesh.vertices[stop]])
    start, stop, across = start[some], stop[some], across[some]
    first, second = mesh.vertices[start], mesh.vertices[stop]
    partner = _partners(mesh.positions, np.stack([first, second], axis=1))
    is_same_way = (mesh.positions[first[partner]] == mesh.positions[first]).all(axis=1)
    others = np.where(is_same_way, start[partner], stop[partner]), np.where(is_same_way, stop[partner], start[partner])
    uv = mesh.uv.view(np.complex64)[:, 0]
    goes_on, is_hard = partner >= 0, np.zeros(len(partner), bool)
    for own, other in zip((start, stop), others, strict=True):
        goes_on &= np.abs(uv[own] - uv[other]) <= CONNECTED
        is_hard |= _differ(mesh.normals[own], mesh.normals[other])
    side = ((uv[stop] - uv[start]).conj() * (uv[across] - uv[start])).imag
    # Folded over, as the middle of what is mirrored onto itself, an island ends there.
    goes_on &= (side > 0.0) != ((side[partner] > 0.0) ^ ~is_same_way)
    return np.unique(np.sort(np.stack([first, second], axis=1)[goes_on & is_hard], axis=1), axis=0)


def _is_split(mesh: Mesh) -> np.ndarray:
    """At which vertices (V,) bool there are different normals, on the vertex or on others in the same place."""
    places = np.unique(hashes(mesh.positions + np.float32(0.0)), return_inverse=True)[1]
    corners = mesh.triangles.reshape(-1)
    place = places[mesh.vertices[corners]]
    one = np.zeros(len(mesh.positions), corners.dtype)
    one[place] = corners
    result = np.zeros(len(mesh.positions), bool)
    result[place[_differ(mesh.normals[corners], mesh.normals[one[place]])]] = True
    return result[places]


def _differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which rows of unit normals (N, 3) lie more than HARD apart."""
    between = a - b
    return (between * between).sum(axis=1) > (2.0 * np.sin(np.radians(HARD) / 2.0)) ** 2


def _partners(positions: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """For each edge, ends (E, 2) indices of vertices, the one other between the same two, or -1 without one or with more."""
    partner, is_alone = _paired(ends)
    alone = np.flatnonzero(is_alone)
    # Exporters part vertices at seams: what shares no edge may still meet another in the same place.
    used, ends = np.unique(ends[alone], return_inverse=True)
    places = np.unique(positions[used], axis=0, return_inverse=True)[1]
    met, _ = _paired(places.reshape(-1)[ends.reshape(-1, 2)])
    partner[alone] = np.where(met >= 0, alone[met], -1) if len(alone) else -1
    return partner


def _paired(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The one other edge with the same ends, (E,) int64 or -1, and which have none (E,) bool."""
    low, high = ends.min(axis=1), ends.max(axis=1)
    keys = low.astype(np.int64) * (high.max(initial=0) + 1) + high
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    count = np.diff(first, append=len(keys))
    pairs = first[(count == 2) & (low != high)[order[first]]]
    one, other = order[pairs], order[pairs + 1]
    partner, is_alone = np.full(len(keys), -1), np.zeros(len(keys), bool)
    partner[one], partner[other] = other, one
    is_alone[order[first[count == 1]]] = True
    return partner, is_alone


def _texels(uv: np.ndarray, size: tuple[int, int], tile: int) -> np.ndarray:
    """UVs as places in texels on the tile, complex as well."""
    column, row = udim.place(tile)
    return (uv.real - column) * size[0] + 1j * (uv.imag - row) * size[1]
