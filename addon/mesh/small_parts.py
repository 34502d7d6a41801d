# SPDX-License-Identifier: GPL-3.0-or-later
"""What is too small to keep of a surface: parts of it, and holes in it."""

import numpy as np

from . import topology
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


def is_crumb(points: np.ndarray, triangles: np.ndarray, share: float) -> tuple[np.ndarray, int]:
    """Which triangles (T,) bool are in parts that are smaller than a share of the largest one, and how many parts that are.

    Sizes are the longest sides of boxes. Small parts that have more than MOST_AREA of the area stay.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices.
        share: from 0 to 1.
    """
    labels = _labels(points, triangles)
    sizes = _sizes(labels, labels.max(initial=-1) + 1, points[triangles])
    is_small = sizes < share * sizes.max(initial=0.0)
    chosen, areas = is_small[labels], face_areas(points, triangles)
    if areas[chosen].sum() > MOST_AREA * areas.sum():
        return np.zeros(len(triangles), bool), 0
    return chosen, int(np.count_nonzero(is_small))


def largest(points: np.ndarray, triangles: np.ndarray, wanted: int, share: float) -> tuple[np.ndarray, int]:
    """Which triangles (T,) bool are in the parts of most area, and how many parts are not.

    Edges cannot collapse beyond a tetrahedron, or the triangles that there are: those of all parts that stay are `share` of the
    wanted ones together. Parts that have the area of as many triangles as they take stay, too, unless the share is small.

    Args:
        points, triangles: as `is_crumb` takes them.
        wanted: how many triangles a low mesh has.
        share: of them, from 0 to 1.
    """
    labels = _labels(points, triangles)
    count = labels.max(initial=-1) + 1
    areas, least = np.bincount(labels, face_areas(points, triangles), count), np.bincount(labels, minlength=count)
    least = np.minimum(least, LEAST)
    order = np.argsort(-areas, kind="stable")
    is_kept = np.zeros(count, bool)
    is_kept[order] = np.cumsum(least[order]) <= share * wanted
    is_kept[order[:1]] = True
    if share >= FAIR:
        is_kept |= areas * wanted >= 0.9 * least * areas.sum()
    return is_kept[labels], int(np.count_nonzero(~is_kept))


def filled(points: np.ndarray, triangles: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray, int]:
    """A surface without holes that are smaller than a share of its size: a fan of triangles closes each.

    Sizes are the longest sides of boxes. A border that is not small beside its own part is no hole, and a part that is made of
    holes, as a sieve or lace, keeps them.

    Args:
        points: (V, 3) float.
        triangles: (T, 3) int, with shared vertices, of which two at an edge point to the same side.
        share: from 0 to 1.

    Returns:
        Points, triangles, and how many holes were filled.
    """
    edges = EdgeTable.of(triangles)
    sides = np.sort(edges.alone)
    first, last, loop = _loops(edges.first[sides], edges.last[sides])
    count = int(loop.max(initial=-1)) + 1
    if not count:
        return points, triangles, 0
    corners = points[np.stack([first, last], axis=1)].astype(np.float64)
    sizes, labels = _sizes(loop, count, corners), _labels(points, triangles)
    sides_of_parts = _sides(labels, labels.max() + 1, points[triangles])
    of_vertices = np.zeros(len(points), int)
    of_vertices[triangles] = labels[:, None]
    part = np.zeros(count, int)
    part[loop] = of_vertices[first]
    # By the second side of its part's box: the end of a tube is small beside the length of the tube alone.
    is_hole = (sizes < share * sides_of_parts.max()) & (sizes < MOST_OF_PART * sides_of_parts[part, 1])
    lengths = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    middles = topology.sums_of(loop, corners.mean(axis=1) * lengths[:, None], count)
    middles /= np.maximum(np.bincount(loop, lengths, count), 1e-300)[:, None]
    fans = face_areas(np.concatenate([corners, middles[loop][:, None]], axis=1))
    closed = np.bincount(part[loop], fans * is_hole[loop], len(sides_of_parts))
    areas = np.bincount(labels, face_areas(points, triangles), len(sides_of_parts))
    is_hole &= (closed <= MOST_AREA * areas)[part]
    chosen = is_hole[loop]
    number = len(points) + np.cumsum(is_hole) - 1
    points = np.concatenate([points, middles[is_hole].astype(points.dtype)])
    fans = np.stack([last, first, number[loop]], axis=1)[chosen].astype(triangles.dtype)
    return points, np.concatenate([triangles, fans[face_areas(points, fans) > 0.0]]), int(is_hole.sum())


def _loops(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those of border sides, from vertices (S,) to vertices (S,) int, that run around holes, and around which."""
    width = int(max(first.max(initial=-1), last.max(initial=-1))) + 1
    is_even = np.bincount(first, minlength=width) == np.bincount(last, minlength=width)
    roots = topology.connected(width, first, last)
    is_closed = np.ones(width, bool)
    is_closed[roots[~is_even]] = False
    chosen = is_closed[roots[first]] & (first != last)
    first, last = first[chosen], last[chosen]
    # What comes to a vertex goes on with what leaves it; where borders touch, the first with the first.
    coming, leaving = np.argsort(last, kind="stable"), np.argsort(first, kind="stable")
    return first, last, topology.numbered(topology.connected(len(first), coming, leaving))[1]


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
