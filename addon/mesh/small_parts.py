# SPDX-License-Identifier: GPL-3.0-or-later
"""What is too small to keep of a surface: parts of it, and holes in it."""

from dataclasses import dataclass

import numpy as np

from . import topology
from .closest import Surface
from .topology import EdgeTable
from .triangles import face_areas

MOST_AREA = 0.1
"""The share of the area that small parts have at most, and holes of that of a part: a heap of gravel and a sieve are made of
them."""
MOST_OF_PART = 0.5
"""The share of the size of a part that a hole has at most: the border of a sheet is none."""
FAIR = 0.5
"""The share of triangles from which on no part is left out that has the area for its own."""
LEAST = 4
"""The triangles of which a closed part has at least."""
CLEARLY = 6.0
"""How many times as large as others parts and holes may be that nobody made: parts that float, and ragged holes."""
FLOATING = 0.5
"""The share of the size of a part by which it is away from larger ones if it floats. Buttons and rivets are nearer."""
MOST_CLEAR_PART, MOST_CLEAR_HOLE = 0.06, 0.12
"""The shares of the size that these have at most. Sleeves and the mouths of jars are larger."""
RAGGED = 1.5
"""The turns from which on a border is ragged: where a knife made it, it turns around once."""


@dataclass(frozen=True)
class Small:
    """Small parts of a surface, or small holes in it.

    Attributes:
        mended: How many were left out, or filled.
        stay: How many stay that are hardly larger, or that may be meant.
        largest: The largest size of these, as a share of that of the largest part.
    """

    mended: int = 0
    stay: int = 0
    largest: float = 0.0

    @classmethod
    def of(cls, mended: np.ndarray, stay: np.ndarray, sizes: np.ndarray) -> "Small":
        """Of parts or holes (N,): which are mended and which stay, bool, and their sizes."""
        return cls(int(np.count_nonzero(mended)), int(np.count_nonzero(stay)), float(sizes[stay].max(initial=0.0)))


NOTHING_SMALL = Small()
"""Of a surface without any."""


def is_crumb(points: np.ndarray, triangles: np.ndarray, share: float) -> tuple[np.ndarray, Small]:
    """Which triangles (T,) bool are in parts that are smaller than a share of the largest one, or that float and are hardly
    larger.

    Sizes are the longest sides of boxes. Small parts that have more than MOST_AREA of the area stay.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices.
        share: from 0 to 1.
    """
    labels = _labels(points, triangles)
    sizes = _sizes(labels, labels.max(initial=-1) + 1, points[triangles])
    longest = max(sizes.max(initial=0.0), 1e-300)
    sizes /= longest
    areas = np.bincount(labels, face_areas(points, triangles), len(sizes))

    def few(chosen: np.ndarray) -> np.ndarray:
        return chosen & (areas[chosen].sum() <= MOST_AREA * areas.sum())

    is_small, may_be = sizes < share, few(sizes < _clear(share, MOST_CLEAR_PART))
    chosen = few(is_small)
    if (may_be & ~is_small).any():
        chosen = chosen | _floats(points, triangles, labels, longest * sizes, may_be & ~is_small)
    return chosen[labels], Small.of(chosen, may_be & ~chosen, sizes)


def _clear(share: float, most: float) -> float:
    """The share of the size below which parts or holes may be such that nobody made."""
    return max(share, min(CLEARLY * share, most))


def _floats(
    points: np.ndarray, triangles: np.ndarray, labels: np.ndarray, sizes: np.ndarray, chosen: np.ndarray
) -> np.ndarray:
    """Which of the chosen parts (P,) bool float: away from larger ones, and from those of them that do not.

    Args:
        points, triangles: of the surface.
        labels: (T,) int, the part of each triangle.
        sizes: (P,) of the parts.
    """
    points = points.astype(np.float32)
    far, reach = np.full(len(sizes), np.inf), FLOATING * sizes
    is_free, near = chosen.copy(), ~chosen & (sizes >= sizes[chosen].max())
    while is_free.any() and near.any():
        rows = np.flatnonzero(is_free[labels])
        _, _, squares = Surface(points, triangles[near[labels]]).closest(points[triangles[rows]].reshape(-1, 3))
        np.minimum.at(far, np.repeat(labels[rows], 3), np.sqrt(squares))
        near = is_free & (far <= reach)
        is_free &= ~near
    return is_free


def largest(points: np.ndarray, triangles: np.ndarray, wanted: int, share: float) -> tuple[np.ndarray, int]:
    """Which triangles (T,) bool are in the parts of most area, and how many parts are not.

    Edges cannot collapse beyond a tetrahedron, or the triangles that there are: those of all parts that stay are `share` of the
    wanted ones together. Parts that have the area of as many triangles as they take stay, too, and those that need no collapse,
    as larger ones do not either, unless the share is small.

    Args:
        points, triangles: as `is_crumb` takes them.
        wanted: how many triangles a low mesh has.
        share: of them, from 0 to 1.
    """
    labels = _labels(points, triangles)
    count = labels.max(initial=-1) + 1
    areas, counts = np.bincount(labels, face_areas(points, triangles), count), np.bincount(labels, minlength=count)
    least = np.minimum(counts, LEAST)
    order = np.argsort(-areas, kind="stable")
    is_kept = np.zeros(count, bool)
    is_kept[order] = np.cumsum(least[order]) <= share * wanted
    is_kept[order[:1]] = True
    if share >= FAIR:
        is_kept |= areas * wanted >= 0.9 * least * areas.sum()
        is_kept[order] |= np.cumsum(counts[order]) <= wanted
    return is_kept[labels], int(np.count_nonzero(~is_kept))


def filled(points: np.ndarray, triangles: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray, Small]:
    """A surface without holes that are smaller than a share of its size, or ragged and hardly larger: a fan of triangles closes
    each.

    Sizes are the longest sides of boxes. A border that is not small beside its own part is no hole, and a part that is made of
    holes, as a sieve or lace, keeps them.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices, of which two at an edge point to the same side.
        share: from 0 to 1.

    Returns:
        Points, triangles, and the holes.
    """
    edges = EdgeTable.of(triangles)
    sides = np.sort(edges.alone)
    first, last, loop, after = _loops(edges.first[sides], edges.last[sides])
    count = int(loop.max(initial=-1)) + 1
    if not count:
        return points, triangles, NOTHING_SMALL
    corners = points[np.stack([first, last], axis=1)].astype(np.float64)
    labels = _labels(points, triangles)
    sides_of_parts = _sides(labels, labels.max() + 1, points[triangles])
    sizes = _sizes(loop, count, corners) / sides_of_parts.max()
    of_vertices = np.zeros(len(points), int)
    of_vertices[triangles] = labels[:, None]
    part = np.zeros(count, int)
    part[loop] = of_vertices[first]
    lengths = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    middles = topology.sums_of(loop, corners.mean(axis=1) * lengths[:, None], count)
    middles /= np.maximum(np.bincount(loop, lengths, count), 1e-300)[:, None]
    closing = face_areas(np.concatenate([corners, middles[loop][:, None]], axis=1))
    areas = np.bincount(labels, face_areas(points, triangles), len(sides_of_parts))

    def few(chosen: np.ndarray) -> np.ndarray:
        closed = np.bincount(part[loop], closing * chosen[loop], len(areas))
        return chosen & (closed <= MOST_AREA * areas)[part]

    # By the second side of its part's box: the end of a tube is small beside the length of the tube alone.
    may_be = sizes * sides_of_parts.max() < MOST_OF_PART * sides_of_parts[part, 1]
    may_be &= sizes < _clear(share, MOST_CLEAR_HOLE)
    is_small, is_ragged = sizes < share, _turns(corners, loop, after, count) > RAGGED
    is_hole = few(may_be & (is_small | is_ragged)) | few(may_be & is_small)
    stay = few(may_be) & ~is_hole
    chosen = is_hole[loop]
    number = len(points) + np.cumsum(is_hole) - 1
    points = np.concatenate([points, middles[is_hole].astype(points.dtype)])
    fans = np.stack([last, first, number[loop]], axis=1)[chosen].astype(triangles.dtype)
    triangles = np.concatenate([triangles, fans[face_areas(points, fans) > 0.0]])
    return points, triangles, Small.of(is_hole, stay, sizes)


def _turns(corners: np.ndarray, loop: np.ndarray, after: np.ndarray, count: int) -> np.ndarray:
    """How often each border (count,) turns around, where all its turns count as if to one side.

    Args:
        corners: (S, 2, 3) of its sides.
        loop: (S,) int, the border of each.
        after: (S,) int, the side that follows each.
    """
    ways = corners[:, 1] - corners[:, 0]
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)
    angles = np.arccos(np.clip((ways * ways[after]).sum(axis=1), -1.0, 1.0))
    return np.bincount(loop, angles, count) / (2.0 * np.pi)


def _loops(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Those of border sides, from vertices (S,) to vertices (S,) int, that run around holes, around which, and the side that
    follows each."""
    width = int(max(first.max(initial=-1), last.max(initial=-1))) + 1
    is_even = np.bincount(first, minlength=width) == np.bincount(last, minlength=width)
    roots = topology.connected(width, first, last)
    is_closed = np.ones(width, bool)
    is_closed[roots[~is_even]] = False
    chosen = is_closed[roots[first]] & (first != last)
    first, last = first[chosen], last[chosen]
    # What comes to a vertex goes on with what leaves it; where borders touch, the first with the first.
    coming, after = np.argsort(last, kind="stable"), np.empty(len(first), int)
    after[coming] = np.argsort(first, kind="stable")
    loop = topology.numbered(topology.connected(len(first), np.arange(len(first)), after))[1]
    return first, last, loop, after


def _labels(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The part (T,) int of each triangle."""
    return topology.components(tuple(triangles.T), len(points))[0]


def _sizes(labels: np.ndarray, count: int, corners: np.ndarray) -> np.ndarray:
    """The longest sides (count,) of the boxes around what has each label. labels: (N,) int. corners: (N, n, 3)."""
    return _sides(labels, count, corners)[:, 2]


def _sides(labels: np.ndarray, count: int, corners: np.ndarray) -> np.ndarray:
    """The sides (count, 3) of these boxes, the longest one last."""
    if not count:
        return np.zeros((0, 3))
    order = np.argsort(labels, kind="stable")
    begins = np.searchsorted(labels[order], np.arange(count))
    least = np.minimum.reduceat(corners.min(axis=1)[order], begins)
    most = np.maximum.reduceat(corners.max(axis=1)[order], begins)
    return np.sort((most - least).astype(np.float64), axis=1)
