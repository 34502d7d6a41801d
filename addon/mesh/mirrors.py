# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that equal their mirror image: found by measuring, cut in half, and made whole again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import topology
from .closest import Surface
from .fitting import Samples
from .topology import EdgeTable
from .triangles import unit_normals

MEASURED = 20_000
"""How many samples of a surface are mirrored to measure it."""
OFF, SHARE = 0.001, 0.995
"""The share of the size of the box by which mirrored samples may be off the surface, and the share that keeps to it."""
FIRST_MEASURED, FIRST_SHARE = 1000, 0.97
"""How many samples are mirrored first, and the share of them below which the others are not: most surfaces have no plane. By
chance, so few never keep to one that there is."""
SAME_COSINE = 0.9
"""The cosine between the normals of a mirrored sample and of the surface there, from which it is the same place."""
NEAR, NEAR_AS_A_WHOLE = 0.25, 0.75
"""The shares of the mean edge of borders within which edges, and whole borders, of a coarse half belong to its cut."""
HALFWAY = 0.5
"""The share of how far a part reaches beyond the plane within which they do, too: the far side of a strip is none."""


@dataclass(frozen=True)
class Plane:
    """A plane of symmetry.

    Attributes:
        axis: Of the space in which it is: 0 to 2 for X, Y and Z.
        place: The coordinate of the plane on this axis.
    """

    axis: int
    place: float

    @property
    def name(self) -> str:
        return "XYZ"[self.axis]

    def mirrored(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) on the other side."""
        result = points.copy()
        result[..., self.axis] = 2.0 * self.place - points[..., self.axis]
        return result

    def folded(self, samples: Samples) -> Samples:
        """Samples, of which those of the lower side are in the places of their mirror images."""
        is_below = samples.points[:, self.axis, None] < self.place
        points = np.where(is_below, self.mirrored(samples.points), samples.points)
        normals = np.where(is_below, Plane(self.axis, 0.0).mirrored(samples.normals), samples.normals)
        return Samples(points, normals, samples.triangles, samples.shares)

    def both(self, samples: Samples) -> Samples:
        """Samples of one side, and their mirror images."""
        points = np.concatenate([samples.points, self.mirrored(samples.points)])
        normals = np.concatenate([samples.normals, Plane(self.axis, 0.0).mirrored(samples.normals)])
        return Samples(points, normals, np.tile(samples.triangles, 2), np.tile(samples.shares, 2))


def plane_of(
    points: np.ndarray, triangles: np.ndarray, samples: Samples, axes: Sequence[int] = range(3)
) -> Plane | None:
    """The plane in which a surface is its own mirror image: through 0, or through the middle of its box. None without one.

    Args:
        points: (V, 3) float32.
        triangles: (T, 3) int.
        samples: evenly on the surface.
        axes: those that are tried, in this order.
    """
    if not len(samples.points):
        return None
    used = points[triangles.reshape(-1)].astype(np.float64)
    least, most = used.min(axis=0), used.max(axis=0)
    size, some = float((most - least).max()), samples.spread(MEASURED)
    surface, (normals, _) = Surface(points, triangles), unit_normals(points, triangles)

    def share(plane: Plane, samples: Samples) -> float:
        nearest, _, squares = surface.closest(plane.mirrored(samples.points).astype(np.float32))
        is_same = (Plane(plane.axis, 0.0).mirrored(samples.normals) * normals[nearest]).sum(axis=1) > SAME_COSINE
        return float(np.mean(is_same & (squares <= (OFF * size) ** 2)))

    for axis in axes:
        middle = float(least[axis] + most[axis]) / 2.0
        plane = Plane(axis, 0.0 if abs(middle) <= OFF * size / 2.0 else middle)  # images are off by twice as much
        if share(plane, some.spread(FIRST_MEASURED)) >= FIRST_SHARE and share(plane, some) >= SHARE:
            return plane
    return None


def half(points: np.ndarray, triangles: np.ndarray, plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """The part of a mesh beyond a plane, cut in it.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int.
        plane: where it is cut.

    Returns:
        Points (P, 3) of the same dtype, and triangles (N, 3) int64.
    """
    points = points.copy()
    away = points[:, plane.axis].astype(np.float64) - plane.place
    is_on = np.abs(away) <= 1e-6 * np.ptp(points[:, plane.axis].astype(np.float64))
    away[is_on], points[is_on, plane.axis] = 0.0, plane.place
    sides = np.sign(away).astype(np.int64)[triangles]
    whole = triangles[(sides >= 0).all(axis=1) & (sides > 0).any(axis=1)]
    crossing = triangles[(sides.min(axis=1) < 0) & (sides.max(axis=1) > 0)]
    # The corner that is alone on its side comes first: two edges from it are cut.
    signs = np.sign(away)[crossing]
    alone = np.argmax(signs == np.where(signs.sum(axis=1) > 0.0, -1.0, 1.0)[:, None], axis=1)
    a, b, c = np.take_along_axis(crossing, (alone[:, None] + np.arange(3)) % 3, axis=1).T
    ends = np.sort(np.concatenate([np.stack([a, b], axis=1), np.stack([a, c], axis=1)]), axis=1)
    keys, number = np.unique(ends[:, 0] * len(points) + ends[:, 1], return_inverse=True)
    first, last = np.divmod(keys, max(len(points), 1))
    share = np.clip(away[first] / np.where(away[first] == away[last], 1.0, away[first] - away[last]), 0.0, 1.0)[:, None]
    cuts = (1.0 - share) * points[first] + share * points[last]
    cuts[:, plane.axis] = plane.place
    # An edge whose other end is in the plane is cut there.
    new = np.where(away[first] == 0.0, first, np.where(away[last] == 0.0, last, len(points) + np.arange(len(keys))))
    ab, ac = new[number.reshape(2, -1)]
    is_tip = away[a] > 0.0
    tips = np.stack([a, ab, ac], axis=1)[is_tip]
    rests = [np.stack(each, axis=1)[~is_tip] for each in ((ab, b, c), (ab, c, ac))]
    faces = np.concatenate([whole, tips, *rests])
    faces = faces[topology.has_corners(faces)]
    used, numbers = topology.numbered(faces)
    return np.concatenate([points, cuts.astype(points.dtype)])[used], numbers


def joined(points: np.ndarray, triangles: np.ndarray, plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """A coarse half and its mirror image as one mesh, which equals its own mirror image to the bit.

    Args:
        points: (V, 3) float, of a mesh of which `half` cut a finer one.
        triangles: (T, 3) int.
        plane: where it was cut.

    Returns:
        Points (P, 3) float32 and triangles (2 T, 3) int64, of which the first half are those of the argument. Edges
        at which four triangles would meet are turned.
    """
    edges = EdgeTable.of(triangles)
    ends = edges.ends[edges.is_open]
    away = np.abs(points[:, plane.axis].astype(np.float64) - plane.place)
    lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    mean = float(lengths.mean()) if len(lengths) else 0.0
    halfway = HALFWAY * _farthest(away, triangles[:, [0, 1, 1, 2]].reshape(-1, 2))
    is_on = np.zeros(len(points), bool)
    is_on[ends[(away <= np.minimum(NEAR * mean, halfway))[ends].all(axis=1)]] = True
    is_near_as_a_whole = _farthest(away, ends) <= np.minimum(NEAR_AS_A_WHOLE * mean, halfway)
    is_on[ends[is_near_as_a_whole[ends]]] = True
    return doubled(points, _without_chords(triangles, edges, is_on), is_on, plane)


def doubled(
    points: np.ndarray, triangles: np.ndarray, is_on: np.ndarray, plane: Plane
) -> tuple[np.ndarray, np.ndarray]:
    """A half and its mirror image as one mesh, as `joined` returns it. is_on: (V,) bool, the vertices that both have."""
    # Of multiples of a power of two, sums and differences of single precision are exact.
    largest = float(np.abs(points[:, plane.axis]).max(initial=0.0)) + abs(plane.place)
    step = 2.0 ** (np.ceil(np.log2(max(largest, 1e-30))) - 22)
    place = np.round(plane.place / step) * step
    rounded = points.astype(np.float64)
    rounded[:, plane.axis] = np.maximum(np.round(rounded[:, plane.axis] / step) * step, place)
    rounded[is_on, plane.axis] = place
    other = np.where(is_on, np.arange(len(points)), len(points) + np.cumsum(~is_on) - 1)
    both = np.concatenate([rounded, Plane(plane.axis, place).mirrored(rounded[~is_on])])
    return both.astype(np.float32), np.concatenate([triangles, other[triangles][:, ::-1]]).astype(np.int64)


def _farthest(away: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The greatest of values (V,) of vertices among those that edges (E, 2) int connect each one with."""
    roots, result = topology.connected(len(away), *ends.T), np.zeros(len(away))
    np.maximum.at(result, roots, away)
    return result[roots]


def _without_chords(triangles: np.ndarray, edges: EdgeTable, is_on: np.ndarray) -> np.ndarray:
    """Triangles (T, 3) of a half. Edges inside it with both ends in the plane run between the two other corners beside them
    instead. is_on: (V,) bool, the vertices in the plane."""
    one, other = edges.pairs
    first, last = edges.first[one], edges.last[one]
    left, right = (edges.last[3 * (side // 3) + (side + 1) % 3] for side in (one, other))
    is_new = ~np.isin(topology.edge_keys(left, right, edges.width), edges.keys)
    chosen = np.flatnonzero(is_on[first] & is_on[last] & ~is_on[left] & ~is_on[right] & is_new & ~edges.is_against)
    # Each triangle turns one of its edges.
    owner = np.full(len(triangles), len(one))
    np.minimum.at(owner, np.stack([one, other])[:, chosen] // 3, chosen)
    chosen = chosen[(owner[one[chosen] // 3] == chosen) & (owner[other[chosen] // 3] == chosen)]
    result = triangles.copy()
    result[one[chosen] // 3] = np.stack([left, right, last], axis=1)[chosen]
    result[other[chosen] // 3] = np.stack([right, left, first], axis=1)[chosen]
    return result
