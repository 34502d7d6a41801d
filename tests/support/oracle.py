"""A float64 ray caster that tests every triangle. It is slow and simple, and shares no code with the shader."""

import numpy as np


def first_hits(origins, directions, corners, reach):
    """The nearest triangle for each ray, by plane and edge functions.

    origins, directions (N, 3); corners (T, 3, 3); reach: how far the rays go. Returns triangle (N,) int, -1 for none;
    distance (N,) and barycentric weights (N, 3) float64; margin (N,): how far inside its triangle each hit lies, as its
    smallest weight.
    """
    origins, directions, corners = (np.asarray(values, np.float64) for values in (origins, directions, corners))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = (normal**2).sum(axis=1)
    count = len(origins)
    best = np.full(count, np.inf)
    triangle, weights = np.full(count, -1), np.zeros((count, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        for i, (a, b, c) in enumerate(corners):
            distance = ((a - origins) @ normal[i]) / (directions @ normal[i])
            point = origins + distance[:, None] * directions
            parts = np.stack(
                [np.cross(q - p, point - p) @ normal[i] / area[i] for p, q in ((b, c), (c, a), (a, b))], axis=1
            )
            closer = (parts >= 0.0).all(axis=1) & (distance >= 0.0) & (distance <= reach) & (distance < best)
            best[closer], triangle[closer], weights[closer] = distance[closer], i, parts[closer]
    return triangle, best, weights, weights.min(axis=1)


BLOCK = 2**18
"""Distances that depth_inside measures at once, so that they fit in memory."""


def depth_inside(points, triangles):
    """The depth (N,) of each point (N, 2) in the triangle (T, 3, 2) that it lies deepest in; negative outside."""
    points, corners = np.asarray(points, np.float64), np.asarray(triangles, np.float64)
    edges = np.roll(corners, -1, axis=1) - corners
    lengths = np.maximum(np.linalg.norm(edges, axis=-1), 1e-300)
    result = np.empty(len(points))
    size = max(1, BLOCK // corners[..., 0].size)
    for start in range(0, len(points), size):
        to_point = points[start : start + size, None, None] - corners
        distance = (edges[..., 0] * to_point[..., 1] - edges[..., 1] * to_point[..., 0]) / lengths
        # Triangles have either winding.
        depth = np.maximum(distance.min(axis=-1), (-distance).min(axis=-1))
        result[start : start + size] = depth.max(axis=1)
    return result


def rotation(rng):
    """A random rotation matrix (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return q


def icosphere(level):
    """The corners (T, 3, 3) of a subdivided icosahedron on the unit sphere: closed."""
    t = (1.0 + np.sqrt(5.0)) / 2.0
    points = np.array(
        [(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t), (0, -1, -t), (0, 1, -t)]
        + [(t, 0, -1), (t, 0, 1), (-t, 0, -1), (-t, 0, 1)],
        np.float64,
    )
    faces = np.array(
        [
            (0, 11, 5),
            (0, 5, 1),
            (0, 1, 7),
            (0, 7, 10),
            (0, 10, 11),
            (1, 5, 9),
            (5, 11, 4),
            (11, 10, 2),
            (10, 7, 6),
            (7, 1, 8),
        ]
        + [
            (3, 9, 4),
            (3, 4, 2),
            (3, 2, 6),
            (3, 6, 8),
            (3, 8, 9),
            (4, 9, 5),
            (2, 4, 11),
            (6, 2, 10),
            (8, 6, 7),
            (9, 8, 1),
        ]
    )
    corners = points[faces]
    for _ in range(level):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate(
            [np.stack(parts, axis=1) for parts in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return corners / np.linalg.norm(corners, axis=-1, keepdims=True)
