# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the planes of a surface: connected triangles that lie in one, as the sides of machine parts do."""

from dataclasses import dataclass

import numpy as np

from . import topology
from .topology import EdgeTable
from .triangles import checked, diagonal, dot, unit, unit_normals

ANGLES = np.radians((1.0, 0.2, 0.04))
"""Up to which angle neighbors lie in one plane: where that joins what is curved, as fine cylinders, the next one is tried."""
OFF = 1e-5
"""How far from their plane vertices may lie, as a share of the diagonal: files round by less."""
THIN = 10.0
"""By how many times as much triangles are higher whose normals are known."""
SOFT, ALIKE = np.radians(40.0), 2.0
"""The angle up to which planes turn little, and the factor up to which their areas are about the same."""
PARALLEL = 1e-4
"""The least square of the sine between planes whose normals differ."""
LARGE = 0.005
"""The share of the surface from which a plane is large."""


@dataclass(frozen=True, eq=False)
class Planes:
    """The planes of triangles. A triangle that shares its plane with no neighbor has one for itself.

    Attributes:
        of: (T,) int, the plane of each triangle.
        normals: (P, 3) float64.
        offsets: (P,) float64, so that x . normal = offset for places x on a plane.
        areas: (P,) float64.
        is_round: (P,) bool, which ones turn little to a neighbor of about their area, as the strips of a cylinder do.
    """

    of: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    areas: np.ndarray
    is_round: np.ndarray

    @property
    def large_share(self) -> float:
        """The share of the area in planes of several triangles that are large."""
        total = float(self.areas.sum())
        counts = np.bincount(self.of, minlength=len(self.areas))
        is_large = (self.areas > LARGE * total) & (counts > 1)
        return float(self.areas[is_large].sum()) / max(total, 1e-300)

    def free_directions(self, triangles: np.ndarray, of: np.ndarray, count: int, least: float) -> np.ndarray:
        """Matrices (count, 3, 3) onto the directions in which vertices leave no plane, but round and tiny ones.

        triangles: (T, 3) int, of `count` vertices. of: (T,) int, their planes. least: the share of the surface up to which a
        plane is tiny.
        """
        holds = ~self.is_round & (self.areas > least * self.areas.sum())
        which = np.flatnonzero(holds[of])
        vertices, chosen = np.divmod(np.unique(triangles[which] * len(self.areas) + of[which, None]), len(self.areas))
        products = (self.normals[chosen, :, None] * self.normals[chosen, None, :]).reshape(-1, 9)
        values, axes = np.linalg.eigh(topology.sums_of(vertices, products, count).reshape(-1, 3, 3))
        return np.einsum("vik,vk,vjk->vij", axes, (values < PARALLEL).astype(float), axes)


def planes(points: np.ndarray, triangles: np.ndarray) -> Planes:
    """The planes of a surface.

    >>> found = planes(points, triangles)
    >>> found.of.shape, found.normals.shape == (len(found.areas), 3)
    ((8,), True)

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices.
    """
    points, triangles = checked(points, triangles)
    points = points.astype(np.float64)
    size = max(diagonal(points), 1e-300)
    normals, twice_areas = unit_normals(points, triangles)
    corners = points[triangles]
    table = EdgeTable.of(triangles)
    one, other = (side // 3 for side in table.pairs)
    longest = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1))
    is_thin = twice_areas < THIN * OFF * size * longest  # their normals are not known
    turns = np.linalg.norm(normals[one] - normals[other], axis=1)
    labels, left = np.arange(len(triangles)), ~is_thin
    long = normals * twice_areas[:, None]
    for angle in ANGLES:
        joins = (turns < angle) & left[one] & left[other]
        roots = topology.connected(len(triangles), one[joins], other[joins])
        is_flat = left & (_worst(roots, *_fitted(roots, long, corners), corners)[roots] < OFF * size)
        labels[is_flat] = roots[is_flat]
        left &= ~is_flat
    labels = _with_thin(labels, is_thin, table, long, corners)
    # Thin triangles lie between parts of one plane, too.
    of_labels, _ = _fitted(labels, long, corners)
    joins = (of_labels[labels[one]] * of_labels[labels[other]]).sum(axis=1) > np.cos(ANGLES[1])
    roots = topology.connected(len(triangles), labels[one[joins]], labels[other[joins]])[labels]
    is_flat = _worst(roots, *_fitted(roots, long, corners), corners)[roots] < OFF * size
    labels = np.where(is_flat, roots, labels)
    _, numbers = topology.numbered(labels)
    of_planes, offsets = _fitted(numbers, long, corners)
    count = int(numbers.max(initial=-1)) + 1
    of_planes, areas = of_planes[:count], np.bincount(numbers, twice_areas / 2.0, count)
    pairs = np.unique(np.sort(np.stack([numbers[one], numbers[other]], axis=1)), axis=0)
    ratios = areas[pairs[:, 0]] / np.maximum(areas[pairs[:, 1]], 1e-300)
    bends = (np.abs(np.log(np.maximum(ratios, 1e-300))) < np.log(ALIKE)) & (pairs[:, 0] != pairs[:, 1])
    bends &= (of_planes[pairs[:, 0]] * of_planes[pairs[:, 1]]).sum(axis=1) > np.cos(SOFT)
    is_round = np.zeros(count, bool)
    is_round[pairs[bends]] = True
    return Planes(numbers, of_planes, offsets[:count], areas, is_round)


def _worst(labels: np.ndarray, normals: np.ndarray, offsets: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How far the corners with each label (T,) lie from its plane, at most: (T,)."""
    away = np.abs((corners * normals[labels][:, None]).sum(axis=2) - offsets[labels][:, None]).max(axis=1)
    worst = np.where(np.abs(normals).max(axis=1) > 0.0, 0.0, np.inf)  # around a tube, normals sum to none
    np.maximum.at(worst, labels, away)
    return worst


def _with_thin(
    labels: np.ndarray, is_thin: np.ndarray, table: EdgeTable, long: np.ndarray, corners: np.ndarray
) -> np.ndarray:
    """`labels` (T,) where thin triangles (T,) bool have that of a neighbor in whose plane they lie. long, corners: as in
    `_fitted`."""
    labels, left, off = labels.copy(), is_thin.copy(), OFF * diagonal(corners)
    normals, offsets = _fitted(labels, long, corners)
    beside = [side // 3 for side in table.pairs]
    one, other = np.concatenate(beside), np.concatenate(beside[::-1])
    while True:
        chosen = left[one] & ~left[other]
        thin, plane = one[chosen], labels[other[chosen]]
        away = np.abs((corners[thin] * normals[plane][:, None]).sum(axis=2) - offsets[plane][:, None])
        fits = away.max(axis=1, initial=0.0) < off
        if not fits.any():
            return labels
        labels[thin[fits]] = plane[fits]
        left[thin[fits]] = False


def _fitted(labels: np.ndarray, long: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The planes through the triangles with each label: normals (T, 3) and offsets (T,), by area.

    labels: (T,) int. long: (T, 3), normals as long as twice the areas. corners: (T, 3, 3).
    """
    count = len(labels)
    areas = np.linalg.norm(long, axis=1) + 1e-300
    normals = unit(topology.sums_of(labels, long, count))
    middles = topology.sums_of(labels, corners.mean(axis=1) * areas[:, None], count)
    middles /= np.maximum(np.bincount(labels, areas, count), 1e-300)[:, None]
    return normals, dot(normals.T, middles.T)
