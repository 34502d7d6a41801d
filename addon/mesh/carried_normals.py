# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals of a coarser mesh that shows the normal map of a finer one, in tangent space: as near to those of the finer one as
normals that interpolate between its vertices can be.

Tried on a chess piece of 3,000 triangles with its map, at 1,500: normals that Blender computes have 4.9 degrees of error, those
of the finer mesh at the vertices 3.9, the least squares here 3.3; a map in object space would have 1.3.
Tried on it, from 3,000 to 1,500, 750 and 375, the angle between what a level shows and the finer mesh at the same texel: with
normals carried from the finer mesh 4.2, 7.1 and 10.5 degrees; from the normals that the coarsest level can have 2.7, 4.1 and
4.0; with `common_normals` 1.2, 2.2 and 3.5 (KEPT 0.1), 1.8, 3.3, 5.8 (1), 1.1, 2.1, 3.2 (0.01, but normals are farther from
faces). Tangents alone account for 0.5 to 1.4 degrees of these.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .closest import Surface
from .topology import numbered
from .triangles import barycentric, face_areas, unit, unit_normals

PLACES = np.array([(4, 1, 1), (1, 4, 1), (1, 1, 4), (2, 2, 2), (3, 3, 0), (0, 3, 3), (3, 0, 3)]) / 6.0
"""Barycentric coordinates (7, 3) of the places on each triangle whose normals are compared."""
INNER = PLACES[:4]
"""Those of them (4, 3) that no other triangle has."""
SAME_SIDE_COSINE = 0.3
"""The cosine between a triangle and the normal of the nearest place, below which that is of another side of the surface."""
GRADIENT_STEPS = 80
"""Of conjugate gradients, at most."""
KEPT = 0.01
"""How much the squares of changes of the finest mesh's normals count, against those of differences between it and the first
level; the same for changes where normals are fitted."""
COARSER = 0.5
"""How much the differences of each level count against those of the one before it, whose errors are about half as large. Tried
on a crater of 3,000 triangles, errors of three levels: 0.866, 1.55 and 2.62 degrees with KEPT 0.1 and 1 here, 0.724, 1.36 and
2.65 with 0.01 and 0.25, 0.715, 1.30 and 2.35 with 0.01 and 0.5."""
FARTHEST_TURN = 60.0
"""The degrees between what a level shows at a place and what it should, above which its normals do not turn for it."""
LEAST_COSINE = 0.2
"""The least cosine between a fitted normal and its face."""
OFF = 1e-3
"""How far a place may lie from a level in the layout: what is farther, the level does not show."""


@dataclass(frozen=True, eq=False)
class LaidOut:
    """A mesh in a space in which all levels lie in each other, as that of a UV layout.

    Attributes:
        places: (T, 3, 3), its corners in that space.
        corners: (T, 3, 3), those on the surface.
        wedges: (T, 3) int, of its corners: those of one wedge have one normal.
        normals: (T, 3, 3), at its corners.
    """

    places: np.ndarray
    corners: np.ndarray
    wedges: np.ndarray
    normals: np.ndarray


def carried_normals(
    fine: tuple[np.ndarray, np.ndarray], places: np.ndarray, corners: np.ndarray, wedges: np.ndarray
) -> np.ndarray:
    """The normals (T, 3, 3) at the corners of a coarser mesh.

    Args:
        fine: the corners (F, 3, 3) of the finer mesh in a space in which both lie in each other, as that of a UV layout, and
            its normals (F, 3, 3).
        places: (T, 3, 3), the corners of the coarser mesh in that space.
        corners: (T, 3, 3), those on the surface.
        wedges: (T, 3) int, of its corners: those of one wedge have one normal.
    """
    on_them = np.einsum("kc,tcx->tkx", PLACES, places).reshape(-1, 3)
    wanted = normals_at(*fine, on_them).reshape(len(places), len(PLACES), 3)
    faces, _ = unit_normals(corners)
    is_same = (wanted * faces[:, None]).sum(axis=2) > SAME_SIDE_COSINE
    wanted = np.where(is_same[..., None], wanted, faces[:, None])
    used, wedges = numbered(wedges)
    return _least_squares(face_areas(corners) + 1e-30, wanted, wedges, len(used))[wedges]


def normals_at(corners: np.ndarray, normals: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The normals (N, 3) that a mesh has at the nearest places on it to some places (N, 3). corners, normals: (F, 3, 3)."""
    nearest, shares, _ = found_on(corners, places)
    return unit(np.einsum("nc,ncx->nx", shares, normals[nearest]))


def common_normals(meshes: Sequence[LaidOut]) -> list[np.ndarray]:
    """Normals (T, 3, 3) of each of some levels of detail, the finest first, that differ as little as can be between them.

    Those of the finest mesh are free too, as its map counts from whatever they are; but they stay near to what they were, see
    KEPT.
    """
    fine = meshes[0]
    numbers = [numbered(mesh.wedges)[1].reshape(-1, 3) for mesh in meshes]
    ends = np.cumsum([each.max(initial=-1) + 1 for each in numbers])
    numbers = [each + begin for each, begin in zip(numbers, [0, *ends[:-1]], strict=True)]
    weights = np.repeat(face_areas(fine.corners), len(INNER)) + 1e-30
    own, shares = np.repeat(numbers[0], len(INNER), axis=0), np.tile(INNER, (len(fine.corners), 1))
    on_them = np.einsum("kc,tcx->tkx", INNER, fine.places).reshape(-1, 3)
    rows = [_Differences(own, shares, KEPT * weights)]
    for level, (mesh, wedges) in enumerate(zip(meshes[1:], numbers[1:], strict=True)):
        nearest, there, squares = found_on(mesh.places, on_them)
        is_shown = squares <= OFF**2
        pairs = np.concatenate([own, wedges[nearest]], axis=1), np.concatenate([shares, -there], axis=1)
        rows.append(_Differences(*(each[is_shown] for each in (*pairs, weights * COARSER**level))))
    start, count = np.zeros((ends[-1], 3)), int(ends[-1])
    for mesh, wedges in zip(meshes, numbers, strict=True):
        start[wedges.reshape(-1)] = mesh.normals.reshape(-1, 3)
    kept = np.einsum("nc,ncx->nx", shares, np.repeat(fine.normals, len(INNER), axis=0))
    diagonal = np.sum([each.diagonal(count) for each in rows], axis=0) + 1e-30
    right = rows[0].gathered(kept, count)

    def product(values: np.ndarray) -> np.ndarray:
        return np.sum([each.product(values, count) for each in rows], axis=0)

    found = unit(_solved(product, right, diagonal[:, None], start))
    return [found[wedges] for wedges in numbers]


@dataclass(frozen=True, eq=False)
class Framed:
    """A mesh that shows a normal map in tangent space.

    Attributes:
        corners: (T, 3, 3).
        normals: (T, 3, 3), at its corners.
        tangents: (T, 3, 4), w the sign of the bitangent.
        uv: (T, 3, 2).
    """

    corners: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray
    uv: np.ndarray

    def shown(self, texels: np.ndarray, which: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The normals (N, 3) that it shows, and its own (N, 3), at places on triangles (N,) with barycentric coordinates (N,
        3).

        texels: (rows, columns, 3), the normals of a map in tangent space, from the lowest row.
        """
        normals, tangents, uv = (
            np.einsum("nc,ncx->nx", shares, each[which]) for each in (self.normals, self.tangents, self.uv)
        )
        signs = self.tangents[which, 0, 3:]
        x, y, z = (part[:, None] for part in _between(texels, uv).T)
        bitangents = signs * np.cross(normals, tangents[:, :3])
        return unit(x * tangents[:, :3] + y * bitangents + z * normals), unit(normals)


def _between(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The values (N, K) of texels (rows, columns, K) at UVs (N, 2), between the middles of four."""
    last = np.array(texels.shape[1::-1]) - 1
    places = uv * (last + 1) - 0.5
    low = np.floor(places)
    share = (places - low)[:, :, None]
    (left, bottom), (right, top) = (np.clip(low + step, 0, last).astype(np.int64).T for step in (0, 1))
    below, above = ((1.0 - share[:, 0]) * texels[row, left] + share[:, 0] * texels[row, right] for row in (bottom, top))
    return (1.0 - share[:, 1]) * below + share[:, 1] * above


def fitted_normals(fine: Framed, level: Framed, wedges: np.ndarray, texels: np.ndarray) -> np.ndarray:
    """Normals (T, 3, 3) of a level with which it shows what a finer mesh shows with the same map at the nearest places.

    Each place turns the level's own normal by the least turn from what it shows to what it should; the normals of wedges are
    the least squares of these. Turns of more than FARTHEST_TURN are left out: the texel is of another place. Tried, on a
    chess piece of 3,000 triangles at 1,500, 750 and 375: 1.87, 3.58 and 6.43 degrees become 1.81, 3.44 and 6.26, on a helmet
    7.06, 12.5 and 21.6 become 6.80, 11.9 and 20.0; a second round changes them by less than 1 %.

    Args:
        fine: the finer mesh, in the same space.
        level: the level as it is.
        wedges: (T, 3) int, of its corners: those of one wedge have one normal.
        texels: (rows, columns, 3), as `Framed.shown` takes them.
    """
    which, shares = np.repeat(np.arange(len(fine.corners)), len(INNER)), np.tile(INNER, (len(fine.corners), 1))
    wanted, _ = fine.shown(texels, which, shares)
    nearest, there, _ = found_on(level.corners, np.einsum("nc,ncx->nx", shares, fine.corners[which]))
    faces, fine_faces = unit_normals(level.corners)[0], unit_normals(fine.corners)[0]
    shown, own = level.shown(texels, nearest, there)
    cosines = (shown * wanted).sum(axis=1, keepdims=True)
    across = np.cross(shown, wanted)
    turned = cosines * own + np.cross(across, own)
    turned += across * (across * own).sum(axis=1, keepdims=True) / np.maximum(1.0 + cosines, 1e-3)
    is_near = cosines[:, 0] > np.cos(np.radians(FARTHEST_TURN))
    is_near &= (faces[nearest] * fine_faces[which]).sum(axis=1) > SAME_SIDE_COSINE
    used, numbers = numbered(wedges)
    numbers, count = numbers.reshape(-1, 3), len(used)
    weights = face_areas(fine.corners)[which] + 1e-30
    rows = _Differences(numbers[nearest[is_near]], there[is_near], weights[is_near])
    start = np.zeros((count, 3))
    start[numbers.reshape(-1)] = level.normals.reshape(-1, 3)
    diagonal = rows.diagonal(count)[:, None]
    pull = KEPT * diagonal.mean() + 1e-30
    right = rows.gathered(turned[is_near], count) + pull * start
    found = _solved(lambda values: rows.product(values, count) + pull * values, right, diagonal + pull, start)
    found = unit(found)[numbers]
    is_good = (found * faces[:, None]).sum(axis=2, keepdims=True) > LEAST_COSINE
    return np.where(is_good, found, level.normals)


@dataclass(frozen=True, eq=False)
class _Differences:
    """Sums of values at wedges.

    Attributes:
        wedges: (N, K) int, of each sum.
        factors: (N, K), on their values.
        weights: (N,), how much the square of each sum counts.
    """

    wedges: np.ndarray
    factors: np.ndarray
    weights: np.ndarray

    def product(self, values: np.ndarray, count: int) -> np.ndarray:
        """Half of the slope (count, 3) of the sum of squares at values (count, 3) of wedges."""
        return self.gathered(np.einsum("nk,nkx->nx", self.factors, values[self.wedges]), count)

    def gathered(self, sums: np.ndarray, count: int) -> np.ndarray:
        """Weighted sums (N, 3), added up at their wedges (count, 3)."""
        factors, at = self.factors * self.weights[:, None], self.wedges.reshape(-1)
        columns = [np.bincount(at, (factors * axis[:, None]).reshape(-1), count) for axis in sums.T]
        return np.stack(columns, axis=1)

    def diagonal(self, count: int) -> np.ndarray:
        """Of the matrix of `product`, (count,)."""
        return np.bincount(self.wedges.reshape(-1), (self.factors**2 * self.weights[:, None]).reshape(-1), count)


def found_on(corners: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The triangles (N,) that are nearest to places (N, 3), barycentric coordinates (N, 3) of the nearest place on each, and
    squared distances (N,). corners: (T, 3, 3)."""
    points, triangles = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
    nearest, where, squares = Surface(points.astype(np.float32), triangles).closest(places.astype(np.float32))
    return nearest, barycentric(where.astype(np.float64), corners[nearest].astype(np.float64)), squares


def _least_squares(weights: np.ndarray, wanted: np.ndarray, wedges: np.ndarray, count: int) -> np.ndarray:
    """The unit normals (count, 3) of wedges that interpolate to the wanted ones (T, K, 3). weights: (T,)."""
    matrices = np.einsum("t,kc,kd->tcd", weights, PLACES, PLACES)
    diagonal = np.bincount(wedges.reshape(-1), np.einsum("tcc->tc", matrices).reshape(-1), count)[:, None]

    def gathered(values: np.ndarray) -> np.ndarray:
        columns = values.reshape(-1, 3).T
        return np.stack([np.bincount(wedges.reshape(-1), column, count) for column in columns], axis=1)

    def product(normals: np.ndarray) -> np.ndarray:
        return gathered(np.einsum("tcd,tdx->tcx", matrices, normals[wedges]))

    right = gathered(np.einsum("t,kc,tkx->tcx", weights, PLACES, wanted))
    return unit(_solved(product, right, diagonal, unit(right)))


def _solved(
    product: Callable[[np.ndarray], np.ndarray], right: np.ndarray, diagonal: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """The values (N, 3) whose product is `right`, by conjugate gradients from `start`. diagonal: (N, 1) of the matrix."""
    values, left = start, right - product(start)
    along = left / diagonal
    step, size = along, (left * along).sum(axis=0)
    for _ in range(GRADIENT_STEPS):
        moved = product(step)
        share = size / np.maximum((step * moved).sum(axis=0), 1e-300)
        values, left = values + share * step, left - share * moved
        along = left / diagonal
        before, size = size, (left * along).sum(axis=0)
        if not size.any():
            break
        step = along + size / np.maximum(before, 1e-300) * step
    return values
