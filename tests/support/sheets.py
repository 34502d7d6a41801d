# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether two points of a mesh are on one sheet: where two meshes share their UVs, Flatten decides which sheet is right."""

import numpy as np

MOST_SEEN = 2**28
"""Triangles that searches mark at once, one byte each."""


def across(points, triangles):
    """The triangles (T, 3) int beyond the edges from corner k to the next, -1 where the surface ends. Points in one place are
    one."""
    steps = np.round(points / np.ptp(points, axis=0).max() * 1e6).astype(np.int64)
    welded = np.unique(steps, axis=0, return_inverse=True)[1].reshape(-1)[triangles]
    ends = np.sort(np.stack([welded, np.roll(welded, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, edge, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.reshape(-1), kind="stable")
    first = np.cumsum(counts) - counts
    result = np.full(len(order), -1)
    pairs = first[counts == 2]
    result[order[pairs]], result[order[pairs + 1]] = order[pairs + 1] // 3, order[pairs] // 3
    return result.reshape(-1, 3)


def are_connected(corners, beyond, one, other):
    """Whether a path over the surface leads from one point to another, (N,) bool, that stays near them.

    Near is inside the ball around the middle of both whose radius is their distance: a path may climb a step or go around a
    half-circle, as rays do that lean. corners (T, 3, 3); beyond: from `across`; one, other: points (N, 3) and their triangles
    (N,).
    """
    (points, triangles), (goals, last) = one, other
    middle, radius = (points + goals) / 2.0, np.linalg.norm(points - goals, axis=1)
    result = triangles == last
    at_once = max(1, MOST_SEEN // len(corners))
    for first in range(0, len(result), at_once):
        part = slice(first, first + at_once)
        result[part] = _search(corners, beyond, (triangles[part], last[part]), (middle[part], radius[part]))
    return result


def _search(corners, beyond, ends, balls):
    (triangles, last), (middle, radius) = ends, balls
    result = triangles == last
    texel = np.flatnonzero(~result)
    triangle = triangles[texel]
    seen = np.zeros(len(result) * len(corners), bool)
    seen[texel * len(corners) + triangle] = True
    while len(texel):
        found = []
        for k in range(3):
            start, way = corners[triangle, k], corners[triangle, (k + 1) % 3] - corners[triangle, k]
            length = np.maximum((way * way).sum(axis=1), 1e-300)
            share = np.clip(((middle[texel] - start) * way).sum(axis=1) / length, 0.0, 1.0)[:, None]
            is_near = np.linalg.norm(start + way * share - middle[texel], axis=1) <= radius[texel]
            goes = is_near & (beyond[triangle, k] >= 0)
            found.append(texel[goes] * len(corners) + beyond[triangle[goes], k])
        new = np.concatenate(found)
        new = np.unique(new[~seen[new]])
        seen[new] = True
        texel, triangle = np.divmod(new, len(corners))
        result[texel[triangle == last[texel]]] = True
        texel, triangle = texel[~result[texel]], triangle[~result[texel]]
    return result
