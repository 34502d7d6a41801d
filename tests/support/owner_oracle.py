"""A float64 oracle of the rules that choose a hit: it tests every triangle, and shares no code with the shader."""

from dataclasses import dataclass, fields

import numpy as np

STEPS = 12
"""The most triangles that the walk crosses, as in shaders/lib/owner_lib.glsl."""
FOLDED = np.cos(np.radians(120.0))
"""The cosine of the angle between two faces from which one is folded back on the other."""
CLOSER = 2e-5
"""Share of a squared distance: other triangles count as closer only if they are closer by about this."""
SAME = 1e-5
"""In the units of the positions. Layers of the low mesh this close to the place are its own one."""
TIE = 1e-6
"""In the units of the positions. Two closest points whose distances differ by less are both closest, and a point this little
beyond an edge is on it: closest points lie on edges that two triangles share."""


@dataclass(frozen=True)
class Rays:
    """Rays against `away` (N, 3), unit vectors, from `start` outside places (N, 3) on low triangles `own` (N,) int."""

    places: np.ndarray
    away: np.ndarray
    own: np.ndarray
    start: float
    inside: float


@dataclass(frozen=True)
class Hits:
    """Hits: the ray (M,) and triangle (M,) int of each, its height (M,) above the place, weights (M, 3), and whether the
    triangle's front faces the ray (M,) bool."""

    ray: np.ndarray
    triangle: np.ndarray
    height: np.ndarray
    weights: np.ndarray
    faces: np.ndarray

    def __getitem__(self, which):
        return Hits(*(getattr(self, each.name)[which] for each in fields(self)))


@dataclass(frozen=True)
class Chosen:
    """The hit of each ray: triangle (N,) int, -1 for a miss; height (N,); weights (N, 3); two flags (N,) bool."""

    triangle: np.ndarray
    height: np.ndarray
    weights: np.ndarray
    is_not_owned: np.ndarray
    is_from_behind: np.ndarray


def own_hits(rays, high, normals, low, neighbors, *, most, facing_only=False, tie=None, by_order=False):
    """The outermost owned hit, else the nearest one that faces the ray, else the nearest back unless facing_only.

    by_order: where a ray has as many hits that face it as layers of the low mesh, and more than one, they are matched instead.

    high, low: corners (T, 3, 3). normals (T, 3, 3): of the high corners. neighbors (T, 3) int: across the edges of `low` from
    corner k to the next one, or -1. most: how many hits that face the ray are asked for their owner. tie: as in `owned`.
    """
    hits = all_hits(rays, high)
    hits = hits[np.lexsort((-hits.height, hits.ray))]  # the outermost of each ray first
    fronts = hits[hits.faces]
    fronts = fronts[_rank(fronts.ray) < most]
    points = rays.places[fronts.ray] + rays.away[fronts.ray] * fronts.height[:, None]
    smooth = np.einsum("nk,nkc->nc", fronts.weights, normals[fronts.triangle])
    is_own = owned(points, smooth, rays.own[fronts.ray], low, neighbors, tie=tie)
    own = _first(fronts[is_own])
    if by_order:
        ordered = _by_order(rays, hits[hits.faces], low)
        own = _joined(own[~np.isin(own.ray, ordered.ray)], ordered)
    others = _nearest(fronts)
    others = others[~np.isin(others.ray, own.ray)]
    backs = _nearest(hits[~hits.faces & (not facing_only)])
    backs = backs[~np.isin(backs.ray, fronts.ray)]
    return _chosen(len(rays.places), own, others, backs)


def _by_order(rays, fronts, low):
    """Of the rays with as many `fronts`, sorted by height, as layers of the low mesh, those that come where the place does."""
    layers = all_hits(rays, low)
    layers = layers[layers.faces & (np.abs(layers.height) > SAME)]
    count = len(rays.places)
    total, outside = (
        1 + np.bincount(layers.ray, minlength=count),
        np.bincount(layers.ray[layers.height > 0.0], minlength=count),
    )
    is_matched = (total > 1) & (np.bincount(fronts.ray, minlength=count) == total)
    return fronts[is_matched[fronts.ray] & (_rank(fronts.ray) == outside[fronts.ray])]


def _joined(*parts):
    return Hits(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Hits)))


def nearest_hits(rays, high, *, facing_only=False):
    """The hit nearest to the place, on either side."""
    hits = all_hits(rays, high)
    none = hits[:0]
    return _chosen(len(rays.places), _nearest(hits[hits.faces | (not facing_only)]), none, none)


def _chosen(count, own, others, backs):
    """One hit a ray, of three kinds."""
    triangle, height, weights = np.full(count, -1), np.zeros(count), np.zeros((count, 3))
    flags = np.zeros((3, count), bool)
    for kind, hits in enumerate((own, others, backs)):
        triangle[hits.ray], height[hits.ray], weights[hits.ray] = hits.triangle, hits.height, hits.weights
        flags[kind, hits.ray] = True
    return Chosen(triangle, height, weights, flags[1], flags[2])


def _first(hits):
    """The first hit of each ray."""
    return hits[np.unique(hits.ray, return_index=True)[1]]


def _nearest(hits):
    """The hit of each ray nearest to its place."""
    return _first(hits[np.argsort(np.abs(hits.height), kind="stable")])


def _rank(ray):
    """How many earlier entries of the sorted `ray` (M,) are equal to each."""
    starts = np.flatnonzero(np.diff(ray, prepend=-1))
    return np.arange(len(ray)) - np.repeat(starts, np.diff(starts, append=len(ray)))


def all_hits(rays, high):
    """Every hit, in no order."""
    found = []
    for number, (a, b, c) in enumerate(np.asarray(high, np.float64)):
        normal = np.cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            height = (a - rays.places) @ normal / (rays.away @ normal)
            weights = barycentric(rays.places + rays.away * height[:, None], a, b, c)
            hit = (weights >= 0.0).all(axis=1) & (height <= rays.start) & (height >= -rays.inside)
        at = np.flatnonzero(hit)
        found.append((at, np.full(len(at), number), height[at], weights[at], rays.away[at] @ normal > 0.0))
    return Hits(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def barycentric(points, a, b, c):
    """The weights (N, 3) of points (N, 3) in the plane of a triangle. Each corner is (3,) or (N, 3)."""
    normal = np.cross(b - a, c - a)
    parts = [(np.cross(q - p, points - p) * normal).sum(axis=-1) for p, q in ((b, c), (c, a), (a, b))]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack(parts, axis=-1) / (normal * normal).sum(axis=-1)[..., None]


def closest_points(points, a, b, c):
    """The closest point (N, 3) on a triangle to each of points (N, 3): on its plane, else on the nearest edge."""
    candidates = []
    for p, q in ((a, b), (b, c), (c, a)):
        length = max(float((q - p) @ (q - p)), 1e-300)
        candidates.append(p + np.clip((points - p) @ (q - p) / length, 0.0, 1.0)[:, None] * (q - p))
    candidates = np.stack(candidates)
    nearest = ((candidates - points) ** 2).sum(axis=2).argmin(axis=0)
    result = candidates[nearest, np.arange(len(points))]
    normal = np.cross(b - a, c - a)
    area = float(normal @ normal)
    if area > 0.0:
        flat = points - ((points - a) @ normal / area)[:, None] * normal
        inside = (barycentric(flat, a, b, c) >= 0.0).all(axis=1)
        result[inside] = flat[inside]
    return result


def owned(points, normals, own, low, neighbors, *, tie=None):
    """Whether hits (M, 3) with normals (M, 3) belong to the low triangles `own` (M,): (M,) bool.

    tie: which of several triangles that are equally close, but for CLOSER, the walk must reach, by its place among them,
    from 0 or from the last one, -1. None for any that holds the closest point.
    """
    low = np.asarray(low, np.float64)
    count, every = len(points), np.arange(len(points))
    faces = np.cross(low[:, 1] - low[:, 0], low[:, 2] - low[:, 0])
    distances, goals = np.full((len(low), count), np.inf), np.zeros((len(low), count, 3))
    for number, (a, b, c) in enumerate(low):
        agrees = normals @ faces[number] > 0.0
        goals[number] = closest_points(points, a, b, c)
        distances[number, agrees] = np.linalg.norm(goals[number] - points, axis=1)[agrees]
    nearest = distances.argmin(axis=0)
    best, goal = distances[nearest, every], goals[nearest, every]
    if tie is None:
        ends = (distances <= best + TIE) & (np.linalg.norm(goals - goal, axis=2) <= TIE) & np.isfinite(best)
    else:
        ends = distances**2 <= best**2 * (1.0 + CLOSER)
        rank = np.cumsum(ends, axis=0)
        chosen = (rank == 1 + tie % np.maximum(rank[-1], 1)).argmax(axis=0)
        goal, ends = goals[chosen, every], (np.arange(len(low))[:, None] == chosen) & np.isfinite(best)
    current, before = own.copy(), np.full(count, -1)
    result = ends[current, every]
    walking = ~result & np.isfinite(best)
    for _ in range(STEPS):
        corners, face = low[current], faces[current]
        beyond = np.empty((count, 3))
        for k in range(3):
            outwards = np.cross(corners[:, (k + 1) % 3] - corners[:, k], face)
            lengths = np.maximum(np.linalg.norm(outwards, axis=1), 1e-300)
            beyond[:, k] = ((goal - corners[:, k]) * outwards).sum(axis=1) / lengths
        across = neighbors[current, beyond.argmax(axis=1)]
        walking &= (beyond.max(axis=1) > TIE) & (across >= 0) & (across != before)
        arrived = walking & ends[across, every]
        result |= arrived
        walking &= ~arrived
        before = np.where(walking, current, before)
        current = np.where(walking, across, current)
    # `before` is where a walk ended that was too long.
    stopped = np.where(walking, before, current)
    return result | (np.isfinite(best) & (ends & _continues(low, faces)[stopped].T).any(axis=0))


def _continues(low, faces):
    """Which triangles share a corner and are not folded back on each other, (T, T) bool."""
    places = np.unique(low.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)[1].reshape(-1, 3)
    touches = (places[:, None, :, None] == places[None, :, None, :]).any(axis=(2, 3))
    unit = faces / np.maximum(np.linalg.norm(faces, axis=1, keepdims=True), 1e-300)
    return touches & (unit @ unit.T > FOLDED)
