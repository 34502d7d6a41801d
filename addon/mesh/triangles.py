# SPDX-License-Identifier: GPL-3.0-or-later
"""The arithmetic of triangles: normals, areas, barycentric coordinates, closest points.

Triangles are given as `points` (V, 3) and `triangles` (T, 3) int, indices of points, or as their corners (T, 3, 3) alone.
Inside, one axis follows the other, (3, T): numpy takes several times as long along a short last axis. Results have the type of
the points, unless another one is asked for.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import DTypeLike

from ..core import threads
from ..core.errors import BakeError

Axes: TypeAlias = "np.ndarray | tuple[np.ndarray, ...]"
"""Vectors, one array for each axis, or (3, ...)."""
PLACES_AT_ONCE = 2**12
"""Places whose closest points are found together, so that what is between fits in a processor's cache."""


def checked(points: np.ndarray, triangles: np.ndarray, width: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, width) of floats and triangles (T, 3) of whole numbers, as arrays. Raises BakeError for what is no mesh."""
    try:
        points, triangles = np.asarray(points), np.asarray(triangles)
        points = points if points.dtype.kind == "f" else points.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise BakeError(f"The points must be numbers, (V, {width}): {error}.") from None
    if points.ndim != 2 or points.shape[1] != width or not np.isfinite(points).all():
        raise BakeError(f"The points must be finite numbers, (V, {width}), but they are {points.shape}.")
    if triangles.dtype.kind not in "iu" or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise BakeError(
            f"The triangles must be whole numbers, (T, 3), but they are {triangles.dtype}, {triangles.shape}."
        )
    if triangles.size and (triangles.min() < 0 or triangles.max() >= len(points)):
        raise BakeError(f"The triangles name points from {triangles.min()} to {triangles.max()}, of {len(points)}.")
    return points, triangles


def face_normals(points: np.ndarray, triangles: np.ndarray | None = None, dtype: DTypeLike | None = None) -> np.ndarray:
    """The normals (T, 3), as long as twice the areas; they point to where corners are seen counter-clockwise."""
    a, b, c = _columns(points, triangles, dtype)
    return np.stack(cross(b - a, c - a), axis=1)


def unit_normals(
    points: np.ndarray, triangles: np.ndarray | None = None, dtype: DTypeLike | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The normals (T, 3) at length one, 0 for triangles without an area, and twice the areas (T,)."""
    long = face_normals(points, triangles, dtype)
    lengths = np.linalg.norm(long, axis=1)
    return long / np.where(lengths > 0.0, lengths, 1.0)[:, None], lengths


def face_areas(points: np.ndarray, triangles: np.ndarray | None = None, dtype: DTypeLike | None = None) -> np.ndarray:
    """The areas (T,)."""
    return 0.5 * np.linalg.norm(face_normals(points, triangles, dtype), axis=1)


def quality(corners: np.ndarray, twice_areas: np.ndarray) -> np.ndarray:
    """1 for equilateral triangles (T, 3, 3), 0 for lines: (T,). twice_areas: (T,)."""
    squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    return 2.0 * np.sqrt(3.0) * twice_areas / np.maximum(squares, 1e-300)


def enclosed_volumes(points: np.ndarray, triangles: np.ndarray | None = None) -> np.ndarray:
    """Six times the volumes (T,) between triangles and the origin: positive where it lies behind a triangle."""
    a, b, c = _columns(points, triangles, None)
    return dot(a, cross(b, c))


def vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The unit normals (V, 3) float64 of vertices: the mean of the faces around, by their angles there."""
    faces, _ = unit_normals(points, triangles, np.float64)
    sums = np.zeros((len(points), 3))
    for corner in range(3):
        here, ahead, behind = (points[triangles[:, (corner + turn) % 3]].T for turn in range(3))
        u, v = ahead - here, behind - here
        angles = np.arctan2(np.linalg.norm(cross(u, v), axis=0), dot(u, v))
        for axis in range(3):
            sums[:, axis] += np.bincount(triangles[:, corner], angles * faces[:, axis], len(points))
    return unit(sums)


def unit(vectors: np.ndarray) -> np.ndarray:
    """`vectors` (..., 3) at length one; those without length stay."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The angles (...) in radians between unit vectors (..., 3), precise also where the cosine is close to 1."""
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))


def diagonal(points: np.ndarray) -> float:
    """The diagonal of the box around points (..., 3); 0 without any."""
    points = points.reshape(-1, 3)
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def transformed(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Points (..., 3) in the space to which a matrix (4, 4) float64 leads: float64."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def barycentric(places: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The weights (N, 3), from 0 to 1, of the corners (N, 3, 3) of a triangle each at places (N, 3) on it, or beside it; all
    alike for triangles without an area."""
    place, (a, b, c) = places.T, corners.transpose(1, 2, 0)
    normal = cross(b - a, c - a)
    area = np.maximum(dot(normal, normal), 1e-300)
    parts = [dot(cross(q - place, r - place), normal) / area for q, r in ((b, c), (c, a), (a, b))]
    weights = np.clip(np.stack(parts, axis=1), 0.0, 1.0)
    sums = weights.sum(axis=1, keepdims=True)
    return np.where(sums > 0.0, weights / np.maximum(sums, 1e-300), 1.0 / 3.0)


def closest_points(places: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The point (N, 3) of a triangle each, also of one without an area, that is closest to each place.

    Args:
        places: (N, 3).
        corners: (N, 3, 3), of a triangle for each place.
    """
    result = np.empty(places.shape, np.result_type(places, corners))

    def find(part: slice) -> None:
        result[part] = _closest_points(places[part], corners[part])

    threads.for_blocks(len(places), find, PLACES_AT_ONCE)
    return result


def _closest_points(places: np.ndarray, corners: np.ndarray) -> np.ndarray:
    ends, place = np.ascontiguousarray(corners.transpose(1, 2, 0)), np.ascontiguousarray(places.T)
    a = ends[0]
    normal = np.stack(cross(ends[1] - a, ends[2] - a))
    area = dot(normal, normal)
    best, far, outside = a.copy(), np.full(len(places), np.inf, ends.dtype), np.zeros(len(places), bool)
    for number in range(3):
        start, along = ends[number], ends[(number + 1) % 3] - ends[number]
        away = place - start
        outside |= dot(cross(normal, along), away) < 0.0
        length = dot(along, along)
        share = np.clip(dot(away, along) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        along *= share
        along += start  # now the point on the edge
        away = along - place
        squares = dot(away, away)
        np.copyto(best, along, where=squares < far)
        np.minimum(far, squares, out=far)
    height = dot(normal, place - a) / np.where(area > 0.0, area, 1.0)
    inside = ~outside & (area > 0.0)
    return np.where(inside, place - normal * height, best).T


def cross(u: Axes, v: Axes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The cross products of vectors, axis by axis. numpy's own takes three times as long."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def dot(u: Axes, v: Axes) -> np.ndarray:
    """The scalar products (...) of vectors."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _columns(points: np.ndarray, triangles: np.ndarray | None, dtype: DTypeLike | None) -> list[np.ndarray]:
    """The three corners of triangles, (3, T) each."""
    if triangles is None:
        corners = points.transpose(1, 2, 0)
    else:
        corners = [np.take(points, corner, axis=0, mode="clip").T for corner in triangles.T]
    return [np.ascontiguousarray(corner, dtype) for corner in corners]
